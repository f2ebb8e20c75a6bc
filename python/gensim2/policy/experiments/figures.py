"""Compute the success rates of an experiment from its evaluation episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, Literal, get_args

from gensim2.rollout.tally import interval

Kind = Literal["seen", "unseen", "real", "opposite", "rephrased", "untaught", "blind"]
"""Kinds of evaluations: on training objects, on unseen objects, on real objects after training on generated objects; on
unseen objects with the opposite instruction and with paraphrases; on tasks outside the training; on unseen objects
without the point cloud.
"""
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class Rate:
    """Success rate, as the number of successful episodes among all episodes.

    Attributes:
        held: number of episodes with the verdict ``held``, which requires that the goal is true at the end, with the
            scene at rest.
    """

    held: int
    episodes: int

    @property
    def mean(self) -> float | None:
        """Success rate; None if there are no episodes."""
        return self.held / self.episodes if self.episodes else None

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson interval of the success rate, which treats the episodes of all tasks as one sample."""
        return interval(self.held, self.episodes)

    @staticmethod
    def total(rates: Sequence[Rate]) -> Rate:
        """Return the sum of the counts of several rates."""
        return Rate(sum(rate.held for rate in rates), sum(rate.episodes for rate in rates))

    def to_dict(self, name: str) -> dict[str, Any]:
        """Return ``<name>_mean`` and ``<name>_interval`` as plain data; both are None if there are no episodes."""
        there = self.episodes > 0
        return {f"{name}_mean": self.mean, f"{name}_interval": list(self.interval) if there else None}


def difference(one: Rate, other: Rate) -> tuple[float, tuple[float, float]]:
    """Return the difference ``one - other`` of two success rates with its 95 % interval (Newcombe 1998).

    Raises:
        ValueError: one of the rates has no episodes.
    """
    if one.mean is None or other.mean is None:
        raise ValueError("cannot compare two success rates if one of them has no episodes")
    gap = one.mean - other.mean
    (low_1, high_1), (low_2, high_2) = one.interval, other.interval
    below = sqrt((one.mean - low_1) ** 2 + (high_2 - other.mean) ** 2)
    above = sqrt((high_1 - one.mean) ** 2 + (other.mean - low_2) ** 2)
    return gap, (gap - below, gap + above)


@dataclass(frozen=True)
class TaskFigures:
    """Success rates of one policy of an experiment on one task, over all training seeds.

    Attributes:
        rates: success rate for each kind of evaluation that was run.
    """

    name: str
    rates: Mapping[Kind, Rate]

    def rate(self, kind: Kind) -> Rate:
        """Return the success rate of one kind of evaluation; 0 of 0 episodes if the evaluation was not run."""
        return self.rates.get(kind, Rate(0, 0))

    def as_seen(self) -> TaskFigures:
        """Return the rates of a task that has no unseen objects.

        All its episodes count as episodes with seen objects.
        """
        rates = {kind: rate for kind, rate in self.rates.items() if kind not in ("seen", "unseen")}
        return replace(self, rates={**rates, "seen": Rate.total([self.rate("seen"), self.rate("unseen")])})

    def to_dict(self, arm: str) -> dict[str, Any]:
        told = {"name": self.name, "arm": arm}
        for kind in KINDS:
            told |= self.rate(kind).to_dict(kind)
        counts = {kind: {"held": rate.held, "episodes": rate.episodes} for kind, rate in self.rates.items()}
        return {**told, "episodes": _evaluated([self]), "counts": counts}


def summary(tasks: Sequence[TaskFigures]) -> dict[str, Any]:
    """Return success rates averaged over tasks, and the difference between the rates on seen and unseen objects.

    Tasks have equal weight. ``said_mean`` is the rate with the correct instruction, over the tasks that are also
    evaluated with the opposite instruction, such as "close" instead of "open".
    """
    totals = {kind: Rate.total([each.rate(kind) for each in tasks]) for kind in KINDS}
    told: dict[str, Any] = {}
    for kind, rate in totals.items():
        told |= rate.to_dict(kind)
    paired = [each for each in tasks if each.rate("opposite").episodes]
    return {
        **told,
        **_less("lost", tasks, "seen", "unseen"),
        **_less("transfer_lost", tasks, "unseen", "real"),
        **Rate.total([each.rate("unseen") for each in paired]).to_dict("said"),
        "episodes": _evaluated(tasks),
    }


def _less(name: str, tasks: Sequence[TaskFigures], one: Kind, other: Kind) -> dict[str, Any]:
    """Return the rate of ``one`` minus the rate of ``other``, and the interval of the difference.

    Only tasks with both rates count.
    """
    both = [each for each in tasks if each.rate(one).episodes and each.rate(other).episodes]
    first, second = (Rate.total([each.rate(kind) for each in both]) for kind in (one, other))
    found = difference(first, second) if both else None
    return {
        f"{name}_mean": None if found is None else found[0],
        f"{name}_interval": None if found is None else list(found[1]),
    }


def _evaluated(tasks: Sequence[TaskFigures]) -> int:
    """Return the number of episodes on seen and unseen objects, without controls and changed instructions."""
    return sum(each.rate(kind).episodes for each in tasks for kind in ("seen", "unseen"))
