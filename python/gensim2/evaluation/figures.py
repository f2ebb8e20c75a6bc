"""From the JSON of ``gensim2 benchmark`` to the rows of ``figures.json``: counted anew from the episodes it holds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import mean, pstdev
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, Field

from gensim2.errors import InputError
from gensim2.evaluation.benchmark_table import by_instance
from gensim2.record_files import read_record
from gensim2.rollout.config import RolloutOptions, nested_options
from gensim2.rollout.record import Episode
from gensim2.rollout.tally import Tally
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.figures import Condition, Figure, Source, Verdicts

_REMEDY = "give a file that `gensim2 benchmark --json FILE` wrote"


class _Arguments(BaseModel):
    seed: int
    runs: Annotated[int, Field(ge=1)]
    episodes: Annotated[int, Field(ge=1)]
    instances: str
    scene: SceneOptions
    rollout: RolloutOptions


class _Row(BaseModel):
    name: str
    records: list[Episode]


class _Document(BaseModel):
    arguments: Annotated[_Arguments, BeforeValidator(nested_options)]
    tasks: list[_Row]
    provenance: Source | None = None


def rows_of(path: Path) -> list[Figure]:
    """Return a row for each task of a benchmark; what the file itself says of rates is not looked at.

    Raises:
        InputError: as :func:`rows_with_episodes`.
    """
    return [row for row, _ in rows_with_episodes(path)]


def rows_with_episodes(path: Path) -> list[tuple[Figure, list[Episode]]]:
    """Return a row for each task of a benchmark, and the episodes that it counts.

    Raises:
        InputError: it is no such file, or a task's episodes are not as many as its arguments say.
    """
    document = read_record(path, _Document, _REMEDY)
    given = document.arguments
    condition: dict[str, Any] = {
        **given.scene.to_record(),
        **given.rollout.to_record(),
        "instances": given.instances,
        "objects": "generated" if given.scene.assets == "builtin" else "real",
    }
    del condition["assets"]
    rows = []
    for task in document.tasks:
        if len(task.records) != given.runs * given.episodes:
            message = f"{task.name} has {len(task.records)} episodes, not {given.runs} x {given.episodes}"
            raise InputError(message, file=path, field="tasks", remedy=_REMEDY)
        rows.append((_row(task, Condition(**condition), given, document.provenance), task.records))
    if document.provenance is None or not rows:
        return rows
    # The command without the folders of whoever ran it.
    command = " ".join(("gensim2", *command_of([row for row, _ in rows], "OBJECTS")))
    source = document.provenance.model_copy(update={"command": command})
    return [(row.model_copy(update={"source": source}), episodes) for row, episodes in rows]


def _row(task: _Row, condition: Condition, given: _Arguments, source: Source | None) -> Figure:
    tally = Tally.of(task.records)
    runs = [task.records[run * given.episodes : (run + 1) * given.episodes] for run in range(given.runs)]
    return Figure(
        task=task.name,
        condition=condition,
        seed=given.seed,
        runs=given.runs,
        episodes=tally.episodes,
        **tally.verdicts(),
        deviation=pstdev(mean(episode.paper for episode in run) for run in runs),
        partial=tally.partial,
        causes=tally.causes,
        strict_misses=tally.strict_misses,
        objects=tally.objects,
        instances={name: Verdicts(**counts) for name, counts in by_instance(task.records).items()},
        source=source,
    )


def command_of(rows: Sequence[Figure], assets: str | None) -> list[str]:
    """Words of the ``gensim2 benchmark`` that makes rows anew: of one condition, seed and number of episodes.

    Args:
        rows: one a task.
        assets: folder of the real objects; None where the rows are of generated ones.

    Raises:
        InputError: the rows are of real objects and there is no folder.
    """
    first, condition = rows[0], rows[0].condition
    if condition.objects == "real" and assets is None:
        raise InputError("these figures are of real objects", field="assets", remedy="name their folder")
    given = {
        "--runs": first.runs,
        "--episodes": first.episodes // first.runs,
        "--seed": first.seed,
        "--assets": "builtin" if condition.objects == "generated" else assets,
        "--physics": condition.physics,
        "--robot": condition.robot,
        "--instances": condition.instances,
        "--randomization": condition.randomization,
        "--attempts": condition.attempts,
        "--disturb": condition.disturbance,
        "--method": "one-plan" if condition.one_plan else "chain",
    }
    words = [word for name, value in given.items() if value is not None for word in (name, str(value))]
    return ["benchmark", *(row.task for row in rows), *words, *(["--open-loop"] if condition.open_loop else [])]


def made_together(rows: Sequence[Figure]) -> list[list[Figure]]:
    """Rows in groups that one command makes, in the order in which the first of each stands."""
    found: dict[tuple[Condition, int, int, int], list[Figure]] = {}
    for row in rows:
        found.setdefault((row.condition, row.seed, row.runs, row.episodes), []).append(row)
    return list(found.values())


LOW = 0.5
"""Share of episodes that hold below which the page sets an instance in bold."""


def page_by_instance(rows: Sequence[Figure]) -> str:
    """HTML that draws each row by the objects that its episodes were run with; rows without them are counted."""
    from gensim2.pages import template  # here: rows are read without it

    known = [row for row in rows if row.instances]
    values = {"rows": known, "without": len(rows) - len(known), "low": LOW}
    return template("gensim2.evaluation", "instances.html.j2").render(values)
