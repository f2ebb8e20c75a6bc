"""Export tasks of a library: one folder for each task, in a common folder or in a zip archive."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from gensim2.core.errors import InputError
from gensim2.core.files import replacing, write_atomic
from gensim2.core.yaml_files import dump_yaml
from gensim2.tasks.library import STRATEGIES, TASK_FILE, StrategyData, load_strategies, load_task
from gensim2.tasks.spec import TaskSpec

#: Fixed time stamp of archive members, so that the same tasks give the same bytes.
_NO_TIME = (1980, 1, 1, 0, 0, 0)


def export(names: Sequence[str], out: Path) -> None:
    """Write tasks with all their strategies to a folder or a ``.zip`` file, which can then serve as a task library.

    Args:
        names: names of tasks from any library.
        out: a new or empty folder, or a file whose name ends in ``.zip``.

    Raises:
        InputError: a task does not exist, ``out`` exists and is not empty, or ``out`` cannot be written.
    """
    tasks = [(load_task(name), load_strategies(name)) for name in dict.fromkeys(names)]
    try:
        if out.exists() and (out.is_file() or any(out.iterdir())):
            raise InputError("already exists", file=out, remedy="choose another --out")
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror}", file=out) from error
    if out.suffix == ".zip":
        with replacing(out) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            for task, strategies in tasks:
                for path, text in _files(task, strategies).items():
                    archive.writestr(zipfile.ZipInfo(f"{task.name}/{path}", _NO_TIME), text)
        return
    for task, strategies in tasks:
        write_task(out / task.name, task, strategies)


def _files(task: TaskSpec, strategies: Mapping[str, StrategyData]) -> dict[str, str]:
    """Return the texts of the files in a task's folder, by path; task.yaml comes last."""
    found = {f"{STRATEGIES}/{name}.yaml": dump_yaml(dict(data)) for name, data in strategies.items()}
    return {**found, TASK_FILE: dump_yaml(task.model_dump(mode="json", exclude_none=True))}


def write_task(folder: Path, task: TaskSpec, strategies: Mapping[str, StrategyData]) -> None:
    """Write all files of a task into its folder. Each file is written atomically.

    Raises:
        InputError: the folder cannot be written to.
    """
    for path, text in _files(task, strategies).items():
        write_atomic(folder / path, text)
