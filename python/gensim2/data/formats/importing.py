"""Import exported data sets.

A ManiSkill export stores complete episodes in its trajectories. A LeRobot or zarr export stores frames and, in a
subfolder, the original episodes. The import compares these episodes with the frames and copies them.

An export may be untrusted. Therefore its files are compared with its manifest and parsed in a process with limited
memory, and the resulting episodes are counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gensim2.core.errors import InputError, WriteError
from gensim2.core.files import new_folder
from gensim2.core.foreign.process import Bounds, isolated
from gensim2.core.foreign.tree import ForeignTree
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.dataset import DataSet
from gensim2.data.formats.columns import formerly_nested
from gensim2.data.formats.export import NATIVE, check_apart
from gensim2.data.formats.frames import EPISODE_COLUMNS, Frames, frames_of
from gensim2.data.formats.manifest import Format, check_format, check_manifest
from gensim2.data.formats.native import copy_native, read_back
from gensim2.data.formats.to_lerobot import lerobot_frames
from gensim2.data.formats.trajectory_reading import take_apart
from gensim2.data.formats.zarr_reading import zarr_frames
from gensim2.robots import robot

REMEDY = "give a folder that `gensim2 data export` wrote"

PRELOAD = ("gensim2.data.formats.importing", "zarr")


def import_(path: Path, out: Path, of: Format, *, progress: Progress = NULL_PROGRESS) -> int:
    """Make a data set from an export of :func:`~gensim2.data.formats.export.export` and return the number of episodes.

    Imported episodes are byte-identical. Observations are not imported; :func:`~gensim2.data.rendering.render` adds
    them again. A subprocess reads the episodes, so a script must call this function below ``if __name__ ==
    "__main__":``.

    Args:
        path: folder of the export.
        out: new or empty folder of the data set.
        of: format of the export: ``"maniskill"``, ``"lerobot"`` or ``"zarr"``.

    Raises:
        InputError: a folder or file cannot be used, or the frames do not match the episodes.
        WriteError: the disk is full, or the folder cannot be written to.
        MissingExtraError: the format's library is not installed.
    """
    check_apart(path, out, "the export")
    with new_folder(out) as folder:
        sizes = ForeignTree(path).sizes()
        bounds = Bounds.of(sum(sizes.values()))
        return isolated(read_export, (path, folder, of), path, bounds, progress, PRELOAD)


def read_export(path: Path, folder: Path, of: Format, progress: Progress) -> int:
    """Import an export into an existing folder in this process, and return the number of episodes."""
    try:
        return _read(path, folder, of, progress)
    except WriteError:
        raise
    except InputError as error:
        if error.file is None or not Path(error.file).is_relative_to(folder):
            raise
        there = path if of == "maniskill" else path / NATIVE
        file = there / Path(error.file).relative_to(folder)
        raise InputError(error.message, file=file, field=error.field, remedy="export again") from error


def _read(path: Path, folder: Path, of: Format, progress: Progress) -> int:
    tree = ForeignTree(path)
    sizes = tree.sizes()
    check_format(path, sizes, of)
    if of != "maniskill" and not (path / NATIVE).is_dir():
        raise InputError(f"has no folder {NATIVE}/ with the states", file=path, remedy=REMEDY)
    manifest = check_manifest(path, sizes)
    if manifest is None:
        progress.message(f"{path} was exported by an older gensim2: its point clouds and images cannot be compared")
    if any(formerly_nested(name.split("/")[1]) for name in sizes if name.startswith("data/")):
        progress.message(f"{path} has old camera names (image_cameras/left), which are read as image_left")
    if of == "maniskill":
        take_apart(tree, sizes, folder, progress)
        count = sum(1 for _ in read_back(DataSet.open(folder), progress))
    else:
        copy_native(path / NATIVE, folder)
        theirs = lerobot_frames(path) if of == "lerobot" else zarr_frames(path)
        count = _compare(DataSet.open(folder), theirs, path, progress)
    if manifest is not None and manifest.episodes != count:
        wrong = f"holds {count} episodes, of which {manifest.episodes} were exported"
        raise InputError(wrong, file=path, remedy="export again")
    if not count:
        raise InputError("holds no episode", file=path, remedy=REMEDY)
    return count


def _compare(dataset: DataSet, found: Iterator[Frames], path: Path, progress: Progress) -> int:
    """Compare an export's frames with its original episodes and return the number of episodes."""
    profile = robot(dataset.record.scene.robot)
    count, observed = 0, dict[str, None]()
    for store, row, stored in read_back(dataset, progress):
        assert stored.recording is not None  # episodes that were read have a recording
        theirs = next(found, None)
        try:
            ours = frames_of(stored.recording, profile, store.spec().description)
        except InputError as error:
            file = store.path(row.index)
            raise InputError(error.message, file=path / NATIVE / store.name / file.name, field=error.field) from error
        if theirs is None or (wrong := _difference(ours, theirs)):
            said = (
                "has no frames in the export" if theirs is None else f"differs from the original in {NATIVE}/ ({wrong})"
            )
            problem = f"episode {count} {said}; a file of the export was changed or removed after the export"
            raise InputError(problem, file=path, remedy="export again")
        count += 1
        observed |= dict.fromkeys(name for name in theirs.columns if name not in ours.columns)
    if next(found, None) is not None:
        wrong = (
            f"episode {count} is missing from {NATIVE}/, which has {count} episodes, so the exported files or the "
            f"original in {NATIVE}/ were changed"
        )
        raise InputError(wrong, file=path, remedy="export again")
    if observed:
        progress.message(
            f"the observations of {path} ({', '.join(observed)}) are not imported: `gensim2 render` adds observations "
            "to the imported data set"
        )
    return count


def _difference(ours: Frames, theirs: Frames) -> str | None:
    """Return the first part in which two episodes differ, or None. Only the number of clouds and images is compared."""
    if ours.sentence != theirs.sentence:
        return "the sentence"
    for name in EPISODE_COLUMNS:
        values = ours.columns[name]
        other = theirs.columns.get(name)
        if other is None or other.dtype != values.dtype or not np.array_equal(other, values):
            return name
    steps = len(ours.columns["action"])
    return next((name for name, values in theirs.columns.items() if len(values) != steps), None)
