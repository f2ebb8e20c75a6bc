"""Pictures of demonstrations out of what `gensim2 render` made of them, without a renderer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
import numpy.typing as npt

from gensim2.core.files import replacing
from gensim2.data.formats.columns import RGB, XYZ
from gensim2.data.observation_file import ObservedEpisode, read_observation
from gensim2.data.store import TaskStore
from gensim2.data.video import write_video
from gensim2.robots import robot
from gensim2.rollout.record import Episode

Frame = npt.NDArray[np.uint8]

MAX_PICTURES = 12
"""Demonstrations of a task on its sheet."""

_DOT = 2
"""Pixels to each side of a point's own."""
_PAPER = 244
"""Brightness of what no point covers."""
_LARGER = 3


@dataclass(frozen=True)
class Shot:
    """A demonstration on a contact sheet.

    Attributes:
        index: of the episode.
        file: its picture, beside the page: the first instant above the last one.
    """

    index: int
    file: str


def contact_sheet(store: TaskStore, root: Path, folder: str) -> tuple[Shot, ...]:
    """Write pictures of up to ``MAX_PICTURES`` demonstrations that are spread evenly over those that have observations.

    Args:
        store: of the task.
        root: of the page.
        folder: beside the page, to write to.

    Raises:
        InputError: a file of observations is damaged.
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
                imageio.imwrite(path, np.concatenate([first, last]), format="png")
            shots.append(Shot(row.index, file))
    return tuple(shots)


def film_seen(store: TaskStore, row: Episode, video: Path, still: Path) -> bool:
    """Write a demonstration's observations as a film, three times their size, and a picture of its middle; whether
    there were any to be shown.

    Raises:
        InputError: the file of observations is damaged.
        WriteError: a file cannot be written.
    """
    path = store.observation_path(row.index)
    if not path.exists():
        return False
    observation = read_observation(path, row.episode_digest)
    steps = int(observation.description["steps"])
    frames = [picture(observation, step) for step in range(steps + 1)]
    large = [frame.repeat(_LARGER, axis=0).repeat(_LARGER, axis=1) for frame in frames if frame is not None]
    if not large:
        return False
    with replacing(video) as file:
        write_video(file, large, robot(str(observation.description["robot"])).control_hz)
    with replacing(still) as file:
        imageio.imwrite(file, large[len(large) // 2])
    return True


def picture(observation: ObservedEpisode, step: int) -> Frame | None:
    """(H, W, 3) of one instant: what a camera took, or the point cloud as a camera sees it; None without either.

    The right camera comes first: it sees the side of the object that the robot works on.
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
    if T_base_camera.ndim == 3:  # the robot carries it
        T_base_camera = T_base_camera[step]
    return _splatted(arrays[XYZ][step], arrays[RGB][step], intrinsic, T_base_camera)


def _splatted(points: npt.NDArray[Any], colours: Frame, intrinsic: Any, T_base_camera: Any) -> Frame:
    """A point cloud as a camera sees it: each point a square, what is near over what is far."""
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
