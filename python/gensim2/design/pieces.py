"""Known tasks of one joint, as pieces of long tasks."""

from __future__ import annotations

from typing import NamedTuple

from gensim2.design.base import DESIGNED, Brief, Known
from gensim2.design.proposals import joint_goal
from gensim2.objects.words import End, words
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import Strategies

ENDS = ("articulated_open", "articulated_closed")


class Piece(NamedTuple):
    """A known task that brings a joint to one of its ends."""

    asset_class: str
    goal: End
    known: Known


def pieces(brief: Brief) -> list[Piece]:
    """Return the known ones on classes that the library has, the most useful first."""
    goals = [(joint_goal(known.task), known) for known in brief.known]
    found = [
        Piece(goal[0], goal[1], known)  # type: ignore[arg-type]
        for goal, known in goals
        if goal is not None and goal[1] in ENDS and has_joint(brief, goal[0])
    ]
    return sorted(found, key=lambda each: -words(each.asset_class, each.goal).usefulness)


def has_joint(brief: Brief, asset_class: str) -> bool:
    """Return whether the library has a class of this name whose objects have a joint; known tasks may be on others."""
    return asset_class in brief.classes and brief.classes[asset_class].kind == "articulated"


def is_known(brief: Brief, asset_class: str, goal: str) -> bool:
    """Whether there is a piece for this class and goal."""
    return any((each.asset_class, each.goal) == (asset_class, goal) for each in pieces(brief))


def piece_ways(brief: Brief, asset_class: str, goal: str) -> Strategies:
    """Return the strategies by which a known task brings a joint to ``goal``, under telling names; empty where none is
    known."""
    for known in brief.known:
        if joint_goal(known.task) == (asset_class, goal):
            wanted = known.task.steps[0].strategies
            return {_own_name(name, known.task): known.strategies[name] for name in wanted}
    return {}


def _own_name(strategy: str, task: TaskSpec) -> str:
    """A name that no other piece has, where a designer gave none."""
    (thing,) = task.objects.values()
    number = strategy.removeprefix(DESIGNED)
    return f"{task.steps[0].name}_{thing.asset_class}{number}" if number != strategy else strategy
