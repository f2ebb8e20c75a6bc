"""Sample alignments with weights learned from the results of earlier alignments.

With a good alignment, the arm can reach the pose (``reach``), follow the joint (``follow``), and move it (``effect``).

A diagnosis shows which of these conditions failed and which parts of the alignment may have caused the failure. If the
pose is out of reach, these parts are the direction and the keypoint. Alignments that are similar in all these parts are
then sampled less often. A further cause, such as the contact offset with which a finger hit the object, makes fewer
alignments similar.

Probabilities come from trials of alignments that are similar in these parts. Alignments with a high probability are
sampled more often.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from gensim2.core.arrays import Array
from gensim2.design import joint_search
from gensim2.design.base import CandidateResult, StageResult
from gensim2.design.diagnosis import Diagnosis
from gensim2.design.manipulation import Manipulation
from gensim2.rollout.record import Cause

Question = Literal["reach", "follow", "effect"]

Part = Literal["approach", "keypoint", "gripper", "roll", "motion", "offset"]

#: Prior probability that a condition is met, and the weight of this prior as a number of trials.
PRIOR, PRIOR_TRIALS = 0.5, 1.0

#: The probability of sampling an alignment is proportional to its estimated success probability to this power.
SHARPNESS = 3.0

#: The similarity of two directions in one frame is the cosine of the angle between them to this power.
DIRECTION_POWER = 4

#: The similarity of two contacts decreases exponentially with their distance; at this distance (m) it is 1/e.
OFFSET_SCALE = 0.02

#: Decisive parts of an alignment for each condition. Alignments with similar parts give similar results.
_YES: dict[Question, tuple[Part, ...]] = {
    "reach": ("approach", "keypoint"),
    "follow": ("approach", "keypoint", "motion"),
    "effect": ("approach", "keypoint", "gripper"),
}

#: Parts of the alignment that may be to blame, for each cause of failure that only a simulation can show.
_BY_CAUSE: dict[Cause, tuple[Part, ...]] = {
    Cause.NO_CONTACT: ("approach", "keypoint", "gripper", "offset"),
    Cause.CONTACT_SLIPPED: ("approach", "gripper", "offset"),
    Cause.STOPPED_SHORT: ("approach", "gripper", "motion"),
    Cause.WRONG_WAY: ("approach", "keypoint", "offset"),
    Cause.GOAL_UNDONE: ("approach", "gripper", "motion"),
}

#: Causes of failure for which either no motion was executed or the motion ended before the actuation pose.
_PLANNED = frozenset(
    {
        Cause.NO_ACTUATION_POSE,
        Cause.KEYFRAME_OUT_OF_REACH,
        Cause.COLLISION_ON_THE_WAY,
        Cause.NO_MOTION_FOUND,
        Cause.INVALID_PROBLEM,
    }
)


_CAUSES: dict[str, Cause] = {cause.value: cause for cause in Cause}
"""Causes of failure by the text in a diagnosis. Statuses of the planner, which a diagnosis may have, are missing."""


@dataclass(frozen=True)
class Evidence:
    """Results of trials that show whether an alignment meets one of the three conditions.

    Attributes:
        question: the condition that the trials test: ``reach``, ``follow`` or ``effect``.
        parts: decisive parts of the alignment, such as the keypoint. The result counts for all alignments that are
            similar in them.
        yes: fraction of trials that met the condition.
        trials: number of trials.
    """

    question: Question
    parts: tuple[Part, ...]
    yes: float
    trials: float


def draw(
    pool: Sequence[Manipulation], results: Sequence[CandidateResult], count: int, generator: np.random.Generator
) -> list[Manipulation]:
    """Sample alignments without replacement; alignments that are likely to succeed have a higher probability.

    Args:
        pool: alignments to select from; alignments in ``results`` are excluded.
        results: results of earlier candidates; candidates that are not alignments are ignored.
        count: maximum number of alignments.
    """
    tried = [
        (joint_search.manipulation_from(result.candidate.provenance), result)
        for result in results
        if "approach" in result.candidate.provenance
    ]
    known = {manipulation for manipulation, _ in tried}
    left = [each for each in pool if each not in known]
    if not left or count < 1:
        return []
    odds = estimates(left, tried) ** SHARPNESS
    # The largest sums of logarithm and Gumbel noise are a weighted sample without replacement (Vieira 2014).
    keys = np.log(odds) + generator.gumbel(size=len(left))
    return [left[index] for index in np.argsort(-keys, kind="stable")[:count]]


def estimates(pool: Sequence[Manipulation], tried: Sequence[tuple[Manipulation, CandidateResult]]) -> Array:
    """Estimate the probabilities (N,) that the alignments of ``pool`` meet all three conditions."""
    likeness = _Likeness(pool)
    yes: dict[Question, Array] = {question: np.full(len(pool), PRIOR * PRIOR_TRIALS) for question in _YES}
    trials: dict[Question, Array] = {question: np.full(len(pool), PRIOR_TRIALS) for question in _YES}
    for manipulation, result in tried:
        for each in evidence(result):
            weight = each.trials * likeness.of(manipulation, each.parts)
            yes[each.question] += each.yes * weight
            trials[each.question] += weight
    return np.asarray(np.prod([yes[question] / trials[question] for question in _YES], axis=0))


def evidence(result: CandidateResult) -> Iterator[Evidence]:
    """Yield the evidence in a candidate's results about each of the three conditions."""
    for stage in result.stages:
        failed = [(each, each.count / stage.trials) for each in stage.diagnoses]
        no: dict[Question, float] = {"reach": 0.0, "follow": 0.0, "effect": 0.0}
        for diagnosis, share in failed:
            question, parts = blamed(diagnosis)
            no[question] += share
            yield Evidence(question, parts, 0.0, diagnosis.count)
        yield from _answered(stage, no)


def blamed(diagnosis: Diagnosis) -> tuple[Question, tuple[Part, ...]]:
    """Return the condition that a failure violates, and the parts of the alignment to blame."""
    plan: Mapping[str, Any] = diagnosis.numbers.get("plan", diagnosis.numbers)
    unreached = str(plan.get("unreached", ""))
    cause = _CAUSES.get(diagnosis.cause)
    if cause in _BY_CAUSE:
        return "effect", _BY_CAUSE[cause]
    if unreached.startswith(("post", "let_go")):
        return "follow", ("approach", "motion", *_hit(plan))
    if unreached or cause in _PLANNED or plan.get("residuals"):
        missed = [str(each["name"]) for each in plan.get("residuals", ())]
        if missed and all(name.startswith("frame_axis_orthogonal") for name in missed):
            return "reach", ("approach", "roll")
        return "reach", ("approach", "keypoint", *_hit(plan))
    return "effect", ("approach", "keypoint", "gripper")


def _hit(plan: Mapping[str, Any]) -> tuple[Part, ...]:
    """Return the parts that caused a collision: the offset for one with the object, none with the table."""
    bodies = [str(each["bodies"][1]) for each in plan.get("collisions", ())]
    return () if not bodies or "table" in bodies else ("offset",)


def _answered(stage: StageResult, no: Mapping[Question, float]) -> Iterator[Evidence]:
    """Yield, for each condition, evidence from the trials that met the condition.

    Conditions are tested in the order ``reach``, ``follow``, ``effect``. Conditions before the failed one are met.

    Args:
        stage: results of the trials.
        no: fraction of trials that failed each condition.
    """
    reached = 1.0 - no["reach"]
    followed = reached - no["follow"]
    worked = followed - no["effect"]
    asked: list[tuple[Question, float]] = [("reach", reached)]
    asked.append(("follow", followed))
    if stage.name == "physics":
        asked.append(("effect", worked))
    for question, share in asked:
        if share > 0.0:
            yield Evidence(question, _YES[question], 1.0, share * stage.trials)


class _Likeness:
    """Computes the similarity, from 0 to 1, of the alignments in a pool to other alignments."""

    def __init__(self, pool: Sequence[Manipulation]) -> None:
        self._vectors = np.array([each.approach.vector for each in pool])
        self._frames = np.array([each.approach.frame for each in pool])
        self._offsets = np.array([(each.behind, each.inset) for each in pool])
        self._names = {
            part: np.array([str(getattr(each, part)) for each in pool])
            for part in ("keypoint", "gripper", "roll", "motion")
        }

    def of(self, one: Manipulation, parts: Sequence[Part]) -> Array:
        """Return each alignment's similarity (N,) to ``one``: the product over ``parts``, such as the direction."""
        found = np.ones(len(self._vectors))
        for part in parts:
            found = found * self._in(part, one)
        return found

    def _in(self, part: Part, one: Manipulation) -> Array:
        if part == "approach":
            cosine = np.clip(self._vectors @ np.asarray(one.approach.vector), 0.0, 1.0)
            return np.where(self._frames == one.approach.frame, cosine**DIRECTION_POWER, 0.0)
        if part == "offset":
            apart = np.linalg.norm(self._offsets - np.array([one.behind, one.inset]), axis=1)
            return np.asarray(np.exp(-apart / OFFSET_SCALE))
        return np.asarray(self._names[part] == str(getattr(one, part)), dtype=np.float64)
