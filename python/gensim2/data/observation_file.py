"""Observations of one episode in one sealed file: HDF5 with what they are of, and one dataset an array."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from gensim2.data.episode_file import LIBVER
from gensim2.errors import InputError
from gensim2.observations.cloud import from_steps
from gensim2.sealed_file import HEADER_SIZE, Seal

CLOUD = "pointcloud/xyz"
"""Is kept in steps of 0.1 mm (:data:`gensim2.observations.cloud.RESOLUTION`), and read in m."""

_ONE_FRAME: dict[str, Any] = {"compression": "gzip", "compression_opts": 4, "shuffle": True}


class DamagedObservationError(InputError):
    """A file is not the whole file of an episode's observations."""


_SEAL = Seal(
    "gensim2-observation",
    1,
    "is not a finished file of observations",
    "delete it and render with --resume",
    DamagedObservationError,
)


@dataclass(frozen=True, eq=False)
class Observation:
    """What is observed of an episode of T steps.

    Attributes:
        description: what it is of and how it was made, as plain data: ``task``, ``index``, ``episode_digest``,
            ``language``, ``steps`` and everything of the plan.
        arrays: by name; (T + 1, ...) but for the cameras' own.
    """

    description: dict[str, Any]
    arrays: dict[str, npt.NDArray[Any]]


def write_observation(path: Path, description: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> str:
    """Write a file, whole or not at all, and return its digest; the same content gives the same bytes.

    Args:
        arrays: by name; ``pointcloud/xyz`` as steps.

    Raises:
        WriteError: the folder cannot be written to.
    """
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver=LIBVER, userblock_size=HEADER_SIZE) as file:
        text = json.dumps(description, allow_nan=False, sort_keys=True).encode()
        file.create_dataset("observation", data=np.frombuffer(text, np.uint8))
        for name, array in arrays.items():
            frame = (1, *array.shape[1:])
            file.create_dataset(name, data=array, chunks=frame if array.ndim > 2 else array.shape, **_ONE_FRAME)
    return _SEAL.write(path, buffer.getvalue()[HEADER_SIZE:])


def read_description(path: Path) -> dict[str, Any]:
    """What a file is of, once it is known to be whole.

    Raises:
        DamagedObservationError: it is not whole.
        InputError: it cannot be read, or another version of gensim2 wrote it.
    """
    with _opened(path) as file:
        return _description(file, path)


def read_observation(path: Path, episode_digest: str | None = None) -> Observation:
    """Return the whole of a file.

    Args:
        episode_digest: of the episode's file that it must be of; None: of any.

    Raises:
        DamagedObservationError, InputError: as for :func:`read_description`, or it is of another episode.
    """
    with _opened(path) as file:
        description = _description(file, path)
        if episode_digest is not None and description.get("episode_digest") != episode_digest:
            raise InputError("is of another episode", file=path, remedy="delete it and render with --resume")
        arrays: dict[str, npt.NDArray[Any]] = {}

        def take(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and name != "observation":
                arrays[name] = from_steps(item[()]) if name == CLOUD else item[()]

        file.visititems(take)
    return Observation(description, arrays)


def _opened(path: Path) -> h5py.File:
    _, content = _SEAL.read(path)
    return h5py.File(io.BytesIO(content), "r")


def _description(file: h5py.File, path: Path) -> dict[str, Any]:
    try:
        found = json.loads(file["observation"][()].tobytes())
    except (KeyError, ValueError) as error:
        raise _SEAL.broken(path) from error
    if not isinstance(found, dict):
        raise _SEAL.broken(path)
    return found
