"""Describe a task for ``gensim2 tasks show`` and for HTML pages."""

from __future__ import annotations

from typing import Any

from gensim2.objects import Library
from gensim2.rollout.tally import interval
from gensim2.tasks.criteria import Criterion
from gensim2.tasks.figures import Figure, figures_of
from gensim2.tasks.library import load_strategies, load_task, packaged_names
from gensim2.tasks.published import paper_of, released_of
from gensim2.tasks.spec import HAND, Step, TaskSpec
from gensim2.tasks.strategies import Strategies
from gensim2.tasks.wording import criteria_in_words, name_in_words, place_in_words, randomization_in_words

VERDICTS = ("paper", "held", "strict")


def description_of(task: TaskSpec, strategies: Strategies, library: Library) -> dict[str, Any]:
    """Return a task's objects, steps, strategies and goal in words, with its measured success rates.

    Success rates are included only if the task and its strategies equal those in gensim2's own task library.

    Args:
        task: task to describe.
        strategies: strategies by name, as plain data.
        library: object library, which says which objects have joints.
    """
    return {
        "name": task.name,
        "type": "single-step" if task.is_single_step else "long-horizon",
        "description": task.description,
        **_provenance(task),
        "env_id": task.env_id if task.name in packaged_names() else None,
        "max_episode_steps": task.max_episode_steps,
        "objects": [
            {
                "name": name,
                "class": thing.asset_class,
                "place": place_in_words(thing),
                "randomization": randomization_in_words(thing, with_joint=_has_joint(task, name, library)),
            }
            for name, thing in task.objects.items()
        ],
        "steps": [_step(task, step, strategies) for step in task.steps],
        "goal": criteria_in_words(task.success),
        "goal_criteria": _as_data(task.success),
        "figures": _figures(task, measured=_is_stored(task, strategies)),
    }


def _provenance(task: TaskSpec) -> dict[str, Any]:
    told = None if task.provenance is None else task.provenance.model_dump(mode="json")
    return {name: None if told is None else told[name] for name in ("origin", "prompts", "verification")}


def _is_stored(task: TaskSpec, strategies: Strategies) -> bool:
    """Return whether the task library has the same task and strategies, so that the stored success rates apply."""
    if task.name not in packaged_names():
        return False
    return task == load_task(task.name) and dict(strategies) == load_strategies(task.name)


def _has_joint(task: TaskSpec, name: str, library: Library) -> bool:
    """Return whether an object has a joint; if ``library`` lacks its class, infer this from the task's criteria."""
    asset_class = task.objects[name].asset_class
    if asset_class in library.classes():
        return library.kind(asset_class) == "articulated"
    criteria = [criterion for step in task.steps for criterion in step.done] + list(task.goal or ())
    return any(
        name in each.objects if each.type.startswith("articulated_") else getattr(each, "articulated", None) == name
        for each in criteria
    )


def _step(task: TaskSpec, step: Step, strategies: Strategies) -> dict[str, Any]:
    made = {} if task.provenance is None else task.provenance.strategies
    return {
        "name": name_in_words(step.name),
        "object": step.object,
        "tool": None if step.tool == HAND else step.tool,
        "done": criteria_in_words(step.done),
        "done_criteria": _as_data(step.done),
        "strategies": [
            {
                "name": name,
                "kind": "grasp" if "grasp" in strategies[name] else "solver config",
                "by": made[name].by if name in made else None,
                "seen": made[name].seen if name in made else None,
            }
            for name in step.strategies
        ],
    }


def _as_data(criteria: tuple[Criterion, ...]) -> list[dict[str, Any]]:
    return [criterion.model_dump(mode="json") for criterion in criteria]


def _figures(task: TaskSpec, *, measured: bool) -> dict[str, Any]:
    """Return the known success rates of a task: of the paper, of the released code and, with ``measured``, our own."""
    published, released = paper_of(task), released_of(task)
    return {
        "paper": None if published is None else {"mean": published[0], "deviation": published[1]},
        "original": None if released is None else {"successes": released[0], "episodes": released[1]},
        "measured": [_measured(row) for row in figures_of(task.name)] if measured else [],
    }


def _measured(row: Figure) -> dict[str, Any]:
    return {
        **row.model_dump(mode="json", exclude={"task"}),
        "is_plain": row.condition.is_plain,
        "in_words": row.condition.in_words,
        "rates": {
            verdict: {"mean": count / row.episodes, "interval": list(interval(count, row.episodes))}
            for verdict, count in ((verdict, getattr(row, verdict)) for verdict in VERDICTS)
        },
    }
