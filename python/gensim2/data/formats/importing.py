"""From the formats of others back to a data set.

What ManiSkill replays holds everything, and is taken apart again. A LeRobot or zarr folder holds what policies learn
from; the states stand in the episodes that an export lays beside it, and an import makes sure that both say the same.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from pydantic import BaseModel, TypeAdapter

from gensim2.data.attempt_log import LoggedEpisode, log_line
from gensim2.data.episode_file import read_recording
from gensim2.data.formats.export import NATIVE, Format
from gensim2.data.formats.frames import Frames, frames_of
from gensim2.data.formats.replay_zarr import zarr_frames
from gensim2.data.formats.to_lerobot import lerobot_frames
from gensim2.data.record import DatasetRecord
from gensim2.data.runfolder import TaskFolder
from gensim2.data.store import ROWS, DataSet, TaskStore
from gensim2.data.trajectory import H5_NAME, JSON_NAME
from gensim2.errors import InputError
from gensim2.files import new_folder, replacing
from gensim2.progress import NULL_PROGRESS, Progress
from gensim2.record_files import parse_record, read_record
from gensim2.robots import robot
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import Recording
from gensim2.tasks.parse import parse_task

_REMEDY = "give a folder that `gensim2 data export` wrote"
_EPISODE = TypeAdapter(Episode)


class _Origin(BaseModel):
    task: dict[str, Any]
    strategies: dict[str, dict[str, Any]]
    dataset: DatasetRecord
    indices: list[int]


class _Trajectory(BaseModel):
    gensim2: _Origin
    episodes: list[dict[str, Any]]


def import_(path: Path, out: Path, of: Format, *, progress: Progress = NULL_PROGRESS) -> int:
    """Make a data set of what :func:`~gensim2.data.formats.export.export` wrote; return the number of episodes.

    Its episodes are those that were exported, byte for byte.

    Args:
        path: folder of the export.
        out: folder of the data set, which must not hold anything yet.
        of: the format.

    Raises:
        InputError: a folder or a file in it cannot be used, or does not say what the episodes beside it say.
        WriteError: no room is left, or the folder cannot be written to.
        MissingExtraError: the format's library is not installed.
    """
    with new_folder(out) as folder:
        if of == "maniskill":
            return _import_maniskill(path, folder, progress)
        if not (path / NATIVE).is_dir():
            raise InputError(f"holds no {NATIVE}/: the states are not there", file=path, remedy=_REMEDY)
        dataset = DataSet.open(path / NATIVE)
        count = _check(dataset, lerobot_frames(path) if of == "lerobot" else zarr_frames(path), path, progress)
        shutil.copytree(path / NATIVE, folder, dirs_exist_ok=True)
        return count


def _check(dataset: DataSet, found: Iterator[Frames], path: Path, progress: Progress) -> int:
    """Compare an export's frames with the episodes beside it; how many there are.

    Raises:
        InputError: they differ.
    """
    progress.start("compare frames with episodes")
    count = 0
    for ours, theirs in zip_longest(_own(dataset), found):
        same = ours is not None and theirs is not None and ours.sentence == theirs.sentence
        if not same or any(not np.array_equal(theirs.columns[name], each) for name, each in ours.columns.items()):
            message = f"episode {count} is not that of {NATIVE}/: one of them was changed"
            raise InputError(message, file=path, remedy="export again")
        count += 1
        progress.advance()
    return count


def _own(dataset: DataSet) -> Iterator[Frames]:
    profile = robot(dataset.record.scene.robot)
    for name in dataset.tasks:
        store = dataset.task(name)
        sentence = store.spec().description
        for row in store.rows():
            recording = store.read(row).recording
            assert recording is not None
            yield frames_of(recording, profile, sentence)


def _import_maniskill(path: Path, out: Path, progress: Progress) -> int:
    folders = sorted(file.parent for file in path.glob(f"*/{JSON_NAME}"))
    if not folders:
        raise InputError(f"holds no */{JSON_NAME}", file=path, remedy=_REMEDY)
    record: DatasetRecord | None = None
    count = 0
    for folder in folders:
        document = read_record(folder / JSON_NAME, _Trajectory, _REMEDY)
        origin = document.gensim2
        record = record or origin.dataset
        if record != origin.dataset:
            raise InputError("is of another data set than the tasks before it", file=folder, field="gensim2.dataset")
        if len(origin.indices) != len(document.episodes):
            raise InputError("is not as long as episodes", file=folder / JSON_NAME, field="gensim2.indices")
        store = TaskStore(out / folder.name)
        spec = parse_task(origin.task, str(folder / JSON_NAME))
        files = TaskFolder(store.folder)
        files.write_task(spec)
        files.write_strategies(origin.strategies)
        progress.start(f"import {folder.name}", len(document.episodes))
        rows = []
        for index, episode, recording in _episodes(folder, document):
            rows.append(LoggedEpisode.of(episode, index, store.add(index, episode, recording)))
            progress.advance()
        with replacing(store.folder / ROWS) as file, file.open("wb") as stream:
            stream.writelines(log_line(row) for row in rows)
        count += len(rows)
    assert record is not None
    DataSet(out, record).save()
    return count


def _episodes(folder: Path, document: _Trajectory) -> Iterator[tuple[int, Episode, Recording]]:
    try:
        with h5py.File(folder / H5_NAME, "r") as file:
            for number, (index, entry) in enumerate(zip(document.gensim2.indices, document.episodes, strict=True)):
                content = json.dumps(entry.get("episode")).encode()
                episode = parse_record(content, _EPISODE, folder / JSON_NAME, _REMEDY, f"episodes.{number}.episode")
                recorded = {
                    "seed": entry["episode_seed"],
                    "control_mode": entry["control_mode"],
                    "reset_options": entry["reset_kwargs"]["options"],
                    "instances": entry["instances"],
                }
                yield index, episode, read_recording(file[f"traj_{number}"], recorded)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"cannot be read: {error}", file=folder / H5_NAME, remedy=_REMEDY) from error
