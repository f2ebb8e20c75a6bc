"""Store the observations of one episode in one checksummed HDF5 file, which contains a description and all arrays."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.core.foreign.hdf5 import ForeignHdf5Error, array_in, dataset_in, group_in, is_group, members
from gensim2.core.sealed_file import HEADER_SIZE, Seal
from gensim2.data.episode_file import LIBVER
from gensim2.data.formats.columns import IDS, RGB, XYZ, column_of
from gensim2.perception import ObservationSpec
from gensim2.perception.cloud import from_steps

DESCRIPTION = "observation"
"""Name of the dataset with the description, as JSON."""
MAX_DESCRIPTION = 2**20  # maximum size of the description, bytes
DEPTH = 2  # maximum nesting of groups, as in cameras/left/rgb

_ONE_FRAME: dict[str, Any] = {"compression": "gzip", "compression_opts": 4, "shuffle": True}


class DamagedObservationError(InputError):
    """A file is not a complete observation file."""


_SEAL = Seal(
    "gensim2-observation",
    1,
    "is not a complete observation file",
    "delete it and render with --resume",
    DamagedObservationError,
)


@dataclass(frozen=True, eq=False)
class ObservedEpisode:
    """Observations of an episode of T steps.

    Attributes:
        description: JSON object with ``task``, ``index``, ``episode_digest``, ``language``, ``steps`` and the
            observation spec.
        arrays: arrays by name. Most have the shape (T + 1, ...), with a row before the first step and after each step.
            The ``intrinsic`` and the pose of a camera have no time axis; the pose is ``T_base_camera`` of a fixed
            camera or ``T_link_camera`` of a camera on the robot.
    """

    description: dict[str, Any]
    arrays: dict[str, npt.NDArray[Any]]

    @property
    def is_of_keypoints(self) -> bool:
        """Whether the point clouds consist of object keypoints, whose positions only a simulator knows."""
        return bool(self.description.get("cloud", {}).get("source") == "keypoints")


def write_observation(path: Path, description: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> str:
    """Write an observation file atomically and return its digest; the same content gives the same bytes.

    Args:
        arrays: arrays by name; ``pointcloud/xyz`` as int16 in units of 0.1 mm.

    Raises:
        WriteError: the folder cannot be written to.
    """
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver=LIBVER, userblock_size=HEADER_SIZE) as file:
        text = json.dumps(description, allow_nan=False, sort_keys=True).encode()
        file.create_dataset(DESCRIPTION, data=np.frombuffer(text, np.uint8))
        for name, array in arrays.items():
            frame = (1, *array.shape[1:])
            file.create_dataset(name, data=array, chunks=frame if array.ndim > 2 else array.shape, **_ONE_FRAME)
    return _SEAL.write(path, buffer.getvalue()[HEADER_SIZE:])


def read_description(path: Path) -> dict[str, Any]:
    """Check a file and read its description.

    Raises:
        DamagedObservationError: the file is damaged.
        InputError: the file cannot be read, or another version of gensim2 wrote it.
    """
    with _opened(path) as file:
        return _description(file, path)


def checked_description(path: Path, episode_digest: str | None) -> dict[str, Any]:
    """Return a file's description and check that it belongs to the episode with the given digest."""
    found = read_description(path)
    if found.get("episode_digest") != episode_digest:
        raise InputError("belongs to another episode", file=path, remedy="delete it and render with --resume")
    return found


def spec_of_file(description: Mapping[str, Any], path: Path) -> ObservationSpec:
    """Return the observation spec in a file's description.

    Raises:
        InputError: the description has no valid spec.
    """
    try:
        return ObservationSpec.of({name: description[name] for name in ("modalities", "cameras", "cloud")})
    except (KeyError, TypeError) as error:
        raise _SEAL.broken(path, "observation") from error


def read_observation(path: Path, episode_digest: str | None = None) -> ObservedEpisode:
    """Read an observation file.

    Args:
        episode_digest: digest of the episode file that the observations must belong to; None skips the check.

    Raises:
        DamagedObservationError, InputError: as for :func:`read_description`, or the file belongs to another episode.

    Example:
        ```python
        seen = read_observation(Path("night/CloseBox/observations/000000.h5"))
        ```
    """
    with _opened(path) as file:
        description = _description(file, path)
        if episode_digest is not None and description.get("episode_digest") != episode_digest:
            raise InputError("belongs to another episode", file=path, remedy="delete it and render with --resume")
        try:
            arrays = {name: dataset[()] for name, dataset in _datasets(file, "", DEPTH)}
            if XYZ in arrays:
                arrays[XYZ] = from_steps(arrays[XYZ])
        except (ValueError, TypeError, OSError, RuntimeError) as error:
            raise _SEAL.broken(path, str(error) if isinstance(error, ForeignHdf5Error) else None) from error
    return ObservedEpisode(description, arrays)


def frame_arrays(path: Path, frames: int) -> list[str]:
    """Return the arrays with one row per frame, which are the columns of :class:`~gensim2.data.DataSet` frames.

    Args:
        path: observation file whose checksum was checked already.
        frames: number of frames of the episode, which is the required number of rows.

    Raises:
        DamagedObservationError: an array has too few rows or an unknown name.
    """
    try:
        with h5py.File(path, "r") as file:
            found = dict(_datasets(file, "", DEPTH))
            clouds = {XYZ: (3,), RGB: (3,), IDS: ()}
            names = [name for name in found if name in clouds or column_of(name) is not None]
            if any(name in clouds for name in names):
                points = found[XYZ].shape[1:2]
                for name, rest in clouds.items():
                    if found[name].shape[1:] != (*points, *rest):
                        raise ForeignHdf5Error(name)
            for name in names:
                if not found[name].shape or found[name].shape[0] < frames:
                    raise ForeignHdf5Error(name)
            return names
    except (ValueError, TypeError, KeyError, OSError, RuntimeError, InputError) as error:
        raise _SEAL.broken(path, str(error) if isinstance(error, ForeignHdf5Error) else None) from error


def _datasets(group: h5py.Group, prefix: str, depth: int) -> Iterator[tuple[str, h5py.Dataset]]:
    for name in members(group):
        if prefix + name == DESCRIPTION:
            continue
        if not is_group(group, name):
            yield prefix + name, dataset_in(group, name)
        elif depth:
            yield from _datasets(group_in(group, name), f"{prefix}{name}/", depth - 1)
        else:
            raise ForeignHdf5Error(f"{prefix}{name} is nested too deeply")


def _opened(path: Path) -> h5py.File:
    _, content = _SEAL.read(path)
    try:
        return h5py.File(io.BytesIO(content), "r")
    except (OSError, ValueError, RuntimeError) as error:
        raise _SEAL.broken(path) from error


def _description(file: h5py.File, path: Path) -> dict[str, Any]:
    try:
        found = json.loads(array_in(file, DESCRIPTION, np.uint8, (None,), MAX_DESCRIPTION).tobytes())
    except (ValueError, OSError, RuntimeError) as error:
        raise _SEAL.broken(path) from error
    if not isinstance(found, dict):
        raise _SEAL.broken(path)
    return found
