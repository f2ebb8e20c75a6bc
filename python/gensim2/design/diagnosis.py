"""Describe failures of candidates in sentences with measured values, which help a designer to improve a candidate."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

#: Maximum number of failure sentences kept for each stage, the most frequent first.
KEPT = 6

#: Phrases for the measured values of a diagnosis, by name of the value. Braces stand for the value.
NUMBERS = {
    "distance": "by {:.0f} mm",
    "nearest": "the point between the fingertips came within {:.0f} mm of its surface",
    "slip": "the hand went on {:.0f} mm after it had stopped",
}
SHARES = {
    "travelled": "its joint went {:.0%} of its range the wanted way",
    "furthest": "at its furthest {:.0%}",
    "openness": "and ended at openness {:.2f}",
}


@dataclass(frozen=True)
class Diagnosis:
    """A kind of failure that occurs in a candidate's trials.

    Attributes:
        step: name of the failed step; None if no step is to blame.
        cause: cause of failure (docs/reference/episodes.md) or status of the planner.
        words: sentence that describes one of these failed trials with its numbers.
        count: number of trials with this kind of failure.
        numbers: measured values in ``words``, as passed to :func:`diagnoses`.
    """

    step: str | None
    cause: str
    words: str
    count: int
    numbers: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON."""
        return {"step": self.step, "cause": self.cause, "words": self.words, "count": self.count}

    def __str__(self) -> str:
        return f"{self.count} times: {self.words}"


def diagnoses(
    failures: Iterable[tuple[str, Mapping[str, Any]]], described: Callable[[str], str] = str
) -> tuple[Diagnosis, ...]:
    """Group failed trials by the kind of failure. Return up to ``KEPT`` kinds of failure, the most frequent first.

    Args:
        failures: causes and measured values of failed trials: ``diagnosis``, or ``detail`` of a plan, ``step`` and
            ``strategy``.
        described: function from the name of a strategy to its description. Empty descriptions are omitted. Default: the
            name.
    """
    counts: Counter[tuple[str | None, str, str]] = Counter()
    example: dict[tuple[str | None, str, str], Mapping[str, Any]] = {}
    for cause, numbers in failures:
        key = (numbers.get("step"), cause, described(str(numbers.get("strategy") or "")))
        counts[key] += 1
        example.setdefault(key, numbers)
    return tuple(
        Diagnosis(key[0], key[1], in_words(key[1], {**example[key], "strategy": key[2]}), count, example[key])
        for key, count in counts.most_common(KEPT)
    )


def in_words(cause: str, numbers: Mapping[str, Any]) -> str:
    """Return one sentence that states the step, the strategy, the cause and the measured values of a failure."""
    step, strategy = numbers.get("step"), numbers.get("strategy")
    where = f"step {step!r}" + (f" by {strategy!r}" if strategy else "") + ": " if step else ""
    facts = [
        *_of_plan(numbers.get("plan", numbers)),
        *(text.format(1000 * numbers[name]) for name, text in NUMBERS.items() if _is_number(numbers.get(name))),
        # Adding zero turns the -0 of a small negative share into 0.
        *(text.format(round(numbers[name], 2) + 0.0) for name, text in SHARES.items() if _is_number(numbers.get(name))),
        *_deviations(numbers.get("deviations", ())),
        *_failing(numbers.get("failing", ())),
    ]
    return where + "; ".join([cause, *facts])


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)


def _of_plan(detail: Mapping[str, Any]) -> list[str]:
    facts = []
    for each in detail.get("residuals", ()):
        facts.append(f"{each['name']} misses by {_length(each)} where {_length(each, 'tolerance')} is allowed")
    if detail.get("unreached"):
        facts.append(f"the keyframe {detail['unreached']} is not reached")
    for each in detail.get("collisions", ()):
        first, second = each["bodies"]
        verb = "overlap by" if each["distance"] < 0 else "come within"
        facts.append(
            f"{first} and {second} {verb} {_millimetres(abs(each['distance']))} on the way to {each['toward']}"
        )
    if detail.get("touches"):
        plan = "the plan is complete, but it" if set(detail) == {"touches"} else "the plan"
        facts.append(
            f"{plan} lets the hand touch its target before the actuation pose, because without this contact planning "
            f"fails: {detail['touches']}"
        )
    return facts


def _millimetres(length: float) -> str:
    return f"{1000 * length:.0f} mm" if length >= 5e-4 or length == 0 else "less than 1 mm"


def _length(residual: Mapping[str, Any], name: str = "residual") -> str:
    """Format the remaining error of a constraint, in millimetres for points and in radians for other constraints."""
    value = float(residual[name])
    return f"{1000 * value:.0f} mm" if str(residual["name"]).startswith("point2point") else f"{value:.2f} rad"


def _deviations(given: Iterable[Mapping[str, Any]]) -> list[str]:
    counted = Counter(f"{each['what']} in step {each['step']!r}" for each in given)
    return [f"noticed {count} times: {what}" for what, count in counted.items()]


def _failing(given: Iterable[Any]) -> list[str]:
    return [f"not true in the end: {each}" for each in given]
