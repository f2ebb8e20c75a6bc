"""Define the result of planning a step: the motion and the predicted scene, or the reason for failure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.planning.actions import Schedule
from gensim2.planning.scene import Scene
from gensim2.planning.strategies import Strategy
from gensim2.tasks.spec import Step

NO_GRASP = "no_grasp"
"""Status of a step whose object has no usable grasp."""

INVALID = "invalid"
"""Status of a step whose strategy does not fit the objects of the scene."""

CLEAR = 0.004
"""Clearance (m) of a motion with a grasped object that exceeds the tracking error of the arm."""


@dataclass(frozen=True)
class StepPlan:
    """Result of planning a step. Its ``repr`` leaves out the motions, which have thousands of numbers.

    Attributes:
        status, reason: status and reason that the solver returned; the status is ``"no_grasp"`` if no grasp is usable.
        plan: the motion; None if the solver was not called.
        schedule: control steps that execute the motion; None without a motion.
        after: predicted scene after the motion; None without a motion.
        picks: name of the object that is picked up, or None.
        width: distance between the finger pads at the grasp of ``picks``, m.
        force: force of each finger on ``picks``, N.
        T_object_hand: (4, 4) pose of the hand in the grasped object's frame, or None.
        touches: reason why planning without early contact failed; None without early contact.
        misses: reason why the released object would not end at its goal; None if it would.
        is_tight: whether a plan that releases an object keeps less than ``CLEAR`` of clearance. Pairs of bodies that
            are closer at the start or at the end of the motion do not count.
        whole: failed plan of the complete motion if ``plan`` is a shortened motion, else None.
        foreseen: plan of a later step with the grasped object as its tool, from the scene ``after``; or None.
    """

    status: str
    reason: str
    plan: kpam.Plan | None = field(repr=False)
    schedule: Schedule | None = field(repr=False)
    after: Scene | None = field(repr=False)
    picks: str | None = None
    width: float | None = None
    force: float | None = None
    T_object_hand: Array | None = field(default=None, repr=False)
    touches: str | None = None
    misses: str | None = None
    is_tight: bool = False
    whole: kpam.Plan | None = field(default=None, repr=False)
    foreseen: Foreseen | None = field(default=None, repr=False)

    @property
    def is_solved(self) -> bool:
        """Whether the complete motion was found."""
        return self.status == "solved"

    @property
    def rank(self) -> int:
        """Quality of the plan, from 0 (best) to 4.

        Rank 0 is a complete plan, 1 a complete plan with early contact or with little clearance for a grasped object
        (``is_tight``), 2 a complete plan that misses its goal, 3 a partial plan, and 4 no motion.
        """
        if self.schedule is None:
            return 4
        if not self.is_solved:
            return 3
        if self.misses is not None:
            return 2
        return int(self.touches is not None or self.is_tight)

    def detail(self) -> dict[str, Any]:
        """Return the reasons why no complete motion was found (residuals, keyframe, collisions), and ``touches``."""
        touches = {} if self.touches is None else {"touches": self.touches}
        touches |= {} if self.misses is None else {"misses": self.misses}
        plan = self.whole or self.plan
        if plan is None or self.is_solved:
            return touches
        found: dict[str, Any] = {
            "residuals": [
                {"name": each["name"], "residual": each["residual"], "tolerance": each["tolerance"]}
                for each in plan.residuals
                if not each["satisfied"]
            ],
            "unreached": next((frame["label"] for frame in plan.keyframes if not frame["reached"]), None),
            "collisions": [
                {"bodies": list(each["bodies"]), "distance": each["distance"], "toward": each["toward"]}
                for each in plan.collisions
            ],
        }
        return {name: value for name, value in found.items() if value} | touches


@dataclass(frozen=True)
class Foreseen:
    """Plan of a step on a predicted scene.

    Attributes:
        strategy: index of the planned strategy among the strategies of the step.
        plan: the motion.
        rank: rank of the plan, as for :attr:`StepPlan.rank`.
    """

    step: str
    strategy: int
    plan: kpam.Plan
    rank: int = 0


#: A step and its strategies in order of preference.
Ways = tuple[Step, Sequence[Strategy]]
