"""Figures of an experiment, counted from the episodes of its arms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

from gensim2.rollout.tally import interval


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
        seen, unseen, blind: on objects that were taught on, on others, and on these without the cloud.
    """

    name: str
    seen: Rate
    unseen: Rate
    blind: Rate

    def to_dict(self, arm: str) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "name": self.name,
            "arm": arm,
            **self.seen.to_dict("seen"),
            **self.unseen.to_dict("unseen"),
            "blind_mean": self.blind.mean,
            "episodes": self.seen.episodes + self.unseen.episodes,
        }


def summary(tasks: Sequence[TaskFigures]) -> dict[str, Any]:
    """Means over tasks, which have equally many episodes, and what is lost on unseen objects."""
    seen, unseen = Rate.total([each.seen for each in tasks]), Rate.total([each.unseen for each in tasks])
    lost = difference(seen, unseen) if seen.episodes and unseen.episodes else None
    return {
        **seen.to_dict("seen"),
        **unseen.to_dict("unseen"),
        "lost_mean": None if lost is None else lost[0],
        "lost_interval": None if lost is None else list(lost[1]),
        "blind_mean": Rate.total([each.blind for each in tasks]).mean,
        "episodes": seen.episodes + unseen.episodes,
    }
