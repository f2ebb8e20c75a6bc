"""Define two types that hold a task's strategies as JSON data. ``Strategies`` maps the name of a strategy to its
content, and ``StepStrategies`` maps the name of a step to the strategies of the step.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gensim2.tasks.spec import TaskSpec

Strategies = dict[str, dict[str, Any]]
"""Strategies by name, with the content of ``strategies/<name>.yaml`` as plain data."""


StepStrategies = Mapping[str, Strategies]
"""Strategies by name for each step of a task, in order of preference."""


def with_strategies(task: TaskSpec, ways: StepStrategies) -> TaskSpec:
    """Return a copy of a task with other strategies.

    Args:
        task: task to copy.
        ways: strategies for each step. The copy names these strategies, and its provenance keeps only their entries.
    """
    steps = tuple(step.model_copy(update={"strategies": tuple(ways[step.name])}) for step in task.steps)
    provenance = task.provenance
    if provenance is not None:
        named = {name for step in steps for name in step.strategies}
        kept = {name: made for name, made in provenance.strategies.items() if name in named}
        provenance = provenance.model_copy(update={"strategies": kept})
    return task.model_copy(update={"steps": steps, "provenance": provenance})
