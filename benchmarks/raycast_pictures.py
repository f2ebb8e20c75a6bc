"""SAPIEN's pictures of one recorded state above ours: colour, depth, segmentation; beside them the point cloud.

python benchmarks/raycast_pictures.py DIR TASK OUT.png [--camera right] [--at 0.6]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from raycast import episodes, observer

from gensim2.perception import CloudSettings, PointCloud, point_cloud
from gensim2.sim.pictures import StatePictures

SCALE, GAP, TITLE = 2, 8, 26
TITLES = ("colour (SAPIEN above, ours below)", "depth", "segmentation", "our point cloud")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("task")
    parser.add_argument("out", type=Path)
    parser.add_argument("--camera", default="right")
    parser.add_argument("--at", type=float, default=0.6, help="share of the episode")
    given = parser.parse_args()
    shown, recording = next(one for one in episodes([given.folder]) if one[0].task.name == given.task)
    step = round(given.at * recording.steps)
    textures = ("rgb", "depth", "segmentation")
    pictures = StatePictures(shown, textures)
    pictures.show(recording.instances, recording.seed, recording.reset_options)
    theirs = pictures.at(recording.env_states, step)[given.camera]
    pictures.close()
    seeing = observer(shown, recording, CloudSettings(points=4096, candidates=16384))
    views = seeing.views(seeing.scene.poses(recording.env_states)[step], step)
    view = next(view for view in views if view.camera.name == given.camera)
    assert view.segmentation is not None
    size = view.depth.shape
    colors = view.colors_at(np.arange(view.depth.size)).reshape(*size, 3)
    rows = [
        [theirs["rgb"], gray(theirs["depth"] / 1000.0), painted(theirs["segmentation"])],
        [colors, gray(view.depth), painted(view.segmentation)],
    ]
    grid = np.concatenate([np.concatenate([framed(image) for image in row], axis=1) for row in rows])
    cloud = drawn(point_cloud(views, seeing.spec.cloud, seeing.scene.robot), grid.shape[0] - GAP)
    titled(np.concatenate([grid, framed(cloud, 1)], axis=1), SCALE * size[1] + GAP).save(given.out)
    other = theirs["segmentation"] != view.segmentation
    print(f"step {step}: {other.sum()} of {other.size} pixels see another link: {np.argwhere(other)[:8].tolist()}")


def titled(picture: Any, width: int) -> Image.Image:
    """Return a picture with the titles of its columns above it, the first three of which are `width` pixels wide."""
    found = Image.new("RGB", (picture.shape[1], picture.shape[0] + TITLE), "white")
    found.paste(Image.fromarray(picture), (0, TITLE))
    draw, font = ImageDraw.Draw(found), ImageFont.load_default(15)
    for column, title in enumerate(TITLES):
        draw.text((column * width + GAP, 5), title, (28, 36, 48), font)
    return found


def gray(depth: Any) -> Any:
    shade = np.where(depth > 0, 255 * np.clip(1.6 - depth, 0, 1.2) / 1.2, 0).astype(np.uint8)
    return np.repeat(shade[:, :, None], 3, axis=2)


def painted(ids: Any) -> Any:
    palette = np.random.default_rng(3).integers(50, 255, (64, 3), dtype=np.uint8)
    palette[0] = 0
    return palette[ids]


def framed(image: Any, scale: int = SCALE) -> Any:
    large = np.repeat(np.repeat(image, scale, axis=0), scale, axis=1)
    return np.pad(large, ((0, GAP), (0, GAP), (0, 0)), constant_values=255)


def drawn(cloud: PointCloud, pixels: int) -> Any:
    """The points from the front left and above, those that are near on top."""
    turn, tilt = np.deg2rad(55), np.deg2rad(35)
    x, y, z = (cloud.xyz - cloud.xyz.mean(axis=0)).T
    right, ahead = np.sin(turn) * x + np.cos(turn) * y, np.cos(turn) * x - np.sin(turn) * y
    up, near = np.cos(tilt) * z - np.sin(tilt) * ahead * -1, np.sin(tilt) * z + np.cos(tilt) * ahead * -1
    place = np.stack([right, -up], axis=1)
    place = (place - place.min(axis=0)) / np.ptp(place, axis=0).max() * (pixels - 30) + 12
    image = np.full((pixels, pixels, 3), (52, 58, 70), dtype=np.uint8)
    for index in np.argsort(near):
        column, row = place[index].astype(int)
        image[row : row + 5, column : column + 5] = cloud.rgb[index]
    return image


if __name__ == "__main__":
    main()
