"""Count how often the success criteria of a task wrongly say that the task is done.

The criteria are evaluated in mutated worlds: copies of a successful end state in which one thing was changed so that
the task is not done. :mod:`gensim2.rollout.mutated` builds these worlds and evaluates the criteria.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Annotated, Any, ClassVar

from pydantic import ConfigDict, Field

LARGEST_ERROR = 0.01
"""Largest share of mutated worlds in which the criteria of a task may say success."""


class Mutation(StrEnum):
    """Kind of change to a successful end state. After the change the task is not done."""

    NOTHING = "nothing was done"
    """The arm does nothing in the whole episode (the no-op baseline)."""
    AT_START = "it was left where it was"
    """The joint, or the object, is where it was before the step, at least ``FAR`` from the wanted openness."""
    A_LITTLE = "it was moved only a little"
    """The joint went a quarter of the way, or the object is ``SLIGHTLY`` above the table."""
    WRONG_WAY = "it was moved the wrong way"
    """The joint is at another end than wanted, or the object went in another direction."""
    WRONG_OBJECT = "another object was moved instead"
    """The object is where it was before the step; another object is where it should be."""
    BESIDE = "it lies beside the goal"
    """The object stands on the table, with a gap of ``APART`` to the outline of its goal seen from above."""
    ON_TOP = "it lies on top of the closed container"
    """The container is closed, and the object was put from above on the highest point of the container."""
    IN_THE_AIR = "the hand holds it in the air over the goal"
    """The lowest point of the object is ``ABOVE`` the highest point of the goal."""
    GOAL_MOVED = "the goal was put on top of it"
    """The object stands where it was; the support that it should be put on is on top of it."""
    ON_THE_TABLE = "it was slid along the table or tipped over"
    """The object to be lifted lies on the table."""
    LEFT_OUT = "the step was left out"
    """The state that the step should bring about never existed in the episode."""
    HAND_AWAY = "the hand did not reach it"
    """The hand is at its start, ``HAND_ABOVE`` over the object, or at another object."""


DONE = "done"
"""The successful end state itself. Unless the criteria recognize it, they also reject its mutations without merit."""


@dataclass(frozen=True)
class WorldCount:
    """Number of mutated worlds of one kind, and number of these worlds in which the success criteria are wrongly true.

    A mutated world is a successful end state in which one thing was changed so that the task is not done.

    Attributes:
        step: step whose criteria ``done`` are evaluated. None: the criteria of the task's goal are evaluated.
        mutation: value of a :class:`Mutation`, or ``DONE`` for worlds in which the task is done.
        subject: name of the object that was changed; empty for worlds in which the arm did nothing.
        criteria: types of the criteria about this object.
        fooled: number of these worlds in which all criteria are true.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    step: str | None
    mutation: str
    subject: str
    criteria: tuple[str, ...]
    worlds: Annotated[int, Field(ge=1)]
    fooled: Annotated[int, Field(ge=0)]


@dataclass(frozen=True)
class CheckerResult:
    """Counts of the worlds in which the success criteria of a task were right or wrong.

    Attributes:
        scenes: number of scenes.
        counts: counts of the worlds by kind.
    """

    scenes: int
    counts: tuple[WorldCount, ...]

    @staticmethod
    def of(scenes: Sequence[Sequence[WorldCount]]) -> CheckerResult:
        """Return the result of several scenes, with the counts of each kind of mutated world added up."""
        worlds: Counter[tuple[str | None, str, str, tuple[str, ...]]] = Counter()
        fooled: Counter[tuple[str | None, str, str, tuple[str, ...]]] = Counter()
        for each in (count for scene in scenes for count in scene):
            key = (each.step, each.mutation, each.subject, each.criteria)
            worlds[key] += each.worlds
            fooled[key] += each.fooled
        return CheckerResult(len(scenes), tuple(WorldCount(*key, worlds[key], fooled[key]) for key in worlds))

    @property
    def of_goal(self) -> tuple[WorldCount, ...]:
        """Counts of the mutated worlds in which the goal was judged."""
        return tuple(each for each in self.counts if each.step is None and each.mutation != DONE)

    @property
    def of_steps(self) -> tuple[WorldCount, ...]:
        """Counts of the mutated worlds in which the criteria of a step were judged."""
        return tuple(each for each in self.counts if each.step is not None and each.mutation != DONE)

    @property
    def recognized(self) -> tuple[int, int]:
        """Number of successful end states in which the goal holds, and number of all successful end states."""
        return total([each for each in self.counts if each.step is None and each.mutation == DONE])

    @property
    def error(self) -> float:
        """Fraction of the mutated worlds in which the goal's criteria hold, although the task is not done."""
        fooled, worlds = total(self.of_goal)
        return fooled / worlds if worlds else 0.0

    @property
    def passes(self) -> bool:
        """Whether the error is at most ``LARGEST_ERROR``."""
        return self.error <= LARGEST_ERROR

    @property
    def reason(self) -> str:
        """Sentence on the kinds of mutated worlds in which criteria are wrongly true, most frequent first.

        The sentence may be empty.
        """
        wrong = sorted((each for each in self.of_goal if each.fooled), key=lambda each: -each.fooled)
        if not wrong:
            return ""
        fooled, worlds = total(self.of_goal)
        told = [
            f"{each.subject + ': ' if each.subject else ''}{each.mutation} ({each.fooled} of {each.worlds}; "
            f"{', '.join(each.criteria)})"
            for each in wrong[:4]
        ]
        return (
            f"the success criteria hold in {fooled} of {worlds} worlds in which the task is not done "
            f"(at most {LARGEST_ERROR:.0%} may): {'; '.join(told)}"
        )

    def summary(self) -> dict[str, Any]:
        """Return the totals as JSON data, without the counts for each mutation.

        The totals are the numbers of scenes and of mutated worlds, the number and the fraction of mutated worlds in
        which the goal wrongly holds, the number of successful end states, and the number of these in which the goal
        holds.
        """
        fooled, worlds = total(self.of_goal)
        done, built = self.recognized
        return {
            "scenes": self.scenes,
            "worlds": worlds,
            "fooled": fooled,
            "error": round(self.error, 4),
            "recognized": done,
            "built": built,
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON data."""
        return {**self.summary(), "counts": [asdict(each) for each in self.counts]}


def total(counts: Iterable[WorldCount]) -> tuple[int, int]:
    """Return the number of worlds in which the criteria hold, and the number of all worlds."""
    given = list(counts)
    return sum(each.fooled for each in given), sum(each.worlds for each in given)
