"""Strategies of a task as plain data, by name and by step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gensim2.tasks.spec import TaskSpec

Strategies = dict[str, dict[str, Any]]
"""Strategies by name, as plain data: what stands in ``strategies/<name>.yaml``."""


StepStrategies = Mapping[str, Strategies]
"""For each step of a task its strategies by name, in order of preference."""


def with_strategies(task: TaskSpec, ways: StepStrategies) -> TaskSpec:
    """Return the task with each step's strategies named as in ``ways``; its provenance tells of no others."""
    steps = tuple(step.model_copy(update={"strategies": tuple(ways[step.name])}) for step in task.steps)
    provenance = task.provenance
    if provenance is not None:
        named = {name for step in steps for name in step.strategies}
        kept = {name: made for name, made in provenance.strategies.items() if name in named}
        provenance = provenance.model_copy(update={"strategies": kept})
    return task.model_copy(update={"steps": steps, "provenance": provenance})
