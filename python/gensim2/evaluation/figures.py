"""From the JSON of ``gensim2 benchmark`` to the rows of ``figures.json``: counted anew from the episodes it holds."""

from __future__ import annotations

from pathlib import Path
from statistics import mean, pstdev
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, Field

from gensim2.errors import InputError
from gensim2.record_files import read_record
from gensim2.rollout.config import RolloutOptions, nested_options
from gensim2.rollout.record import Episode
from gensim2.rollout.tally import Tally
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.figures import Condition, Figure

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


def rows_of(path: Path) -> list[Figure]:
    """Return a row for each task of a benchmark; what the file itself says of rates is not looked at.

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
        rows.append(_row(task, Condition(**condition), given))
    return rows


def _row(task: _Row, condition: Condition, given: _Arguments) -> Figure:
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
    )
