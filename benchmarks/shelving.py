"""Designed and kept tasks of a run, as a shelf of the package: ``gensim2/tasks/designed``."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic, write_json
from gensim2.core.record_files import read_record
from gensim2.core.yaml_files import dump_yaml
from gensim2.data.records import RunRecord
from gensim2.data.runfolder import RUN_JSON, TaskFolder
from gensim2.design.remembering import verified
from gensim2.tasks.library import (
    PAPER,
    STRATEGIES,
    TASK_FILE,
    load_strategies_beside,
    load_task,
    load_task_file,
    origin_of,
    shared_strategy,
    task_names,
)
from gensim2.tasks.likeness import first_alike
from gensim2.tasks.spec import DESIGNED, TaskSpec

MADE_JSON = "made.json"
"""Beside the tasks: arguments of the run, proposals that were tried, CPU and wall seconds."""


@dataclass(frozen=True)
class Shelved:
    """Outcome for the tasks that a run kept.

    Attributes:
        tasks: names of those that are on the shelf.
        left_out: why the others are not, by name.
    """

    tasks: tuple[str, ...]
    left_out: dict[str, str]


def shelve(run: Path, shelf: Path) -> Shelved:
    """Make a shelf anew of what a run designed and kept; what the paper's suite has already is left out.

    Strategies that the suite shares stay there; those that several tasks have in common lie in ``strategies/`` beside
    them.

    Args:
        run: folder of ``gensim2 run-pipeline``.
        shelf: folder; what is in it goes, but for Python files.

    Raises:
        InputError: there is no such run, or a file of it cannot be used.
    """
    path = run / RUN_JSON
    if not path.is_file():
        raise InputError("contains no run", file=run, remedy="give the output folder of gensim2 run-pipeline")
    record = read_record(path, RunRecord, "restore the file")
    seed = record.arguments["seed"]
    suite = [load_task(name) for name in task_names(PAPER)]
    taken = {task.name for task in suite}
    kept: dict[str, tuple[TaskSpec, Mapping[str, Any]]] = {}
    left_out: dict[str, str] = {}
    for folder in sorted((run / "tasks").glob("*/")):
        if not (folder / TASK_FILE).is_file() or (found := TaskFolder(folder).verification()) is None:
            continue  # under way
        task = load_task_file(folder)
        if not found.kept or task.provenance is None or origin_of(task) == PAPER:
            continue
        if task.name in taken:
            left_out[task.name] = "the suite has one of this name"
            continue
        if (alike := first_alike(task, suite)) is not None:
            left_out[task.name] = f"it {alike[1]} as {alike[0].name}"
            continue
        provenance = task.provenance.model_copy(update={"verification": verified(found, seed)})
        task = task.model_copy(update={"provenance": provenance})
        kept[task.name] = task, load_strategies_beside(folder, task)
    _write(shelf, kept)
    write_json(shelf / MADE_JSON, _made(record))
    return Shelved(tuple(kept), left_out)


def _made(record: RunRecord) -> dict[str, Any]:
    """Return the record of a run: its arguments and its cost."""
    asked = {name: record.arguments[name] for name in ("single", "long", "verify", "from_empty", "seed", "assets")}
    return {
        "schema_version": 1,
        "arguments": asked,
        "versions": record.versions,
        "tried": len(record.effort),
        "cpu_s": round(sum(effort.cpu_s for effort in record.effort.values())),
        "wall_s": round(sum(effort.wall_s for effort in record.effort.values())),
    }


def _write(shelf: Path, kept: Mapping[str, tuple[TaskSpec, Mapping[str, Any]]]) -> None:
    for folder in shelf.glob("*/"):
        shutil.rmtree(folder)
    texts = Counter((name, dump_yaml(data)) for _, own in kept.values() for name, data in _own(own))
    common: dict[str, str] = {}
    for (name, text), count in texts.most_common():
        # Steps without strategies name ``DESIGNED`` by default; a shared file of this name would serve all of them.
        if count > 1 and name != DESIGNED:
            common.setdefault(name, text)
    for name, text in common.items():
        write_atomic(shelf / STRATEGIES / f"{name}.yaml", text)
    for task, own in kept.values():
        folder = shelf / task.name
        write_atomic(folder / TASK_FILE, dump_yaml(task.model_dump(mode="json", exclude_none=True)))
        for name, data in _own(own):
            if common.get(name) != (text := dump_yaml(data)):
                write_atomic(folder / STRATEGIES / f"{name}.yaml", text)


def _own(strategies: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Those that the suite does not share under the same name."""
    return [(name, data) for name, data in strategies.items() if not _is_shared(name, data)]


def _is_shared(name: str, data: Any) -> bool:
    try:
        return bool(shared_strategy(name) == data)
    except InputError:
        return False
