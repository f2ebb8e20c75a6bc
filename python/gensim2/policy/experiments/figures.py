"""Figures of an experiment, counted from the episodes of its arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, Literal, get_args

from gensim2.rollout.tally import interval

Kind = Literal["seen", "unseen", "real", "opposite", "rephrased", "untaught", "blind"]
"""What a policy is measured by: on objects that were taught on, on others, on real ones where it was taught on
generated ones; on unseen objects told the opposite, and told the same in other words; on
tasks that no training had; on unseen objects without the cloud."""
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class Rate:
    """Episodes that held.

    Attributes:
        held, episodes: how many of how many.
    """

    held: int
    episodes: int

    @property
    def mean(self) -> float | None:
        """Share of episodes that held; None where there were none."""
        return self.held / self.episodes if self.episodes else None

    @property
    def interval(self) -> tuple[float, float]:
        """95 % (Wilson); of several tasks, as if all their episodes were draws of one rate."""
        return interval(self.held, self.episodes)

    @staticmethod
    def total(rates: Sequence[Rate]) -> Rate:
        """All of them as one."""
        return Rate(sum(rate.held for rate in rates), sum(rate.episodes for rate in rates))

    def to_dict(self, name: str) -> dict[str, Any]:
        """``<name>_mean`` and ``<name>_interval``; None where there were no episodes."""
        there = self.episodes > 0
        return {f"{name}_mean": self.mean, f"{name}_interval": list(self.interval) if there else None}


def difference(one: Rate, other: Rate) -> tuple[float, tuple[float, float]]:
    """``one`` minus ``other``, and its 95 % interval (Newcombe 1998, of Wilson's intervals).

    Raises:
        ValueError: one has no episodes.
    """
    if one.mean is None or other.mean is None:
        raise ValueError("there are no episodes")
    gap = one.mean - other.mean
    (low_1, high_1), (low_2, high_2) = one.interval, other.interval
    below = sqrt((one.mean - low_1) ** 2 + (high_2 - other.mean) ** 2)
    above = sqrt((high_1 - one.mean) ** 2 + (other.mean - low_2) ** 2)
    return gap, (gap - below, gap + above)


@dataclass(frozen=True)
class TaskFigures:
    """One task of one arm, over all seeds.

    Attributes:
        name: of the task.
        rates: by what was measured; what was not is missing.
    """

    name: str
    rates: Mapping[Kind, Rate]

    def rate(self, kind: Kind) -> Rate:
        """Rate of one kind; without episodes where nothing was measured."""
        return self.rates.get(kind, Rate(0, 0))

    def as_seen(self) -> TaskFigures:
        """The same, with what was measured on unseen objects counted as seen: of a task that has no others."""
        rates = {kind: rate for kind, rate in self.rates.items() if kind not in ("seen", "unseen")}
        return replace(self, rates={**rates, "seen": Rate.total([self.rate("seen"), self.rate("unseen")])})

    def to_dict(self, arm: str) -> dict[str, Any]:
        """Return it as plain data."""
        told = {"name": self.name, "arm": arm}
        for kind in KINDS:
            told |= self.rate(kind).to_dict(kind)
        counts = {kind: {"held": rate.held, "episodes": rate.episodes} for kind, rate in self.rates.items()}
        return {**told, "episodes": _evaluated([self]), "counts": counts}


def summary(tasks: Sequence[TaskFigures]) -> dict[str, Any]:
    """Means over tasks, which have equally many episodes, and what is lost on unseen objects.

    ``said_mean`` is that on unseen objects of the tasks that have an opposite.
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
    """Return the difference of two kinds over the tasks with figures of both."""
    both = [each for each in tasks if each.rate(one).episodes and each.rate(other).episodes]
    first, second = (Rate.total([each.rate(kind) for each in both]) for kind in (one, other))
    found = difference(first, second) if both else None
    return {
        f"{name}_mean": None if found is None else found[0],
        f"{name}_interval": None if found is None else list(found[1]),
    }


def _evaluated(tasks: Sequence[TaskFigures]) -> int:
    """Episodes on objects that were taught on and on others; neither controls nor other sentences."""
    return sum(each.rate(kind).episodes for each in tasks for kind in ("seen", "unseen"))
