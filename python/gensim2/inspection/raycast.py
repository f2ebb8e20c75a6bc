"""Draw an articulated object with its keypoints by ray casting, which needs no graphics driver."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gensim2.core.files import replacing
from gensim2.inspection.pictures import (
    INK,
    OPENNESS,
    PAPER,
    camera_pose,
    keypoints_at,
    mark_colour,
    short_name,
    world_points,
)
from gensim2.objects.types import ArticulatedObject
from gensim2.perception.raycast.drawing import FIELD_OF_VIEW, Drawing
from gensim2.perception.raycast.kinematics import Tree, read_urdf
from gensim2.perception.raycast.shapes import Surface, read_links

SIZE, HEADER = 360, 26
"""Width and height of a view, and height of the titles, pixels."""
AZIMUTH, ELEVATION = 35.0, 28.0
"""Azimuth of the camera from the robot's side, and its elevation above the table, degrees."""
TABLE = (200, 201, 204)
PAINT = ((120, 150, 190), (230, 150, 60))
"""Colours for surfaces without material: of fixed links, and of moving links."""


def write_strip(instance: ArticulatedObject, file: Path) -> None:
    """Draw an object three times in a row, at openness 0, 0.5 and 1, with the names of its keypoints.

    Args:
        instance: the object.
        file: PNG to write, atomically.

    Raises:
        InputError: a file of the object cannot be used, or the picture cannot be written.
        MissingExtraError: Embree is not installed.
    """
    from PIL import Image, ImageDraw, ImageFont

    points = np.concatenate([world_points(instance, openness) for openness in OPENNESS])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - middle, axis=1).max())
    _, eye = camera_pose(middle, 1.05 * radius / np.sin(FIELD_OF_VIEW / 2), AZIMUTH, ELEVATION)
    sheet = Image.new("RGB", (len(OPENNESS) * (SIZE + 4) - 4, SIZE + HEADER), PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=15)
    for column, openness in enumerate(OPENNESS):
        drawing = Drawing(_solids(instance, openness), eye, middle, SIZE)
        for name, place in keypoints_at(instance, openness).items():
            drawing.point(place, mark_colour(instance, name), short_name(name))
        left = column * (SIZE + 4)
        sheet.paste(drawing.picture(), (left, HEADER))
        title = f"{instance.asset_class}/{instance.id}, openness " if column == 0 else ""
        draw.text((left + 6, 4), f"{title}{openness:g}", fill=INK, font=font)
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file) as path:
        sheet.save(path, "PNG")


def _solids(instance: ArticulatedObject, openness: float) -> list[tuple[Surface, np.ndarray]]:
    joint = instance.joint
    root = np.eye(4)
    root[:3, :3], root[:3, 3] = instance.placement.rotation, instance.placement.position
    tree = Tree.of(read_urdf(instance.urdf), (joint.name,))
    value = joint.lower + openness * (joint.upper - joint.lower)
    surfaces, poses = read_links(instance.urdf), tree.poses(root[None], np.array([[value]]))[0]
    table = Surface.box((0.0, 0.0, -0.01), (1.0, 1.0, 0.01), TABLE)
    found = [(table, np.eye(4))]
    for name, pose in zip(tree.names, poses, strict=True):
        if (surface := surfaces.get(name)) is not None:
            bare = bool((surface.colors == 255).all()) and not surface.textures
            found.append((surface.painted(PAINT[name == joint.child_link] if bare else None), pose))
    return found
