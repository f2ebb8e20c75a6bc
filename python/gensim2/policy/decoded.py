"""Decode the episodes of data sets into memory-mapped arrays, which are cached on disk."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError, WriteError
from gensim2.core.files import cache_dir, new_folder, write_json
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data import DataSet
from gensim2.data.formats.columns import RGB, STORED, XYZ
from gensim2.data.observation_file import ObservedEpisode, read_observation, spec_of_file
from gensim2.data.store import TaskStore
from gensim2.perception import ObservationSpec
from gensim2.perception.cloud import to_steps
from gensim2.policy.checkpoint import DataRecord
from gensim2.policy.heads.actions import ACTION
from gensim2.rollout.record import Episode

Array = npt.NDArray[Any]

FILES = {XYZ: "xyz", RGB: "rgb", ACTION: "actions", **{column: column for column in STORED}}
"""File name of each array in the cache."""

VERSION = 1
"""Version of the cache's layout, which is part of its folder's name."""


@dataclass(frozen=True)
class DecodedEpisode:
    """Rows of the decoded arrays that belong to one episode.

    Attributes:
        task, language: name and instruction of the task.
        first: row of the first frame.
        steps: T, number of actions. The episode has T + 1 frames; the last frame follows the last action.
    """

    task: str
    language: str
    first: int
    steps: int


@dataclass(frozen=True)
class DecodedData:
    """Successful episodes of one or several data sets.

    Attributes:
        observation: observation spec of the rendered episodes.
        episodes: episodes, in the order of their rows in the arrays.
        arrays: memory-mapped arrays with a row for each frame: ``pointcloud/xyz`` int16 in 0.1 mm, ``pointcloud/rgb``
            uint8, and proprioception and ``action`` float32. ``action`` has the planned commands without noise. The
            last row of an episode repeats the row before.
        record: description of the data for checkpoints.
    """

    robot: str
    observation: ObservationSpec
    episodes: tuple[DecodedEpisode, ...]
    arrays: dict[str, Array]
    record: DataRecord


@dataclass(frozen=True)
class _Row:
    store: TaskStore
    row: Episode
    language: str
    noisy: bool

    @property
    def rendered(self) -> bool:
        return self.store.observation_path(self.row.index).exists()


def decode(folders: Sequence[Path], tasks: Sequence[str] = (), *, progress: Progress = NULL_PROGRESS) -> DecodedData:
    """Return the successful, rendered episodes of data sets, from the cache if it contains them.

    Args:
        folders: rendered data sets. Episodes that are not rendered are left out and reported; repeated episodes count
            once.
        tasks: names of the tasks; empty for all.

    Raises:
        InputError: a data set is unreadable or not rendered, data sets do not fit together, or a number is not finite.
    """
    sets = [DataSet.open(folder) for folder in folders]
    if not sets:
        raise InputError("at least one data set is needed", field="--data")
    robots = {each.record.scene.robot for each in sets}
    if len(robots) > 1:
        wrong = f"the data sets were recorded with different robots: {', '.join(sorted(robots))}"
        raise InputError(wrong, field="--data")
    spec = sets[0].observation_spec()
    for each in sets[1:]:
        spec.require(each.observation_spec(), str(each.path), of=str(sets[0].path))
    if "pointcloud" not in spec.modalities:
        raise InputError("the data set has no point clouds", file=sets[0].path, remedy="run `gensim2 render` on it")
    found = list(_rows(sets, tasks))
    if not found:
        raise InputError("the data sets contain no successful episode", field="--data")
    held = _once(found)
    if len(held) < len(found):
        progress.message(f"{len(found) - len(held)} of {len(found)} episodes occur in several data sets and count once")
    rows = [each for each in held if each.rendered]
    if not rows:
        wrong = "the data sets contain no rendered episode"
        raise InputError(wrong, field="--data", remedy="run `gensim2 render` on them")
    if len(rows) < len(held):
        left_out = f"{len(held) - len(rows)} of {len(held)} episodes have no observations and are left out"
        progress.message(f"{left_out} (`gensim2 render` with --resume makes them)")
    robot = robots.pop()
    digest = _digest(rows, robot, spec)
    place = cache_dir() / "policy" / "frames" / f"{VERSION}-{digest[:32]}"
    episodes = tuple(_episodes(rows))
    if not _whole(place, episodes):
        try:
            _fill(place, rows, episodes, spec, progress)
        except InputError as error:
            # Decoding failed. Ignore the error if another process has decoded the same data in the meantime.
            if not _whole(place, episodes):
                if isinstance(error, WriteError):
                    remedy = "free disk space, or set GENSIM2_CACHE to another folder"
                    raise WriteError(error.message, file=place, remedy=remedy) from error
                raise
    arrays = {name: np.load(place / f"{file}.npy", mmap_mode="r") for name, file in FILES.items()}
    last = episodes[-1]
    record = DataRecord(
        digest=digest,
        tasks=tuple(dict.fromkeys(each.task for each in episodes)),
        episodes=len(episodes),
        frames=last.first + last.steps + 1,
        folders=tuple(each.path.name for each in sets),
        noisy=sum(each.noisy for each in rows),
    )
    return DecodedData(robot, spec, episodes, arrays, record)


def _rows(sets: Sequence[DataSet], tasks: Sequence[str]) -> Iterator[_Row]:
    known = {name for each in sets for name in each.tasks}
    for name in tasks:
        if name not in known:
            raise InputError(f"no data set has a task {name!r}", field="--task", remedy=f"choose from {sorted(known)}")
    for each in sets:
        for name in each.tasks:
            if tasks and name not in tasks:
                continue
            store = each.task(name)
            language, noisy = store.spec().description, each.record.rollout.noise > 0
            yield from (_Row(store, row, language, noisy) for row in store.rows() if row.held)


def _once(rows: Sequence[_Row]) -> list[_Row]:
    """Remove duplicate episodes. If one copy has rendered observations, keep this copy."""
    found: dict[tuple[str, str, str | None], _Row] = {}
    for each in rows:
        key = (each.store.name, each.language, each.row.episode_digest)
        if key not in found or (each.rendered and not found[key].rendered):
            found[key] = each
    return list(found.values())


def _digest(rows: Sequence[_Row], robot: str, spec: ObservationSpec) -> str:
    """Return a SHA-256 of the episodes, their instructions and the observation settings."""
    found = hashlib.sha256(json.dumps([robot, spec.to_dict()], sort_keys=True).encode())
    for each in rows:
        found.update(f"{each.store.name}\n{each.language}\n{each.row.episode_digest}\n".encode())
    return found.hexdigest()


def _episodes(rows: Sequence[_Row]) -> Iterator[DecodedEpisode]:
    first = 0
    for each in rows:
        yield DecodedEpisode(each.store.name, each.language, first, each.row.control_steps)
        first += each.row.control_steps + 1


def _whole(place: Path, episodes: Sequence[DecodedEpisode]) -> bool:
    """Return whether all cached arrays are complete. A power failure can leave missing or truncated files."""
    frames = episodes[-1].first + episodes[-1].steps + 1
    try:
        found = [np.load(place / f"{file}.npy", mmap_mode="r") for file in FILES.values()]
    except (OSError, ValueError):
        return False
    return all(len(each) == frames for each in found)


def _fill(
    place: Path, rows: Sequence[_Row], episodes: Sequence[DecodedEpisode], spec: ObservationSpec, progress: Progress
) -> None:
    frames = episodes[-1].first + episodes[-1].steps + 1
    progress.start("decoding episodes", len(rows))
    if place.exists():
        _remove(place)
    with new_folder(place) as folder:
        arrays: dict[str, Array] = {}
        for each, episode in zip(rows, episodes, strict=True):
            for name, values in _read(each, spec).items():
                if name not in arrays:
                    shape = (frames, *values.shape[1:])
                    file = folder / f"{FILES[name]}.npy"
                    arrays[name] = np.lib.format.open_memmap(file, "w+", values.dtype, shape)
                    _allocate(file)
                arrays[name][episode.first : episode.first + episode.steps + 1] = values
            progress.advance()
        for array in arrays.values():
            array.flush()  # type: ignore[attr-defined]  # a memory map
        write_json(folder / "about.json", {"schema_version": VERSION, "frames": frames, "episodes": len(rows)})


def _allocate(file: Path) -> None:
    """Allocate the disk space of a sparse file. Without it, a full disk would kill the process when it writes."""
    with file.open("r+b") as stream:
        os.posix_fallocate(stream.fileno(), 0, os.fstat(stream.fileno()).st_size)


def _remove(place: Path) -> None:
    import shutil

    shutil.rmtree(place)


def _read(each: _Row, spec: ObservationSpec) -> dict[str, Array]:
    path = each.store.observation_path(each.row.index)
    seen = read_observation(path, each.row.episode_digest)
    spec.require(spec_of_file(seen.description, path), str(path), of="the rest of the data")
    recording = each.store.recording(each.row)
    found = {name: _finite(seen, stored, path) for name, stored in STORED.items()}
    found[XYZ] = to_steps(_finite(seen, XYZ, path))
    found[RGB] = seen.arrays[RGB]
    found[ACTION] = np.concatenate([recording.meant, recording.meant[-1:]])
    for name, values in found.items():
        if len(values) != recording.steps + 1:
            message = f"has {len(values)} frames, not {recording.steps + 1}"
            raise InputError(message, file=path, field=name, remedy="delete it and render with --resume")
    return found


def _finite(seen: ObservedEpisode, name: str, path: Path) -> Array:
    values = seen.arrays[name]
    if not np.isfinite(values).all():
        step = int(np.argmin(np.isfinite(values.reshape(len(values), -1)).all(axis=1)))
        message = f"contains a number that is not finite at frame {step}"
        raise InputError(message, file=path, field=name, remedy="delete it and render with --resume")
    return values
