"""State of a chain of steps: the plans that were made, and whose turn it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import ceil

import numpy as np
import numpy.typing as npt

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

Array = npt.NDArray[np.float64]

ROOM = 0.06
"""Clearance (m) that an open hand needs on each side of an object, seen from above."""


def room_for_hand(after: Scene | None, step: Step, following: Sequence[Step]) -> float:
    """Return the clearance (m) from the link that a step moves to the next step's object, from above; ``ROOM`` at most.

    Args:
        after: the scene that a plan of ``step`` foresees; None where there is none.
        step: which moves a joint.
        following: the steps after it.
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
    """(N, 2) m: convex outline from above, in the base frame, counter-clockwise."""
    points = [hull @ body.T_base_body[:3, :3].T + body.T_base_body[:3, 3] for body in bodies for hull in body.hulls]
    return outline(np.concatenate(points), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


@dataclass
class ChainPlan:
    """A plan and what becomes of it.

    Attributes:
        strategy: by whose name it was made.
        planned: what the planner said.
        scene: on which.
        at_step: control step at which it was made.
        trigger: why.
        profile: whose simulated drives execute it.
        room: for the hand about what the next step takes, m; at most ``ROOM``.
        makes_room: whether it moves another object for the step, which it does not do.
        ran: actions of it that were given.
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

    @property
    def rank(self) -> tuple[bool, int, int]:
        """The lower, the better: whole, then by centimetres of room for what comes next, then as the planner has it."""
        return not self.planned.is_solved, ceil((ROOM - self.room) / 0.01), self.planned.rank

    @property
    def is_best(self) -> bool:
        """Whether none can be better."""
        return self.planned.rank == 0 and self.room >= ROOM

    @property
    def is_over(self) -> bool:
        """Whether nothing of it is left."""
        return self.planned.schedule is None or self.ran >= len(self.planned.schedule)

    def next_action(self) -> Action:
        """Of a plan that is not over."""
        action: Action = self.actions[self.ran]
        self.ran += 1
        return action

    @cached_property
    def actions(self) -> npt.NDArray[np.float32]:
        """(N, m + 1) commands of the simulated drives that execute the reference."""
        schedule = self.planned.schedule
        assert schedule is not None
        targets = self.profile.simulated_targets(schedule.reference[:, 0], schedule.ends)
        return np.column_stack([targets, schedule.commands])

    def record(self) -> PlanRecord:
        """For the episode's record."""
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
    """One turn of a step; it has another where what it took up is lost.

    Attributes:
        step: whose turn it is.
        plans: made in it, in order.
        tries: times that a strategy was executed to its end, by its name.
        acted: measured as the fingers had taken something last, or were about to let go.
    """

    step: Step
    plans: list[ChainPlan] = field(default_factory=list)
    tries: dict[str, int] = field(default_factory=dict)
    acted: Measurement | None = None

    def is_done(self, measured: Measurement) -> bool:
        """Whether it is done now; what is asked of the gripper counts as it took or let go, too: then it backs off."""
        return all(
            criterion.holds(measured)
            or (self.acted is not None and isinstance(criterion, OF_GRIPPER) and criterion.holds(self.acted))
            for criterion in self.step.done
        )


def best_of(plans: Sequence[ChainPlan]) -> ChainPlan | None:
    """The first of the best that have a motion."""
    return min((plan for plan in plans if plan.planned.schedule is not None), key=lambda plan: plan.rank, default=None)
