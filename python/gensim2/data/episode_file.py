"""Store each episode in an HDF5 file with a checksum.

The file has the episode's record (``episode``) and its states (group ``traj``).
"""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import h5py
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from gensim2.core.errors import InputError
from gensim2.core.foreign.hdf5 import ForeignHdf5Error, array_in, group_in, is_group, members
from gensim2.core.sealed_file import HEADER_SIZE, Seal
from gensim2.core.validation import input_error
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import EpisodeResult, Recording
from gensim2.rollout.world import Tree

#: HDF5 version of the files. The default needs 2 kB of index for each of ten arrays. Files of version 1.10 are half as
#: large, for the same CPU time (benchmarks/stores.py).
LIBVER = ("v110", "v110")
_FILTERS: dict[str, Any] = {"compression": "gzip", "compression_opts": 6, "shuffle": True}

#: Arrays of a recording below ``traj``, with names, shapes and types of ManiSkill's ``RecordEpisode``.
_ARRAYS = ("obs", "actions", "terminated", "truncated", "success", "rewards")

STATES_DEPTH = 2
"""Levels of groups below ``env_states``: kind (actors, articulations), then name."""
MAX_ARRAY = 128 * 2**20
"""Largest array of a recording, bytes."""

MAX_ROW = 64 * 2**20
"""Largest record of an episode, bytes."""

_EPISODE = TypeAdapter(Episode)


class DamagedEpisodeError(InputError):
    """An episode file is damaged or incomplete."""


_REMEDY = "delete the file and resume"
_SEAL = Seal("gensim2-episode", 1, "is not a finished episode", _REMEDY, DamagedEpisodeError)


class RecordingHeader(BaseModel):
    """Metadata of a recording; the fields are those of :class:`Recording`.

    Attributes:
        steps: T, number of control steps.
        success: whether the goal holds at the last step.
    """

    model_config = ConfigDict(extra="forbid", strict=True)

    seed: int
    control_mode: str
    steps: Annotated[int, Field(ge=1)]
    reset_options: dict[str, Any]
    instances: dict[str, str]
    success: bool


_RECORDED = TypeAdapter(RecordingHeader)


def write_episode(path: Path, episode: Episode, recording: Recording | None) -> str:
    """Write an episode's file atomically and return its digest; the same episode gives the same bytes.

    Args:
        recording: recorded states of the episode; None: store the record only.

    Raises:
        WriteError: the folder cannot be written to.
    """
    row = {"episode": episode.to_dict(), "recording": _recorded(recording) if recording is not None else None}
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver=LIBVER, userblock_size=HEADER_SIZE) as file:
        text = json.dumps(row, allow_nan=False).encode()
        _write_array(file, "episode", np.frombuffer(text, np.uint8))
        if recording is not None:
            _write_recording(file.create_group("traj"), recording)
    return _SEAL.write(path, buffer.getvalue()[HEADER_SIZE:])


def episode_digest(path: Path) -> str:
    """Check the bytes of an episode's file and return its digest.

    Raises:
        DamagedEpisodeError: the bytes have changed.
        InputError: the file cannot be read, or another version of gensim2 wrote it.
    """
    return _SEAL.read(path)[0]


def read_row(path: Path) -> Episode:
    """Return the record of an episode file, together with the file's digest.

    Raises:
        DamagedEpisodeError, InputError: as for :func:`episode_digest`.
    """
    with open_episode(path) as (episode, _, _):
        return episode


def read_episode(path: Path) -> EpisodeResult:
    """Read an episode's file.

    Raises:
        DamagedEpisodeError, InputError: as for :func:`episode_digest`.
    """
    with open_episode(path) as (episode, header, group):
        recording = None if header is None else read_recording(group, header.model_dump())
        return EpisodeResult(episode, recording)


@contextlib.contextmanager
def open_episode(path: Path) -> Iterator[tuple[Episode, RecordingHeader | None, h5py.Group | None]]:
    """Open the file of an episode. Yield its record, its recording metadata and its group ``traj``.

    The metadata and the group are None if the file has no states.

    Raises:
        DamagedEpisodeError, InputError: as for :func:`episode_digest`.
    """
    digest, content = _SEAL.read(path)
    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            plain = json.loads(array_in(file, "episode", np.uint8, (None,), MAX_ROW).tobytes())
            episode = _EPISODE.validate_json(json.dumps(plain["episode"], allow_nan=False), strict=True)
            recorded = plain["recording"]
            if recorded is not None:
                recorded = _RECORDED.validate_json(json.dumps(recorded, allow_nan=False), strict=True)
            yield (
                replace(episode, episode_digest=digest),
                recorded,
                group_in(file, "traj") if recorded is not None else None,
            )
    except ValidationError as error:
        raise _SEAL.broken(path, input_error(error).field) from error
    except (KeyError, ValueError, TypeError, RuntimeError, AttributeError, OSError) as error:
        raise _SEAL.broken(path, str(error) if isinstance(error, ForeignHdf5Error) else None) from error


def _recorded(recording: Recording) -> dict[str, Any]:
    return {
        "seed": recording.seed,
        "control_mode": recording.control_mode,
        "steps": recording.steps,
        "reset_options": recording.reset_options,
        "instances": recording.instances,
        "success": bool(recording.success[-1]),
    }


def _write_recording(group: h5py.Group, recording: Recording) -> None:
    for name in _ARRAYS:
        _write_array(group, name, getattr(recording, name))
    _write_tree(group.create_group("env_states"), recording.env_states)
    if recording.reference:
        _write_tree(group.create_group("reference"), recording.reference)


def _write_tree(group: h5py.Group, tree: Tree) -> None:
    # Names are written in the alphabetical order of HDF5, so that a file that is read and written has identical bytes.
    for name, value in sorted(tree.items()):
        if isinstance(value, dict):
            _write_tree(group.create_group(name), value)
        else:
            _write_array(group, name, np.asarray(value))


def _write_array(group: h5py.Group, name: str, array: np.ndarray[Any, Any]) -> None:
    """Write an array as a single chunk, because episodes are read completely and small chunks compress badly."""
    if array.size:
        group.create_dataset(name, data=array, chunks=array.shape, **_FILTERS)
    else:
        group.create_dataset(name, data=array)


def read_recording(group: h5py.Group, recorded: Mapping[str, Any]) -> Recording:
    """Read the recorded states and actions in the HDF5 group ``traj``.

    Args:
        recorded: metadata of the recording, as plain data.

    Raises:
        KeyError: ``recorded`` lacks a field.
        ForeignHdf5Error: the group lacks an array or has unexpected content.
    """
    return Recording(
        seed=recorded["seed"],
        reset_options=recorded["reset_options"],
        instances=recorded["instances"],
        control_mode=recorded["control_mode"],
        env_states=read_tree(group_in(group, "env_states"), STATES_DEPTH),
        reference=read_tree(group_in(group, "reference"), 1) if "reference" in group else {},
        **{name: array_in(group, name, max_bytes=MAX_ARRAY) for name in _ARRAYS},
    )


def read_tree(group: h5py.Group, depth: int) -> Tree:
    if not depth:
        raise ForeignHdf5Error(f"{group.name} is nested too deeply")
    return {
        name: read_tree(group_in(group, name), depth - 1)
        if is_group(group, name)
        else array_in(group, name, max_bytes=MAX_ARRAY)
        for name in members(group)
    }
