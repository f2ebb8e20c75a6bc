"""Plan and execute a task's steps in order, and plan again if the scene deviates from the plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.planning.actions import grip_on
from gensim2.planning.scene import Scene
from gensim2.planning.step_plan import Foreseen, StepPlan, Ways
from gensim2.planning.steps import PLAN_OPTIONS, StepPlanner
from gensim2.planning.strategies import KeypointStrategy, Strategy, parse_strategy
from gensim2.robots import RobotProfile
from gensim2.rollout.chain_state import ChainPlan, ChainTurn, best_of, room_for_hand
from gensim2.rollout.controller import ACTUATION, PROPRIOCEPTIVE, Action, Event, PrivilegedObservation, Reference
from gensim2.rollout.record import START, Cause, PlanRecord, StepRecord
from gensim2.rollout.retreat import Retreat, is_near, planned_retreat
from gensim2.rollout.strict import is_about_the_gripper
from gensim2.rollout.watch import Held, has_drifted, taken
from gensim2.tasks.criteria import DistanceArticulatedRigid, all_hold
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import HAND, Step, TaskSpec

NOT_DONE = "not done"
"""Reasons for planning a step again, other than deviations from the plan."""

MAX_ROUNDS = 8
"""Maximum number of times that a step is planned in an episode; each time its strategies are tried in order."""
MAX_TRIES = 2
"""Maximum number of times that a strategy is executed without completing its step."""
MAX_TIGHT = 3
"""Number of plans with little clearance for the grasped object after which no further strategy is planned."""
WAIT_SECONDS = 0.5
"""Maximum time (s) for which the arm waits: after a motion for the step to be done, or for a lost object to fall."""
CALM_SECONDS = 2.0
"""Maximum time (s) for which the arm waits for a rolling object."""
CALM = 0.02
"""Maximum speed (m/s) of an object at which a step is planned."""
CALM_JOINT = 0.02
"""Openness change per second below which a joint counts as still; used if planning failed while the joint moved."""
CALM_ARM = 0.02
"""Joint speed (rad/s or m/s) below which the arm counts as still; used if planning failed while the arm moved."""


class ChainController:
    """Controller that plans and executes the steps of a task in order.

    Each step is planned when it starts, on the current scene. The controller reacts to problems as follows:

    - If the object moves before the hand touches it, or if the fingers close on nothing, the step is planned again from
      the robot's current state and velocity.
    - If a grasped object is lost, the step that grasped the object is repeated.
    - If a motion ends but the step's criterion is not met, the same strategy is tried once more, then the next
      strategy. A step that grasps the tool of the next step needs only the grasp.
    - If no strategy can be planned, the controller uses a strategy with the field ``makes_room``, which moves an
      obstacle away.

    A step is planned at most ``MAX_ROUNDS`` times. After the last step the hand returns to the rest pose if it is near
    the objects (:mod:`gensim2.rollout.retreat`).

    Args:
        strategies: strategies by name, as plain data or parsed.
        open_loop: whether to plan all steps at the start, on predicted scenes. Each step then uses the first strategy
            that has a complete plan, and the controller does not react to deviations.
        one_plan: whether to plan every step only once, with its first strategy, and always to continue with the next
            step.
        options: solver options for every plan.

    Raises:
        InputError: a strategy cannot be used.
    """

    privileged = True
    observation_spec = PROPRIOCEPTIVE

    def __init__(
        self,
        task: TaskSpec,
        strategies: Mapping[str, Mapping[str, Any] | Strategy],
        profile: RobotProfile,
        *,
        open_loop: bool = False,
        one_plan: bool = False,
        options: kpam.Options = PLAN_OPTIONS,
    ) -> None:
        self._task, self._profile, self._options = task, profile, options
        self._open_loop, self._one_plan = open_loop, one_plan
        self._most_rounds = 1 if one_plan else MAX_ROUNDS
        self._strategies: dict[str, Strategy] = {
            name: parse_strategy(given, f"strategies/{name}.yaml") if isinstance(given, Mapping) else given
            for name, given in strategies.items()
        }

    def reset(self, observation: PrivilegedObservation, seed: int = 0) -> None:
        """Start an episode. The controller ignores ``seed``: the seed of the solver is one of the solver options."""
        self._planner = StepPlanner(self._profile, self._options)
        self._turns: list[ChainTurn] = []
        self._rounds: dict[str, int] = {}
        self._events: list[Event] = []
        self._at = 0
        self._running: ChainPlan | None = None
        self._retreat: Retreat | None = None
        self._held: Held | None = None
        self._held_by: Foreseen | None = None
        self._lost: dict[str, list[Array]] = {}
        self._trigger = START
        self._waited = 0
        self._from_rest = False
        self._last: Action | None = None
        self._reference: Reference | None = None
        self._width: tuple[float, float] | None = None
        self._ahead = self._plan_ahead(observation.scene()) if self._open_loop else []

    @property
    def reference(self) -> Reference | None:
        """Desired joint state from which the last action was computed; None while the arm waits."""
        return self._reference

    @property
    def turn(self) -> str | None:
        return self._turns[-1].step.name if self._turns else None

    @property
    def history(self) -> list[StepRecord]:
        """Return a record of each started step, with all plans of the step."""
        plans: dict[str, list[PlanRecord]] = {}
        for turn in self._turns:
            plans.setdefault(turn.step.name, []).extend(plan.record() for plan in turn.plans)
        # The episode loop determines ``done``, because it also measures the state after the last action.
        return [StepRecord(name, records, paper=False, done=False) for name, records in plans.items()]

    @property
    def events(self) -> list[Event]:
        return list(self._events)

    @property
    def plans(self) -> list[tuple[Scene, StepPlan]]:
        """Return every plan with the scene that it was made for."""
        return [(plan.scene, plan.planned) for turn in self._turns for plan in turn.plans]

    def act(self, observation: PrivilegedObservation) -> Action | None:
        """Return the next action (m + 1,), or None if the task is done or no step has a plan."""
        self._reference = None
        self._last = self._blind(observation) if self._open_loop else self._next(observation)
        return self._last

    @property
    def _step(self) -> Step:
        return self._task.steps[self._at]

    def _turn(self) -> ChainTurn:
        """Return the record of the current execution of the step; create the record if the step has not started."""
        if not self._turns or self._turns[-1].step is not self._step:
            self._turns.append(ChainTurn(self._step))
        return self._turns[-1]

    def _next(self, observation: PrivilegedObservation) -> Action | None:
        if self._retreat is not None:
            return self._follow_retreat(observation, self._retreat)
        while True:
            run = self._running
            if run is not None:
                turn = self._turns[-1]
                deviation = self._deviation(observation, run)
                if self._one_plan:
                    # A controller with a single plan does not plan again. The deviation has already been recorded as an
                    # event, so ignore it here.
                    deviation = None
                if deviation is None and not run.is_over:
                    return self._follow(run, observation)
                is_done = turn.is_done(observation.measurement) or self._has_tool_of_next
                done = deviation is None and not run.makes_room and is_done
                if deviation is None and not done and self._waited < self._profile.steps(WAIT_SECONDS):
                    self._waited += 1
                    return self._last
                self._running, self._waited = None, 0
                over = done or self._one_plan
                if over and self._at + 1 == len(self._task.steps):
                    return self._leave(observation, run) if done and not self._one_plan else None
                if over:
                    self._at, self._trigger = self._at + 1, START
                    continue
                if deviation is None:
                    turn.tries[run.strategy] = turn.tries.get(run.strategy, 0) + 1
                self._trigger = NOT_DONE if deviation is None else deviation.value
            if not self._one_plan:
                self._go_back()
            if self._must_wait(observation):
                self._waited += 1
                return self._stay(observation)
            self._waited = 0
            if self._is_there_already(observation.measurement):
                continue
            if self._begin(observation):
                self._from_rest = False
            elif self._leaves_placed(observation.measurement):
                continue
            elif self._is_calm(observation):
                return None
            else:
                self._from_rest = True

    def _follow(self, run: ChainPlan, observation: PrivilegedObservation) -> Action:
        assert run.planned.schedule is not None
        if run.ran == run.planned.schedule.actuation:
            self._notice(observation, ACTUATION)
        positions, velocities = run.planned.schedule.reference[run.ran]
        action = run.next_action()
        force = np.nan if self._held is None or self._held.force is None else self._held.force
        # While the fingers press on an object, record the measured distance between the pads instead of the commanded
        # distance.
        width = observation.measurement.finger_opening if np.isfinite(force) else self._profile_width(float(action[-1]))
        self._reference = Reference(positions, velocities, np.array([width, force], dtype=np.float32))
        return self._pressing(action, observation, run.scene.finger_stiffness)

    def _leave(self, observation: PrivilegedObservation, run: ChainPlan) -> Action | None:
        """Plan the motion that moves the hand away from the objects after the last step, and return the first action of
        the motion.

        The result is None if the hand is already far from the objects, if it must keep its grasp or position for the
        goal, or if the remaining time is too short for the motion.
        """
        strategy = self._strategies[run.strategy]
        stays = isinstance(strategy, KeypointStrategy) and strategy.solver_config.let_go is None
        if stays or self._held is not None or is_about_the_gripper(self._task):
            return None
        names = self._task.acted_on
        near = is_near(observation.measurement, names)
        retreat = planned_retreat(self._planner.world, observation.scene(), names, near, self._profile)
        if retreat is None or observation.step + len(retreat.targets) + self._profile.steps(
            CALM_SECONDS
        ) > self._profile.steps(self._task.max_seconds):
            return None
        self._retreat = retreat
        return self._follow_retreat(observation, retreat)

    def _follow_retreat(self, observation: PrivilegedObservation, retreat: Retreat) -> Action | None:
        if retreat.is_over or self._last is None:
            return None
        row, command = retreat.ran, float(self._last[-1])
        retreat.ran += 1
        gripper = np.array([self._profile_width(command), np.nan], dtype=np.float32)
        self._reference = Reference(retreat.positions[row], retreat.velocities[row], gripper)
        return np.append(retreat.targets[row], command).astype(np.float32)

    def _profile_width(self, command: float) -> float:
        """Return the distance between the pads (m) for a gripper command; the last result is cached."""
        if self._width is None or self._width[0] != command:
            gripper = self._profile.gripper
            self._width = command, gripper.opening(gripper.at_command(command))
        return self._width[1]

    def _pressing(self, action: Action, observation: PrivilegedObservation, stiffness: float | None) -> Action:
        """Return the action with a gripper command at which the fingers press on the grasped object with the planned
        force.

        The drive of a finger acts as a spring: its force grows with the distance between the commanded and the actual
        position. If the object is narrower than planned, or if the simulator lets the pads sink into the object, the
        planned command would give a smaller force. Therefore the command is computed from the current distance of the
        pads.
        """
        held = self._held
        if held is None or held.force is None:
            return action
        command = grip_on(observation.measurement.finger_opening, held.force, self._profile, stiffness)
        return np.append(action[:-1], command).astype(np.float32)

    def _notice(self, observation: PrivilegedObservation, what: Cause | Literal["actuation"]) -> None:
        self._events.append(Event(observation.step, self._step.name, what))

    def _deviation(self, observation: PrivilegedObservation, run: ChainPlan) -> Cause | None:
        """Check whether execution deviates from the plan, and record a deviation as an event. The method also updates
        which object the hand holds.

        Returns:
            Cause of the deviation; None if there is no deviation.
        """
        found = self._look(observation, run)
        if found is not None:
            self._notice(observation, found)
        return found

    def _look(self, observation: PrivilegedObservation, run: ChainPlan) -> Cause | None:
        measured, schedule = observation.measurement, run.planned.schedule
        assert schedule is not None
        found = self._check_grasp(observation, run)
        if found is not None:
            return found
        name = self._step.object
        until = schedule.actuation if run.scene.objects[name].is_rigid else schedule.contact
        # Before the first action of a plan, the object cannot have drifted, because the plan was made from the same
        # measurement.
        if 0 < run.ran < until and has_drifted(run.scene, measured, name):
            return Cause.OBJECT_DRIFTED
        return None

    def _check_grasp(self, observation: PrivilegedObservation, run: ChainPlan) -> Cause | None:
        """Update which object the hand holds. Return the cause if the fingers have missed or lost the object."""
        measured, schedule = observation.measurement, run.planned.schedule
        assert schedule is not None
        if run.ran == schedule.gripped and run.planned.picks is not None:
            self._held = taken(self._profile, observation.q, measured, run.planned)
            self._held_by = run.planned.foreseen
            if self._held is None:
                if run.planned.T_object_hand is not None:
                    self._lost.setdefault(run.planned.picks, []).append(run.planned.T_object_hand)
                return Cause.GRASP_MISSED
            self._turns[-1].acted = measured
        if run.ran == schedule.released:
            self._turns[-1].acted = measured
        if schedule.released is not None and run.ran >= schedule.released:
            self._held = None
        if self._held is not None and self._held.is_lost(self._profile, observation.q, measured):
            T_object_hand: Array = np.linalg.inv(self._held.T_hand_object).astype(np.float64)
            self._lost.setdefault(self._held.name, []).append(T_object_hand)
            self._held = None
            return Cause.GRASP_LOST
        return None

    def _must_wait(self, observation: PrivilegedObservation) -> bool:
        """Return whether planning must wait, because the object still moves or the arm is not at rest.

        The waiting time is limited.
        """
        if self._trigger in (Cause.GRASP_LOST, Cause.GRASP_MISSED) and self._waited < self._profile.steps(WAIT_SECONDS):
            return True
        speed = observation.measurement.speeds.get(self._step.object)
        moves = speed is not None and self._step.object != self._holds and float(speed[0]) > CALM
        falls = self._trigger == Cause.OBJECT_DRIFTED and self._swings(observation)
        waits = self._waited < self._profile.steps(CALM_SECONDS)
        return waits and (moves or falls or (self._from_rest and self._is_under_way(observation)))

    def _is_calm(self, observation: PrivilegedObservation) -> bool:
        """Return whether the arm and the object's joint are at rest, or the time limit for waiting is reached."""
        return self._from_rest or not self._is_under_way(observation)

    def _is_under_way(self, observation: PrivilegedObservation) -> bool:
        """Return whether the arm or the joint of the step's object moves."""
        return self._swings(observation) or bool(np.abs(observation.qvel).max() > CALM_ARM)

    def _swings(self, observation: PrivilegedObservation) -> bool:
        """Return whether the joint of the step's object moves."""
        return abs(observation.measurement.joint_speed.get(self._step.object, 0.0)) > CALM_JOINT

    def _stay(self, observation: PrivilegedObservation) -> Action:
        """Return an action that holds the arm where it is, with the last gripper command."""
        if self._last is not None and self._waited > 1:
            return self._last
        arm = observation.q[list(self._profile.arm_columns)]
        return np.append(arm, 1.0 if self._last is None else self._last[-1]).astype(np.float32)

    def _begin(self, observation: PrivilegedObservation) -> bool:
        """Plan the current step; return whether a motion was found."""
        if self._rounds.get(self._step.name, 0) >= self._most_rounds or self._step.tool not in (HAND, self._holds):
            return False
        self._rounds[self._step.name] = self._rounds.get(self._step.name, 0) + 1
        turn = self._turn()
        held = self._held
        scene = observation.scene()
        if held is not None:
            scene = replace(scene, held=held.name, held_width=held.width, held_force=held.force)
        found: list[ChainPlan] = []
        for name in self._untried(turn):
            warm_start = next((plan.planned.plan for plan in reversed(turn.plans) if plan.strategy == name), None)
            if warm_start is None or warm_start.trajectory is None:
                warm_start = self._foreseen(name)
            plan = self._plan(scene, name, observation.step, warm_start)
            turn.plans.append(plan)
            found.append(plan)
            tight = sum(each.planned.is_tight for each in found)
            if plan.is_best or tight == MAX_TIGHT:
                break
        self._running = best_of(found)
        if self._running is None and held is None and not self._one_plan and self._is_calm(observation):
            self._running = self._make_room(scene, observation.step)
        return self._running is not None

    def _make_room(self, scene: Scene, at_step: int) -> ChainPlan | None:
        """Plan to move an obstacle out of the way of the current step; None if there is no obstacle or no plan."""
        turn, step = self._turn(), self._step
        following = self._following()
        ways = [self._strategies[name] for name in self._doing(step)]
        for name in step.strategies:
            strategy = self._strategies[name]
            if strategy.makes_room is None or turn.tries.get(name, 0) >= MAX_TRIES:
                continue
            planned = self._planner.make_room(scene, step, strategy, ways, following)
            if planned is not None:
                turn.plans.append(
                    ChainPlan(name, planned, scene, at_step, self._trigger, self._profile, makes_room=True)
                )
                return turn.plans[-1]
        return None

    @property
    def _has_tool_of_next(self) -> bool:
        """Whether the hand holds the object of the current step, which the next step needs. The criterion of a grasp
        may still be false, because the hand may hold a long object far from its measured keypoint.
        """
        following = self._task.steps[self._at + 1 : self._at + 2]
        return bool(following) and following[0].tool == self._step.object == self._holds

    @property
    def _holds(self) -> str | None:
        return None if self._held is None else self._held.name

    def _go_back(self) -> None:
        """If the current step needs an object that is not in the hand, continue with the step that grasps this
        object.
        """
        if self._step.tool not in (HAND, self._holds):
            before = [i for i in range(self._at) if self._task.steps[i].object == self._step.tool]
            if before:
                self._at, self._trigger = before[-1], Cause.GRASP_LOST.value

    def _is_there_already(self, measured: Measurement) -> bool:
        """Return whether a lost object already lies where the goal requires. If it does, continue with the step after
        its placement.

        For example, a cup that was dropped already lies in the box. The hand may be unable to reach the cup there, and
        does not need to reach it.
        """
        return self._trigger == Cause.GRASP_LOST and self._skip_placement(measured)

    def _leaves_placed(self, measured: Measurement) -> bool:
        """Return whether the controller leaves an object that it cannot grasp where it is, and continues with the step
        after its placement.
        """
        return False

    def _skip_placement(self, measured: Measurement, slack: float = 0.0) -> bool:
        """Continue with the step after the placement of the current step's object, if the object lies where the goal
        requires. Return whether it does.

        Args:
            measured: current state.
            slack: distance (m) by which the object may be farther from its goal than the criterion permits.
        """
        name, steps = self._step.object, self._task.steps
        asked = tuple(
            c.model_copy(update={"threshold": c.threshold + slack})
            for c in self._task.success
            if isinstance(c, DistanceArticulatedRigid) and c.rigid == name
        )
        after = max((i + 1 for i in range(self._at, len(steps)) if steps[i].tool == name), default=len(steps))
        if not asked or after == len(steps) or not all_hold(asked, measured):
            return False
        self._at, self._trigger = after, START
        return True

    def _untried(self, turn: ChainTurn) -> list[str]:
        """Return the strategies that may still be tried in the present execution of the step, in order of preference.

        ``turn`` is the record of this execution. It counts how often each strategy was tried, and each may be tried at
        most ``MAX_TRIES`` times.
        """
        names = self._doing(turn.step)[: 1 if self._one_plan else None]
        return [name for name in names if turn.tries.get(name, 0) < MAX_TRIES]

    def _doing(self, step: Step) -> list[str]:
        """Return the strategies of a step, in order of preference, without strategies that only move obstacles."""
        return [name for name in step.strategies if self._strategies[name].makes_room is None]

    def _foreseen(self, name: str) -> kpam.Plan | None:
        """Return the plan that was made in advance for the current step and the strategy ``name``, or None.

        When the planner chooses a grasp, it also plans the later step that uses the grasped object. That plan is
        available while the hand still holds the object.
        """
        grasp = self._held_by
        if grasp is None or self._held is None or grasp.step != self._step.name:
            return None
        return grasp.plan if self._step.strategies[grasp.strategy] == name else None

    def _variants(self, strategy: Strategy, scene: Scene) -> Sequence[Strategy]:
        """Return the variants of a strategy that are planned on a scene, in order of preference."""
        return (strategy,)

    def _plan(self, scene: Scene, name: str, at_step: int, warm_start: kpam.Plan | None) -> ChainPlan:
        """Return the best plan of the current step with the variants of the strategy ``name``."""
        later = self._task.steps[self._at + 1 :]
        plans = []
        for strategy in self._variants(self._strategies[name], scene):
            planned = self._planner.plan(
                scene,
                self._step,
                strategy,
                following=self._following(),
                warm_start=warm_start,
                lost=self._lost.get(self._step.object, ()),
            )
            room = room_for_hand(planned.after, self._step, later)
            plans.append(ChainPlan(name, planned, scene, at_step, self._trigger, self._profile, room))
            if plans[-1].is_best:
                break
        return best_of(plans) or plans[-1]

    def _following(self) -> list[Ways]:
        later = self._task.steps[self._at + 1 :]
        return [(step, [self._strategies[each] for each in step.strategies]) for step in later]

    def _plan_ahead(self, scene: Scene) -> list[list[ChainPlan]]:
        """Plan the steps on predicted scenes until a step cannot be planned, and return the plans of each step."""
        ahead: list[list[ChainPlan]] = []
        for number, step in enumerate(self._task.steps):
            self._at = number
            plans: list[ChainPlan] = []
            for name in self._doing(step):
                plans.append(self._plan(scene, name, 0, None))
                if plans[-1].is_best:
                    break
            ahead.append(plans)
            best = best_of(plans)
            if best is None or best.planned.after is None or not best.planned.is_solved:
                break
            scene = best.planned.after
        self._at = 0
        return ahead

    def _blind(self, observation: PrivilegedObservation) -> Action | None:
        while True:
            run = self._running
            if run is not None and not run.is_over:
                return self._follow(run, observation)
            if run is not None:
                self._at += 1
            if not self._ahead:
                return None
            plans = self._ahead.pop(0)
            self._turn().plans.extend(plans)
            self._running = best_of(plans)
            if self._running is None:
                return None
