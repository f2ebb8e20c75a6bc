"""A step planned: the motion, its reference and the scene after it, or why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.planning.actions import Schedule
from gensim2.planning.scene import Scene
from gensim2.planning.strategies import Strategy
from gensim2.tasks.spec import Step

Array = npt.NDArray[np.float64]

NO_GRASP = "no_grasp"
"""Status of a step whose object has no grasp that serves."""

INVALID = "invalid"
"""Status of a step whose strategy does not fit the objects of the scene."""


@dataclass(frozen=True)
class StepPlan:
    """A step planned.

    Attributes:
        status, reason: the planner's; ``"no_grasp"`` where no grasp serves.
        plan: the motion; None where there was none to be looked for.
        schedule: its rows, None without a motion.
        after: the scene as it will be; None without a motion.
        picks: the object that is taken up, or None.
        width: distance of the finger pads that hold it, m.
        force: with which each finger presses on it, N.
        T_object_hand: (4, 4) hand in its frame as it is grasped.
        touches: what stands in the way of a motion that touches nothing before the actuation pose, where this one does.
        whole: the plan of the whole motion, where ``plan`` is its longest part; it says why the rest fails.
        foreseen: of a grasp the step that it is for, with the plan of it that was found on the scene as it will be.
    """

    status: str
    reason: str
    plan: kpam.Plan | None
    schedule: Schedule | None
    after: Scene | None
    picks: str | None = None
    width: float | None = None
    force: float | None = None
    T_object_hand: Array | None = None
    touches: str | None = None
    whole: kpam.Plan | None = None
    foreseen: Foreseen | None = None

    @property
    def is_solved(self) -> bool:
        """Whether the whole motion was found."""
        return self.status == "solved"

    @property
    def rank(self) -> int:
        """The lower, the better: whole and gentle, whole, a part, no motion at all."""
        if self.schedule is None:
            return 3
        return 2 if not self.is_solved else 0 if self.touches is None else 1

    def detail(self) -> dict[str, Any]:
        """Details of what prevents the whole motion: residuals missed, the keyframe not reached, bodies that collide;
        and of one that touches nothing before the actuation pose."""
        touches = {} if self.touches is None else {"touches": self.touches}
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
    """A step planned ahead, on a scene as it will be.

    Attributes:
        step: its name.
        strategy: which of its strategies, by number.
        plan: the motion.
    """

    step: str
    strategy: int
    plan: kpam.Plan


#: A step and its strategies, in order of preference.
Ways = tuple[Step, Sequence[Strategy]]
