"""Count episodes by the verdicts ``paper``, ``held`` and ``strict``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gensim2.rollout.record import Episode


@dataclass(frozen=True)
class Tally:
    """Counts of episodes.

    Attributes:
        paper, held, strict: number of episodes that pass each verdict (docs/reference/episodes.md).
        partial: number of episodes in which only part of a motion was executed because no complete plan was found.
        replanned: number of episodes in which a step was planned again.
        still: number of episodes whose goal is reached even in the no-op baseline, in which the robot does nothing.
        causes: number of failures by cause, most frequent first.
        strict_misses: number of unmet conditions of ``strict`` by condition, most frequent first.
        objects: number of different objects by class.
        disturbed: number of episodes in which an object was pushed or dropped on purpose, to test the controller.
        engines: number of episodes that pass ``held``, by engine. Only episodes that ran in both engines count.
        disagreed: seeds of the scenes in which only one engine passes ``held``.
    """

    episodes: int
    paper: int
    held: int
    strict: int
    partial: int
    replanned: int
    still: int
    causes: dict[str, int]
    strict_misses: dict[str, int]
    objects: dict[str, int]
    disturbed: int = 0
    engines: dict[str, int] = field(default_factory=dict)
    disagreed: tuple[int, ...] = ()

    @staticmethod
    def of(episodes: Sequence[Episode]) -> Tally:
        seen = {(record.asset_class, record.id) for episode in episodes for record in episode.objects.values()}
        return Tally(
            episodes=len(episodes),
            paper=sum(episode.paper for episode in episodes),
            held=sum(episode.held for episode in episodes),
            strict=sum(episode.strict for episode in episodes),
            partial=sum(episode.partial for episode in episodes),
            replanned=sum(episode.replans > 0 for episode in episodes),
            still=sum(bool(episode.still) for episode in episodes),
            causes=_counted(str(episode.cause) for episode in episodes if episode.cause is not None),
            strict_misses=_counted(str(miss) for episode in episodes for miss in episode.strict_misses),
            objects=dict(sorted(Counter(asset_class for asset_class, _ in seen).items())),
            disturbed=sum(episode.disturbed_at is not None for episode in episodes),
            engines=held_by_engine(episodes),
            disagreed=tuple(episode.seed for episode in episodes if disagree(episode)),
        )

    def verdicts(self) -> dict[str, int]:
        """Return the number of episodes that pass each of the three verdicts, by name."""
        return {"paper": self.paper, "held": self.held, "strict": self.strict}

    def to_dict(self) -> dict[str, Any]:
        """Return the counts that are stored in files."""
        return {
            **self.verdicts(),
            "partial": self.partial,
            "causes": self.causes,
            "strict_misses": self.strict_misses,
            "objects": self.objects,
        }


def held_by_engine(episodes: Iterable[Episode]) -> dict[str, int]:
    """Return the number of episodes that pass ``held`` in each engine, of the episodes that ran in two engines."""
    counts: dict[str, int] = {}
    for each in (record for episode in episodes for record in episode.engines):
        counts[each.engine] = counts.get(each.engine, 0) + each.held
    return counts


def disagree(episode: Episode) -> bool:
    """Return whether an episode passes the ``held`` verdict in only one of two physics engines."""
    return len({each.held for each in episode.engines}) > 1


def engines_record(engines: Mapping[str, int], disagreed: Sequence[int]) -> dict[str, Any]:
    """Return the JSON fields that compare two engines; empty if the episodes ran in one engine."""
    return {"engines": dict(engines), "disagreed": list(disagreed)} if engines else {}


def interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 % confidence interval (Wilson 1927) of a success rate. Without trials the interval is (0, 1)."""
    if trials == 0:
        return 0.0, 1.0
    from scipy.stats import binomtest  # imported here: argument checks do not need SciPy

    found = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    return float(found.low), float(found.high)


def _counted(words: Iterable[str]) -> dict[str, int]:
    return dict(Counter(words).most_common())
