"""Export a data set to other formats.

An export to LeRobot or zarr has the observations and actions from which policies learn. Its folder ``gensim2/`` has the
original episodes, which are a hundred times smaller. The export can be rendered again, replayed and imported from them.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

from gensim2.core.errors import InputError
from gensim2.core.files import new_folder, replacing
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.card import Described, write_card
from gensim2.data.dataset import DataSet
from gensim2.data.formats.frames import Frames, frames_of
from gensim2.data.formats.manifest import Format, write_manifest
from gensim2.data.formats.replay_zarr import ZarrWriter
from gensim2.data.formats.seen_table import SeenTable
from gensim2.data.formats.to_lerobot import export_lerobot
from gensim2.data.observation_file import ObservedEpisode, read_observation
from gensim2.data.record import DatasetRecord
from gensim2.data.selection import Selection, some
from gensim2.data.store import ROWS, TaskStore
from gensim2.data.trajectory import TrajectoryMetadata, write_trajectory
from gensim2.robots import robot
from gensim2.rollout.episode_log import log_line
from gensim2.rollout.record import Episode
from gensim2.tasks.library import STRATEGIES, TASK_FILE, load_strategies_beside

NATIVE = "gensim2"
"""Folder of the original episodes in an export."""

Chosen = Sequence[tuple[TaskStore, list[Episode]]]


def export(
    path: Path,
    out: Path,
    to: Format,
    selection: Selection | None = None,
    *,
    observations: bool = True,
    assets: Path | str | None = None,
    progress: Progress = NULL_PROGRESS,
) -> int:
    """Export episodes with a data set card and return their number. The export appears only when it is complete.

    Args:
        out: new or empty folder outside the data set.
        to: ``"maniskill"`` (folders that ManiSkill replays), ``"lerobot"`` (v3.0) or ``"zarr"`` (as Diffusion Policy
            reads it).
        selection: filter of the episodes.
        observations: include rendered point clouds and images.
        assets: current folder of the objects, used for ManiSkill and the clearance. None: the recorded folder.

    Raises:
        InputError: an argument or a file cannot be used.
        WriteError: the disk is full, or the folder cannot be written to.
        MissingExtraError: the format's library is not installed.
    """
    dataset = DataSet.open(path, assets)
    check_apart(path, out, "the data set")
    chosen = some(selection or Selection(), dataset, progress)
    count = sum(len(rows) for _, rows in chosen)
    progress.start(f"export to {to}", count)
    with new_folder(out) as folder:
        if to == "maniskill":
            _export_maniskill(dataset, chosen, folder, progress)
        else:
            seen = SeenTable()
            frames = _frames(dataset, chosen, observations, seen, progress)
            if to == "lerobot":
                export_lerobot(frames, folder, robot(dataset.record.scene.robot))
            else:
                _export_zarr(frames, folder)
            _copy_native(dataset, chosen, folder / NATIVE)
            seen.write(folder / NATIVE)
        write_card(dataset, [Described.of(store, rows) for store, rows in chosen], folder, to)
        write_manifest(folder, to, count)
    return count


def check_apart(path: Path, out: Path, what: str) -> None:
    """Check that the output folder ``out`` is outside the input folder ``path``.

    Raises:
        InputError: ``out`` is the input folder or lies inside the input folder.
    """
    if Path(os.path.realpath(out)).is_relative_to(os.path.realpath(path)):
        raise InputError(f"lies in {what}", file=out, remedy="choose another folder with --out")


def _export_maniskill(dataset: DataSet, chosen: Chosen, out: Path, progress: Progress) -> None:
    record = _record(dataset, chosen)
    licenses = {name: used.license for name, used in record.objects.items()}
    for store, rows in chosen:
        spec = store.spec()
        provenance = TrajectoryMetadata(
            task=spec,
            strategies=load_strategies_beside(store.folder, spec),
            assets=dataset.assets,
            licenses=licenses,
            seed=record.seed,
            environment=record.scene.environment,
            details={"versions": record.versions, "dataset": record.model_dump(), "indices": [r.index for r in rows]},
        )
        write_trajectory(out / store.name, provenance, [(store.path(row.index), row.episode_digest) for row in rows])
        for _ in rows:
            progress.advance()


def _frames(
    dataset: DataSet, chosen: Chosen, observations: bool, table: SeenTable, progress: Progress
) -> Iterator[Frames]:
    profile = robot(dataset.record.scene.robot)
    seen: set[bool] = set()
    for store, rows in chosen:
        sentence = store.spec().description
        for row in rows:
            recording = store.recording(row)
            observation = _observed(store, row) if observations else None
            seen.add(observation is not None)
            if len(seen) > 1:
                remedy = "finish `gensim2 render` with --resume, or export with --no-observations"
                raise InputError("only some of the episodes have observations", file=store.folder, remedy=remedy)
            if observation is not None:
                table.add(store.name, row.index, observation)
            if observation is None:
                yield frames_of(recording, profile, sentence)
            else:
                known = observation.is_of_keypoints
                yield frames_of(recording, profile, sentence, observation.arrays, known=known)
            progress.advance()


def _observed(store: TaskStore, row: Episode) -> ObservedEpisode | None:
    path = store.observation_path(row.index)
    return read_observation(path, row.episode_digest) if path.exists() else None


def _export_zarr(episodes: Iterator[Frames], out: Path) -> None:
    with ZarrWriter(out) as writer:
        for frames in episodes:
            writer.add(frames.sentence, frames.columns)


def _copy_native(dataset: DataSet, chosen: Chosen, out: Path) -> None:
    """Copy the selected episodes into a new data set."""
    for store, rows in chosen:
        folder = TaskStore(out / store.name)
        (folder.folder / "episodes").mkdir(parents=True)
        shutil.copyfile(store.folder / TASK_FILE, folder.folder / TASK_FILE)
        shutil.copytree(store.folder / STRATEGIES, folder.folder / STRATEGIES)
        for row in rows:
            shutil.copyfile(store.path(row.index), folder.path(row.index))
        with replacing(folder.folder / ROWS) as path, path.open("wb") as stream:
            stream.writelines(log_line(row) for row in rows)
    DataSet(out, _record(dataset, chosen)).save()


def _record(dataset: DataSet, chosen: Chosen) -> DatasetRecord:
    """Return the contents of ``dataset.json``.

    ``complete`` is true if the export has all episodes of a complete data set.
    """
    record = dataset.record
    tasks = {store.name: record.tasks[store.name] for store, _ in chosen}
    count = sum(len(rows) for _, rows in chosen)
    whole = record.complete and count == record.episodes * len(record.tasks)
    return record.model_copy(update={"tasks": tasks, "complete": whole})
