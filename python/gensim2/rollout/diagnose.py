"""Find out why an episode failed, and describe the cause with measured values.

Steps are checked up to the first step that was not done. Its cause is the first of:

1. the last deviation from the plan that the controller reported in this step;
2. a fault of the step's last plan;
3. a fault that the measurements during the step show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from gensim2.planning.step_plan import INVALID, NO_GRASP
from gensim2.planning.strategies import MAKES_ROOM
from gensim2.rollout.controller import ACTUATION, Event
from gensim2.rollout.measured_faults import (
    Surfaces,
    distance_apart,
    drift,
    fault_of_criterion,
    released,
    was_left_behind,
    was_lifted,
)
from gensim2.rollout.record import Cause, PlanRecord, StepRecord
from gensim2.rollout.turns import Turn
from gensim2.tasks.criteria import DistanceArticulatedRigid, DistanceGripperRigid, RigidLifted, all_hold
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import HAND, Step, TaskSpec

Fault = tuple[Cause, dict[str, Any]]

PLAN_CAUSES = {
    INVALID: Cause.INVALID_PROBLEM,
    "actuation_infeasible": Cause.NO_ACTUATION_POSE,
    "unreachable": Cause.KEYFRAME_OUT_OF_REACH,
    "collision": Cause.COLLISION_ON_THE_WAY,
    NO_GRASP: Cause.NO_GRASP,
}
"""Cause of failure for each status of a plan without a motion; other statuses give ``NO_MOTION_FOUND``."""


@dataclass(frozen=True)
class Outcome:
    """Facts about the end of an episode, which :func:`diagnose` uses to find the cause of a failure.

    Attributes:
        goal: whether the goal is reached at the end.
        stable: whether the simulation was stable, both in the episode and in the no-op baseline.
        settled: whether the scene was at rest when the episode was evaluated.
        cut: whether the time limit ended the episode before the controller ended it.
        truncated: whether the episode was longer than the task allows. This is also true if ``cut`` is true.
        by_itself: whether the goal is reached in the no-op baseline, that is, without a moving arm.
    """

    goal: bool
    stable: bool
    settled: bool
    cut: bool
    truncated: bool
    by_itself: bool


def diagnose(
    task: TaskSpec,
    trace: Sequence[Measurement],
    turns: Sequence[Turn],
    history: Sequence[StepRecord],
    events: Sequence[Event],
    outcome: Outcome,
    surfaces: Surfaces,
) -> Fault:
    """Return the cause of a failure, with measured values as plain data.

    Args:
        trace: measurements before the first control step and after each one.
        turns: for each executed step, the range of measurements in ``trace`` during the step.
        events: events reported by the controller.
        outcome: how the failed episode ended.
        surfaces: surfaces of the objects at the end.
    """
    if not outcome.stable:
        return Cause.UNSTABLE, {}
    steps = len(trace) - 1
    if outcome.goal and steps:
        if outcome.by_itself:
            return Cause.HAPPENS_BY_ITSELF, {}
        if outcome.truncated:
            return Cause.TIME_OVER, {"control_steps": steps}
        if not outcome.settled:
            return Cause.STILL_MOVING, _speeds(trace[-1])
    episode = _Facts(task, trace, turns, {record.name: record for record in history}, events, outcome, surfaces)
    for index, step in enumerate(task.steps):
        fault = episode.fault_of(index, step)
        if fault is not None:
            cause, numbers = fault
            return cause, {"step": step.name, **episode.context(step), **numbers}
    return Cause.GOAL_UNDONE, _goal_numbers(task, trace[-1])


@dataclass(frozen=True)
class _Facts:
    task: TaskSpec
    trace: Sequence[Measurement]
    turns: Sequence[Turn]
    records: dict[str, StepRecord]
    events: Sequence[Event]
    outcome: Outcome
    surfaces: Surfaces

    def fault_of(self, index: int, step: Step) -> Fault | None:
        """Return the fault of a step; None if the step was done."""
        record = self.records.get(step.name)
        if record is None:
            return Cause.TIME_OVER, {"control_steps": len(self.trace) - 1}
        went_on = any(later.name in self.records for later in self.task.steps[index + 1 :])
        is_last = index + 1 == len(self.task.steps)
        own = [turn for turn in self.turns if turn.step.name == step.name]
        if record.paper and (went_on or is_last) and not self._is_stuck(record):
            # A step that met its criteria can still be faulty. The controller may have given up after a deviation, a
            # grasp may have failed, or the criteria may have held only while the hand held the object.
            gave_up = self._given_up(step) if not went_on else None
            return gave_up or self._missed_grasp(index, step, own) or self._passed_by(record, step, own)
        noticed = [event for event in self.events if event.step == step.name and event.what != ACTUATION]
        if noticed:
            return Cause(noticed[-1].what), dict(noticed[-1].detail)
        if (fault := _fault_of_plans(record.plans)) is not None:
            return fault
        if record.paper and step.done:
            return Cause.GOAL_UNDONE, {}
        if own and (fault := self._missed_grasp(index, step, own)) is not None:
            return fault
        if own and step.done:
            measured = self.trace[own[0].first : own[-1].last + 1]
            if (fault := fault_of_criterion(step, measured, self._at_actuation(step), self.surfaces)) is not None:
                return fault
        return (Cause.TIME_OVER if self.outcome.cut else Cause.STOPPED_SHORT), {}

    def context(self, step: Step) -> dict[str, Any]:
        """Return the context of a step's fault: the step's last plan, and all deviations so far."""
        record = self.records.get(step.name)
        found: dict[str, Any] = {}
        if record is not None and record.plans:
            plan = record.plans[-1]
            found |= {"strategy": plan.strategy, "status": plan.status, "reason": plan.reason}
            found |= {"plan": plan.detail} if plan.detail else {}
        deviations = [{**asdict(e), "what": str(e.what)} for e in self.events if e.what != ACTUATION]
        return found | ({"deviations": deviations} if deviations else {})

    def _is_stuck(self, record: StepRecord) -> bool:
        """Return whether a step was not executed because no motion was found."""
        return bool(record.plans) and all(plan.ran == 0 for plan in record.plans) and not _has_motion(record.plans[-1])

    def _given_up(self, step: Step) -> Fault | None:
        """Return the step's last deviation as a fault; None if there is none or the hand was later in place."""
        last = next((event for event in reversed(self.events) if event.step == step.name), None)
        return None if last is None or last.what == ACTUATION else (Cause(last.what), dict(last.detail))

    def _missed_grasp(self, index: int, step: Step, own: Sequence[Turn]) -> Fault | None:
        """Return the fault of a step that did not lift its object or lost it later. Return None for other steps."""
        wanted = {later.tool for later in self.task.steps[index + 1 :]}
        wanted |= {c.rigid for c in self.task.success if isinstance(c, DistanceGripperRigid | RigidLifted)}
        if step.object not in wanted or not own or own[-1].last == own[-1].first:
            return None
        measured = self.trace[own[-1].first : own[-1].last + 1]
        distance = was_left_behind(measured, step.object)
        if distance is None:
            return None
        moved = drift(measured, self._at_actuation(step), step.object)
        if moved is not None:
            return Cause.OBJECT_DRIFTED, {"distance": moved}
        lost = was_lifted(measured, step.object)
        return (Cause.GRASP_LOST if lost else Cause.GRASP_MISSED), {"distance": distance}

    def _passed_by(self, record: StepRecord, step: Step, own: Sequence[Turn]) -> Fault | None:
        """Return the fault of a step whose criterion was met only while the hand held the object."""
        if record.done or step.tool == HAND or not step.done or not own:
            return None
        measured = self.trace[own[-1].first : own[-1].last + 1]
        let_go = released(measured)
        if let_go is not None and all_hold(step.done, let_go):
            return None
        return fault_of_criterion(step, measured, None, self.surfaces)

    def _at_actuation(self, step: Step) -> Measurement | None:
        found = [e.at_step for e in self.events if e.step == step.name and e.what == ACTUATION]
        return self.trace[found[-1]] if found else None


def _has_motion(plan: PlanRecord) -> bool:
    return plan.status in ("solved", "partial")


def _fault_of_plans(plans: Sequence[PlanRecord]) -> Fault | None:
    """Return the fault of the last executed plan, or of the last plan if none was executed.

    Plans that only move obstacles are ignored."""
    if not plans:
        return None
    followed = [plan for plan in plans if plan.ran and not plan.detail.get(MAKES_ROOM)]
    plan = followed[-1] if followed else plans[-1]
    if plan.status == "solved":
        return None
    if plan.status in PLAN_CAUSES:
        return PLAN_CAUSES[plan.status], {}
    if plan.detail.get("collisions"):
        return Cause.COLLISION_ON_THE_WAY, {}
    if plan.detail.get("unreached"):
        return Cause.KEYFRAME_OUT_OF_REACH, {}
    return Cause.NO_MOTION_FOUND, {}


def _speeds(measured: Measurement) -> dict[str, Any]:
    joints = {name: float(speed) for name, speed in measured.joint_speed.items()}
    return {"speeds": joints | {name: float(speed[0]) for name, speed in measured.speeds.items()}}


def _goal_numbers(task: TaskSpec, measured: Measurement) -> dict[str, Any]:
    """Return the measured values of the goal's criteria that are not met."""
    failing = [criterion for criterion in task.success if not criterion.holds(measured)]
    distances = {
        c.rigid: distance_apart(measured, c.articulated, c.rigid)
        for c in failing
        if isinstance(c, DistanceArticulatedRigid)
    }
    numbers = {"failing": [criterion.type for criterion in failing], "openness": dict(measured.openness)}
    return numbers | ({"distances": distances} if distances else {})
