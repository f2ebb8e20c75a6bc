"""Compute the table of ``gensim2 benchmark`` from its episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean, pstdev
from typing import Any, Literal

from gensim2.rollout.record import Episode
from gensim2.rollout.tally import Tally, interval
from gensim2.tasks.published import paper_of, released_of
from gensim2.tasks.spec import TaskSpec

TaskType = Literal["single-step", "long-horizon"]

#: Verdicts by their names in the JSON output. The output calls the paper's verdict ``success``.
VERDICTS = {"success": "paper", "held": "held", "strict": "strict"}


@dataclass(frozen=True)
class TaskRow:
    """Row of the table: results of one task.

    Attributes:
        runs: number of runs. All runs have the same number of episodes.
        episodes: episodes of all runs, in the order of the runs.
    """

    task: TaskSpec
    runs: int
    episodes: tuple[Episode, ...]

    def __repr__(self) -> str:
        """Describe the row in one line: the mean success rates instead of the records of all episodes."""
        rates = ", ".join(f"{verdict}={mean(self.rates(verdict)):.2f}" for verdict in VERDICTS.values())
        return f"TaskRow(task={self.task.name!r}, runs={self.runs}, episodes={len(self.episodes)}, {rates})"

    @property
    def type(self) -> TaskType:
        """Type of the task, as the paper classifies tasks."""
        return "single-step" if self.task.is_single_step else "long-horizon"

    @property
    def seen(self) -> Literal["train", "all"] | None:
        """Instances with which the strategies were designed.

        ``"all"`` if any design used all instances; None if unknown.
        """
        made = self.task.provenance.strategies.values() if self.task.provenance is not None else ()
        found = {each.seen for each in made}
        return "all" if "all" in found else "train" if found else None

    def rates(self, verdict: str) -> list[float]:
        """Return the success rate of each run by the verdict ``"paper"``, ``"held"`` or ``"strict"``."""
        size = len(self.episodes) // self.runs
        flags = [bool(getattr(episode, verdict)) for episode in self.episodes]
        return [mean(flags[run * size : (run + 1) * size]) for run in range(self.runs)]

    def to_dict(self) -> dict[str, Any]:
        tally = Tally.of(self.episodes)
        paper, measured = paper_of(self.task), released_of(self.task)
        return {
            "name": self.task.name,
            "type": self.type,
            "runs": self.runs,
            "episodes": tally.episodes,
            **_rates([self]),
            "paper_figure": None if paper is None else paper[0],
            "original_figure": None if measured is None else measured[0] / measured[1],
            "partial": tally.partial,
            "partial_share": tally.partial / tally.episodes,
            "replanned": tally.replanned,
            "still": tally.still,
            "disturbed": tally.disturbed,
            "attempts": sum(max(1, len(episode.attempts)) for episode in self.episodes),
            "causes": tally.causes,
            "strict_misses": tally.strict_misses,
            "objects": tally.objects,
            "different_objects": sum(tally.objects.values()),
            "instances": by_instance(self.episodes),
            "seen": self.seen,
            "records": [episode.to_dict() for episode in self.episodes],
        }


def by_instance(episodes: Sequence[Episode]) -> dict[str, dict[str, int]]:
    """Count the episodes, and the successes by each verdict, for each combination of object instances.

    A verdict is a definition of success (``paper``, ``held`` or ``strict``).
    """
    found: dict[str, list[Episode]] = {}
    for episode in episodes:
        name = " + ".join(f"{record.asset_class}/{record.id}" for record in episode.objects.values())
        found.setdefault(name, []).append(episode)
    return {
        name: {
            "episodes": len(own),
            **{verdict: sum(bool(getattr(one, verdict)) for one in own) for verdict in VERDICTS.values()},
        }
        for name, own in sorted(found.items())
    }


def groups(rows: Sequence[TaskRow]) -> list[dict[str, Any]]:
    """Return, for each type of task, the mean success rates over its tasks, and the paper's rates for these tasks."""
    found = []
    for kind in ("single-step", "long-horizon"):
        if not (members := [row for row in rows if row.type == kind]):
            continue
        published = [figure[0] for row in members if (figure := paper_of(row.task)) is not None]
        measured = [figure for row in members if (figure := released_of(row.task)) is not None]
        found.append(
            {
                "type": kind,
                "tasks": len(members),
                "episodes": sum(len(row.episodes) for row in members),
                **_rates(members),
                "paper_figure": mean(published) if published else None,
                "original_figure": mean(held / of for held, of in measured) if measured else None,
            }
        )
    return found


def compared(one: Sequence[TaskRow], other: Sequence[TaskRow]) -> list[dict[str, Any]]:
    """Compare the verdicts ``held`` of each task in two engines on the same scenes.

    Each dictionary describes one task, with the successful episodes ``held`` by engine, the ``p_value`` of Fisher's
    exact test, and the seeds that succeed only in the first engine (``lost``) or only in the second (``won``).
    """
    from scipy.stats import fisher_exact  # imported late because it takes long to import

    found = []
    for row, again in zip(one, other, strict=True):
        pairs = list(zip(row.episodes, again.episodes, strict=True))
        held = [sum(episode.held for episode in each.episodes) for each in (row, again)]
        found.append(
            {
                "name": row.task.name,
                "episodes": len(pairs),
                "held": held,
                "p_value": float(fisher_exact([[count, len(pairs) - count] for count in held]).pvalue),
                "lost": [first.seed for first, second in pairs if first.held and not second.held],
                "won": [first.seed for first, second in pairs if second.held and not first.held],
            }
        )
    return found


def _rates(rows: Sequence[TaskRow]) -> dict[str, Any]:
    """Return the mean rate of each verdict, its standard deviation between runs, and its 95 % confidence interval.

    A verdict is a definition of success, such as ``held``.

    The interval pools the episodes of all tasks, whatever their difficulty. Therefore it is wider than necessary.
    """
    found: dict[str, Any] = {}
    for name, verdict in VERDICTS.items():
        by_run = [mean(rates) for rates in zip(*(row.rates(verdict) for row in rows), strict=True)]
        count = sum(bool(getattr(episode, verdict)) for row in rows for episode in row.episodes)
        found |= {
            f"{name}_mean": mean(by_run),
            f"{name}_std": pstdev(by_run),
            f"{name}_interval": list(interval(count, sum(len(row.episodes) for row in rows))),
        }
    return found
