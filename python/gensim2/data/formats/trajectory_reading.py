"""Import ManiSkill trajectories that :func:`~gensim2.data.trajectory.write_trajectory` wrote."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import h5py
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from gensim2.core.errors import InputError
from gensim2.core.files import replacing
from gensim2.core.foreign.hdf5 import group_in
from gensim2.core.foreign.library import read_by_library
from gensim2.core.foreign.tree import ForeignTree
from gensim2.core.progress import Progress
from gensim2.core.record_files import parse_record, read_record
from gensim2.data.dataset import DataSet
from gensim2.data.episode_file import read_recording
from gensim2.data.record import DatasetRecord
from gensim2.data.recorded import MAX_STEPS, check_recording
from gensim2.data.runfolder import TaskFolder
from gensim2.data.store import LAST_INDEX, ROWS, TaskStore
from gensim2.data.trajectory import H5_NAME, JSON_NAME
from gensim2.rollout.episode_log import log_line
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import Recording
from gensim2.tasks.library import strategies_of
from gensim2.tasks.parse import parse_task

REMEDY = "give a folder that `gensim2 data export` wrote"

_EPISODE = TypeAdapter(Episode)

Index = Annotated[int, Field(ge=0, le=LAST_INDEX)]


class _Origin(BaseModel):
    model_config = ConfigDict(strict=True)

    task: dict[str, Any]
    strategies: dict[str, dict[str, Any]]
    dataset: DatasetRecord
    indices: Annotated[list[Index], Field(min_length=1)]


class _Reset(BaseModel):
    model_config = ConfigDict(strict=True)

    options: dict[str, Any]


class _Entry(BaseModel):
    model_config = ConfigDict(strict=True)

    episode_seed: int
    control_mode: str
    elapsed_steps: Annotated[int, Field(ge=1, le=MAX_STEPS)]
    reset_kwargs: _Reset
    instances: dict[str, str]
    episode: dict[str, Any]


class _Trajectory(BaseModel):
    model_config = ConfigDict(strict=True)

    gensim2: _Origin
    episodes: list[_Entry]


def take_apart(tree: ForeignTree, sizes: Mapping[str, int], out: Path, progress: Progress) -> None:
    """Convert exported trajectories back to a data set in the folder ``out``.

    Args:
        sizes: size of each file in the export, bytes, by path.

    Raises:
        InputError: a file cannot be used; the message names the file and the episode.
    """
    names = [name.split("/")[0] for name in sizes if name.count("/") == 1 and name.endswith(f"/{JSON_NAME}")]
    if not names:
        raise InputError(f"holds no */{JSON_NAME}", file=tree.path, remedy=REMEDY)
    record: DatasetRecord | None = None
    for name in sorted(names):
        file = tree.path / name / JSON_NAME
        document = read_record(tree.inside(f"{name}/{JSON_NAME}"), _Trajectory, REMEDY)
        record = record or document.gensim2.dataset
        _check(document, record, name, file)
        _write_task(document, TaskStore(out / name), tree, progress)
    assert record is not None
    if set(names) != set(record.tasks):
        missing = sorted(set(record.tasks) ^ set(names))[0]
        wrong = f"the list of tasks and the folders of tasks do not match: {missing} occurs in only one of the two"
        raise InputError(wrong, file=tree.path, remedy=REMEDY)
    DataSet(out, record).save()


def _check(document: _Trajectory, record: DatasetRecord, name: str, file: Path) -> None:
    origin = document.gensim2

    def wrong(message: str, field: str, remedy: str | None = REMEDY) -> InputError:
        return InputError(message, file=file, field=f"gensim2.{field}", remedy=remedy)

    if record != origin.dataset:
        raise wrong("the task belongs to a different data set from the tasks read before", "dataset", None)
    if len(origin.indices) != len(document.episodes):
        counts = f"has {len(origin.indices)} entries, but the list 'episodes' has {len(document.episodes)}"
        raise wrong(counts, "indices")
    if any(later <= earlier for earlier, later in zip(origin.indices, origin.indices[1:], strict=False)):
        raise wrong("each episode index must be larger than the index before it", "indices")
    spec = parse_task(origin.task, str(file))
    if spec.name != name:
        raise wrong(f"the task is named {spec.name!r}, but its folder is named {name!r}", "task.name", None)
    if set(origin.strategies) != set(strategies_of(spec)):
        other = sorted(set(origin.strategies) ^ set(strategies_of(spec)))[0]
        raise wrong(f"the strategies do not match the task: {other!r} occurs in only one of the two", "strategies")


def _write_task(document: _Trajectory, store: TaskStore, tree: ForeignTree, progress: Progress) -> None:
    origin, source = document.gensim2, tree.path / store.name
    files = TaskFolder(store.folder)
    files.write_task(parse_task(origin.task, str(source / JSON_NAME)))
    files.write_strategies(origin.strategies)
    progress.start(f"import {store.name}", len(document.episodes))
    rows = []
    for index, episode, recording in _episodes(tree, store.name, document):
        rows.append(episode.at(index, store.add(index, episode, recording)))
        progress.advance()
    with replacing(store.folder / ROWS) as file, file.open("wb") as stream:
        stream.writelines(log_line(row) for row in rows)


def _episodes(tree: ForeignTree, name: str, document: _Trajectory) -> Iterator[tuple[int, Episode, Recording]]:
    path, origin = tree.path / name / H5_NAME, document.gensim2
    with read_by_library(path, REMEDY):
        file = h5py.File(tree.inside(f"{name}/{H5_NAME}"), "r")
    with file:
        for number, (index, entry) in enumerate(zip(origin.indices, document.episodes, strict=True)):
            at = f"episodes.{number}.episode"
            content = json.dumps(entry.episode).encode()
            episode = parse_record(content, _EPISODE, tree.path / name / JSON_NAME, REMEDY, at)
            recorded = {
                "seed": entry.episode_seed,
                "control_mode": entry.control_mode,
                "reset_options": entry.reset_kwargs.options,
                "instances": entry.instances,
            }
            with read_by_library(path, REMEDY, f"episode {number} cannot be read"):
                recording = read_recording(group_in(file, f"traj_{number}"), recorded)
            check_recording(recording, episode, path, f"episode {number}")
            yield index, episode, recording
