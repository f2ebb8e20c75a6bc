"""Rates beside each other: counts with intervals, and how likely chance alone parts two as far."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gensim2.rollout.tally import interval


@dataclass(frozen=True)
class Rate:
    """Successes of trials.

    Attributes:
        count: of successes.
        of: trials.
    """

    count: int
    of: int

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, with its 95 % interval (Wilson 1927)."""
        share = self.count / self.of if self.of else None
        return {"count": self.count, "of": self.of, "rate": share, "interval": list(interval(self.count, self.of))}


def differ(one: Rate, other: Rate) -> float | None:
    """Return the two-sided p-value of equal rates (Fisher's exact test); None where one has no trials."""
    if not one.of or not other.of:
        return None
    from scipy.stats import fisher_exact  # here: refusing arguments needs no statistics

    table = [[one.count, one.of - one.count], [other.count, other.of - other.count]]
    return float(fisher_exact(table).pvalue)
