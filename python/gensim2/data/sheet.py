"""Make contact sheets of rendered demonstrations from their stored observations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from gensim2.core.files import replacing
from gensim2.data.formats.columns import RGB, XYZ
from gensim2.data.observation_file import ObservedEpisode, read_observation
from gensim2.data.store import TaskStore

Frame = npt.NDArray[np.uint8]

MAX_PICTURES = 12
"""Largest number of a task's demonstrations on a contact sheet."""

_DOT = 2
"""Width of the border that each point gets on every side, pixels."""
_PAPER = 244
"""Brightness (0 to 255) of background pixels, in which no point is drawn."""


@dataclass(frozen=True)
class Shot:
    """A demonstration on a contact sheet.

    Attributes:
        index: index of the episode.
        file: image file, relative to the page. The image shows the first state at the top and the last state at the
            bottom.
    """

    index: int
    file: str


def contact_sheet(store: TaskStore, root: Path, folder: str) -> tuple[Shot, ...]:
    """Write images of up to ``MAX_PICTURES`` rendered demonstrations, which are at equal intervals in the data set.

    Args:
        store: episodes of the task.
        root: folder of the page.
        folder: folder of the images, relative to ``root``.

    Raises:
        InputError: an observation file is damaged.
        WriteError: the folder cannot be written to.
    """
    seen = [row.index for row in store.rows() if row.held and store.observation_path(row.index).exists()]
    chosen = {seen[round(place)] for place in np.linspace(0, len(seen) - 1, min(MAX_PICTURES, len(seen)))}
    shots = []
    for row in store.rows():
        if row.index not in chosen:
            continue
        observation = read_observation(store.observation_path(row.index), row.episode_digest)
        first, last = picture(observation, 0), picture(observation, -1)
        if first is not None and last is not None:
            file = f"{folder}/{store.name}-{row.index:06d}.png"
            with replacing(root / file) as path:
                Image.fromarray(np.concatenate([first, last])).save(path, "png")
            shots.append(Shot(row.index, file))
    return tuple(shots)


def picture(observation: ObservedEpisode, step: int) -> Frame | None:
    """Return an image (H, W, 3) of one time step, or None if the episode has neither colour images nor a point cloud.

    The image comes from a camera with colour images, preferably from the camera ``right``, because this camera sees the
    side of the object on which the robot acts. If no camera has colour images, the function draws the point cloud.
    """
    arrays = observation.arrays
    names = sorted(
        {name.split("/")[1] for name in arrays if name.startswith("cameras/")}, key=lambda name: (name != "right", name)
    )
    for camera in names:
        if (taken := arrays.get(f"cameras/{camera}/rgb")) is not None:
            return np.asarray(taken[step], dtype=np.uint8)
    if XYZ not in arrays:
        return None
    intrinsic, T_base_camera = (arrays[f"cameras/{names[0]}/{what}"] for what in ("intrinsic", "T_base_camera"))
    if T_base_camera.ndim == 3:  # the pose of a camera on the robot has a time axis
        T_base_camera = T_base_camera[step]
    return _splatted(arrays[XYZ][step], arrays[RGB][step], intrinsic, T_base_camera)


def _splatted(points: npt.NDArray[Any], colours: Frame, intrinsic: Any, T_base_camera: Any) -> Frame:
    """Draw a point cloud as a camera would see it. Each point becomes a square, and near points cover far points."""
    width, height = (round(2 * float(intrinsic[axis, 2])) for axis in (0, 1))
    found = np.full((height, width, 3), _PAPER, dtype=np.uint8)
    turned = np.linalg.inv(T_base_camera)
    seen = points @ turned[:3, :3].T + turned[:3, 3]
    order = np.argsort(-seen[:, 2])
    ahead = order[seen[order, 2] > 0.0]
    pixels = np.floor(seen[ahead] @ np.asarray(intrinsic).T / seen[ahead, 2:]).astype(int)
    for (column, row, _), colour in zip(pixels, colours[ahead], strict=True):
        if -_DOT <= row < height + _DOT and -_DOT <= column < width + _DOT:
            found[max(row - _DOT, 0) : row + _DOT + 1, max(column - _DOT, 0) : column + _DOT + 1] = colour
    return found
