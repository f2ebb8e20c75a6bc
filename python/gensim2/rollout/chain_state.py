"""Store the state of a chain of steps: the plans so far, and the current step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import ceil

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.planning.scene import Scene, SceneBody
from gensim2.planning.step_plan import StepPlan
from gensim2.planning.strategies import MAKES_ROOM
from gensim2.robots import RobotProfile
from gensim2.rollout.controller import Action
from gensim2.rollout.record import PlanRecord
from gensim2.scenes.footprint import gap_between, outline
from gensim2.tasks.criteria import OF_GRIPPER
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import HAND, Step

ROOM = 0.06
"""Horizontal clearance (m) that an open hand needs on each side of an object."""


def room_for_hand(after: Scene | None, step: Step, following: Sequence[Step]) -> float:
    """Return how much horizontal clearance (m) a step leaves for the hand beside the object of the next step.

    This is the clearance between that object and the link that the step moves, such as a door.

    Args:
        after: scene predicted by a plan of ``step``; None without a plan.
        step: step that moves a joint.
        following: steps after ``step``.

    Returns:
        Clearance, at most ``ROOM``, because the hand needs no more.
    """
    if after is None or not following or following[0].tool != HAND:
        return ROOM
    thing, joint = after.objects[following[0].object], after.objects[step.object].joint
    if joint is None or not thing.is_rigid:
        return ROOM
    about = _outline(thing.bodies)
    moved = (body for body in after.objects[step.object].bodies if body.name in joint.moves and body.hulls)
    return min((ROOM, *(gap_between(_outline([body]), about) for body in moved)))


def _outline(bodies: Sequence[SceneBody]) -> Array:
    """Return the convex outline (N, 2) of bodies in the horizontal plane of the base frame, m, counter-clockwise."""
    points = [hull @ body.T_base_body[:3, :3].T + body.T_base_body[:3, 3] for body in bodies for hull in body.hulls]
    return outline(np.concatenate(points), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


@dataclass
class ChainPlan:
    """A plan of a task step, and the progress of its execution.

    Attributes:
        strategy: name of the planned strategy.
        planned: result of the planner.
        scene: scene that the plan was made for.
        at_step: control step at which the plan was made.
        trigger: ``"start"``, or the deviation that caused replanning.
        profile: robot whose simulated drives execute the plan.
        room: horizontal clearance (m) that the plan leaves for the hand beside the object of the next step, as returned
            by :func:`room_for_hand`.
        makes_room: whether the plan only moves an obstacle out of the way.
        ran: number of actions executed so far.
        is_stopped: whether the motion was ended before its last action.
    """

    strategy: str
    planned: StepPlan
    scene: Scene
    at_step: int
    trigger: str
    profile: RobotProfile
    room: float = ROOM
    makes_room: bool = False
    ran: int = 0
    is_stopped: bool = False

    @property
    def rank(self) -> tuple[bool, int, int]:
        """Return the key by which plans are sorted; the best plan has the lowest key.

        Complete plans come before incomplete plans. Plans that are equal in this respect are sorted by the room that
        they leave for the hand beside the object of the next step, and then by the rank that the planner gave them.
        """
        return not self.planned.is_solved, ceil((ROOM - self.room) / 0.01), self.planned.rank

    @property
    def is_best(self) -> bool:
        """Return whether no other plan can have a better rank."""
        return self.planned.rank == 0 and self.room >= ROOM

    @property
    def is_over(self) -> bool:
        return self.is_stopped or self.planned.schedule is None or self.ran >= len(self.planned.schedule)

    def next_action(self) -> Action:
        """Return the next action of a plan that has actions left."""
        action: Action = self.actions[self.ran]
        self.ran += 1
        return action

    @cached_property
    def actions(self) -> npt.NDArray[np.float32]:
        """Return actions (N, m + 1) with which the simulated drives follow the plan's reference motion."""
        schedule = self.planned.schedule
        assert schedule is not None
        targets = self.profile.simulated_targets(schedule.reference[:, 0], schedule.ends)
        return np.column_stack([targets, schedule.commands])

    def record(self) -> PlanRecord:
        planned = self.planned
        return PlanRecord(
            strategy=self.strategy,
            status=planned.status,
            reason=planned.reason,
            at_step=self.at_step,
            trigger=self.trigger,
            ran=self.ran,
            detail=planned.detail() | ({MAKES_ROOM: True} if self.makes_room else {}),
        )


@dataclass
class ChainTurn:
    """One execution of a task step. A step is executed again if its grasped object is lost.

    Attributes:
        step: executed step.
        plans: plans made in this execution, oldest first.
        tries: number of complete executions of each strategy.
        acted: measurement at the last grasp or release: right after the fingers closed on an object, or right before
            they released it. At this moment the gripper was in the state that the criteria of the step require. None
            before the first grasp or release.
    """

    step: Step
    plans: list[ChainPlan] = field(default_factory=list)
    tries: dict[str, int] = field(default_factory=dict)
    acted: Measurement | None = None

    def is_done(self, measured: Measurement) -> bool:
        """Return whether the step is done.

        All criteria of the step must be met. A criterion about the gripper also counts as met if it was met when the
        gripper last grasped or released the object, because it may be false afterwards.
        """
        return all(
            criterion.holds(measured)
            or (self.acted is not None and isinstance(criterion, OF_GRIPPER) and criterion.holds(self.acted))
            for criterion in self.step.done
        )


def best_of(plans: Sequence[ChainPlan]) -> ChainPlan | None:
    """Return the best plan that has a motion; among equals, the first."""
    return min((plan for plan in plans if plan.planned.schedule is not None), key=lambda plan: plan.rank, default=None)
