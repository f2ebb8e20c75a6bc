"""A task's steps one after the other: planned, watched, planned again where something goes otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
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

Array = npt.NDArray[np.float64]

NOT_DONE = "not done"
"""Triggers of plans beside deviations."""

MAX_ROUNDS = 8
"""Times that one step is planned in one episode, each time by its strategies in order until one is whole."""
MAX_TRIES = 2
"""Times that a strategy is executed to its end without its step being done."""
WAIT_SECONDS = 0.5
"""That a step has after its motion to become done, and that what slipped from the hand has to fall."""
CALM_SECONDS = 2.0
"""For which the arm waits at most for an object that rolls."""
CALM = 0.02
"""Speed (m/s) below which an object lies still enough to be planned for."""
CALM_JOINT = 0.02
"""Openness a second below which a joint stands still enough to be planned for, where it could not be as it moved."""
CALM_ARM = 0.02
"""Joint speed (rad/s, m/s) below which the arm does, likewise."""


class ChainController:
    """Executes the steps of a task in order.

    A step is planned on the scene as it stands at its turn. It is planned again, from the robot's present state and
    velocity, where its object drifts before it is touched or the fingers close on nothing; where what is held is lost,
    the step that took it up has its turn again; where a motion has ended and the step is not done, it is tried once
    more and then by the next strategy; where none can be planned, what is in the way is moved by a strategy that makes
    room. Plans are counted, and bounded by ``MAX_ROUNDS`` a step. A hand that is near
    what it has acted on when the last step is done goes back to the rest posture (:mod:`gensim2.rollout.retreat`).

    Args:
        task: whose steps.
        strategies: by name, as plain data or parsed.
        profile: the robot.
        open_loop: plan every step at the start, on the scenes that are foreseen, by the first strategy that is planned
            whole, and look at nothing afterwards.
        one_plan: plan every step once, at its turn, by its first strategy; the next one begins where its motion ends,
            whatever came of it.
        options: the solver's, for every plan.

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
        """Begin an episode; nothing is drawn but by the solver, whose seed is among its options."""
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
        """Reference of the last action; None where the arm is only held."""
        return self._reference

    @property
    def turn(self) -> str | None:
        """Name of the step whose turn it is."""
        return self._turns[-1].step.name if self._turns else None

    @property
    def history(self) -> list[StepRecord]:
        """One a step that was begun, with the plans of all its turns."""
        plans: dict[str, list[PlanRecord]] = {}
        for turn in self._turns:
            plans.setdefault(turn.step.name, []).extend(plan.record() for plan in turn.plans)
        # The loop says whether each was done: it sees what comes after the last action, too.
        return [StepRecord(name, records, paper=False, done=False) for name, records in plans.items()]

    @property
    def events(self) -> list[Event]:
        """Events so far, in order."""
        return list(self._events)

    @property
    def plans(self) -> list[tuple[Scene, StepPlan]]:
        """Every plan that was made, with the scene that it was made for."""
        return [(plan.scene, plan.planned) for turn in self._turns for plan in turn.plans]

    def act(self, observation: PrivilegedObservation) -> Action | None:
        """The next action, (m + 1,); None: done, or nothing more can be done."""
        self._reference = None
        self._last = self._blind(observation) if self._open_loop else self._next(observation)
        return self._last

    @property
    def _step(self) -> Step:
        return self._task.steps[self._at]

    def _turn(self) -> ChainTurn:
        """That of the present step; begun where it is not."""
        if not self._turns or self._turns[-1].step is not self._step:
            self._turns.append(ChainTurn(self._step))
        return self._turns[-1]

    def _next(self, observation: PrivilegedObservation) -> Action | None:
        if self._retreat is not None:
            return self._follow_retreat(self._retreat)
        while True:
            run = self._running
            if run is not None:
                turn = self._turns[-1]
                deviation = self._deviation(observation, run)
                if self._one_plan:
                    deviation = None  # noted, and nothing follows from it
                if deviation is None and not run.is_over:
                    return self._follow(run, observation)
                done = deviation is None and not run.makes_room and turn.is_done(observation.measurement)
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
        # Where the fingers press, the pads stay as far apart as what is between them.
        width = observation.measurement.finger_opening if np.isfinite(force) else self._profile_width(float(action[-1]))
        self._reference = Reference(positions, velocities, np.array([width, force], dtype=np.float32))
        return self._pressing(action, observation, run.scene.finger_stiffness)

    def _leave(self, observation: PrivilegedObservation, run: ChainPlan) -> Action | None:
        """Begin to go back from what was acted on; None where the hand is away from it, or is to stay."""
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
        return self._follow_retreat(retreat)

    def _follow_retreat(self, retreat: Retreat) -> Action | None:
        if retreat.is_over or self._last is None:
            return None
        row, command = retreat.ran, float(self._last[-1])
        retreat.ran += 1
        gripper = np.array([self._profile_width(command), np.nan], dtype=np.float32)
        self._reference = Reference(retreat.positions[row], retreat.velocities[row], gripper)
        return np.append(retreat.targets[row], command).astype(np.float32)

    def _profile_width(self, command: float) -> float:
        """Distance of the pads (m) that a gripper command asks for; commands change once in many steps."""
        if self._width is None or self._width[0] != command:
            gripper = self._profile.gripper
            self._width = command, gripper.opening(gripper.at_command(command))
        return self._width[1]

    def _pressing(self, action: Action, observation: PrivilegedObservation, stiffness: float | None) -> Action:
        """The action with fingers that press on what they hold as hard as they are to, however far they are apart.

        A finger's drive is a spring: on a thing that is narrower than planned, or into which the pads sink, as they do
        in some solvers, a target that was planned presses less.
        """
        held = self._held
        if held is None or held.force is None:
            return action
        command = grip_on(observation.measurement.finger_opening, held.force, self._profile, stiffness)
        return np.append(action[:-1], command).astype(np.float32)

    def _notice(self, observation: PrivilegedObservation, what: Cause | Literal["actuation"]) -> None:
        self._events.append(Event(observation.step, self._step.name, what))

    def _deviation(self, observation: PrivilegedObservation, run: ChainPlan) -> Cause | None:
        """Return the cause of a deviation from the plan, if any; updates what the hand holds."""
        found = self._look(observation, run)
        if found is not None:
            self._notice(observation, found)
        return found

    def _look(self, observation: PrivilegedObservation, run: ChainPlan) -> Cause | None:
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
        name = self._step.object
        until = schedule.actuation if run.scene.objects[name].is_rigid else schedule.contact
        # A plan is not held against the measurement that was taken just before it.
        if 0 < run.ran < until and has_drifted(run.scene, measured, name):
            return Cause.OBJECT_DRIFTED
        return None

    def _must_wait(self, observation: PrivilegedObservation) -> bool:
        """Whether what the step acts on still falls or rolls, or what could not be planned under way is not at rest;
        not for ever.
        """
        if self._trigger in (Cause.GRASP_LOST, Cause.GRASP_MISSED) and self._waited < self._profile.steps(WAIT_SECONDS):
            return True
        speed = observation.measurement.speeds.get(self._step.object)
        moves = speed is not None and self._step.object != self._holds and float(speed[0]) > CALM
        falls = self._trigger == Cause.OBJECT_DRIFTED and self._swings(observation)
        waits = self._waited < self._profile.steps(CALM_SECONDS)
        return waits and (moves or falls or (self._from_rest and self._is_under_way(observation)))

    def _is_calm(self, observation: PrivilegedObservation) -> bool:
        """Whether waiting for the arm and the joint to come to rest is of no use: it was done, or both are at rest."""
        return self._from_rest or not self._is_under_way(observation)

    def _is_under_way(self, observation: PrivilegedObservation) -> bool:
        """Whether the arm moves, or the joint of what the step acts on."""
        return self._swings(observation) or bool(np.abs(observation.qvel).max() > CALM_ARM)

    def _swings(self, observation: PrivilegedObservation) -> bool:
        """Whether the joint of what the step acts on moves."""
        return abs(observation.measurement.joint_speed.get(self._step.object, 0.0)) > CALM_JOINT

    def _stay(self, observation: PrivilegedObservation) -> Action:
        """Stop where the arm is, the fingers as they were commanded."""
        if self._last is not None and self._waited > 1:
            return self._last
        arm = observation.q[list(self._profile.arm_columns)]
        return np.append(arm, 1.0 if self._last is None else self._last[-1]).astype(np.float32)

    def _begin(self, observation: PrivilegedObservation) -> bool:
        """Plan the step whose turn it is; whether there is a motion."""
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
            if plan.is_best:
                break
        self._running = best_of(found)
        if self._running is None and held is None and not self._one_plan and self._is_calm(observation):
            self._running = self._make_room(scene, observation.step)
        return self._running is not None

    def _make_room(self, scene: Scene, at_step: int) -> ChainPlan | None:
        """Plan to move what is in the way of the present step; None where nothing is, or it cannot be moved."""
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
    def _holds(self) -> str | None:
        """Name of what is in the hand."""
        return None if self._held is None else self._held.name

    def _go_back(self) -> None:
        """Give the turn to the step that takes up what the present one needs in the hand, where it is not there."""
        if self._step.tool not in (HAND, self._holds):
            before = [i for i in range(self._at) if self._task.steps[i].object == self._step.tool]
            if before:
                self._at, self._trigger = before[-1], Cause.GRASP_LOST.value

    def _is_there_already(self, measured: Measurement) -> bool:
        """Give the turn to what comes after an object was put down, where a lost one has come to lie as the goal asks.

        The hand may not get at it there: a cup that slipped out of it over a box lies in that box.
        """
        if self._trigger != Cause.GRASP_LOST:
            return False
        name, steps = self._step.object, self._task.steps
        asked = tuple(c for c in self._task.success if isinstance(c, DistanceArticulatedRigid) and c.rigid == name)
        after = max((i + 1 for i in range(self._at, len(steps)) if steps[i].tool == name), default=len(steps))
        if not asked or after == len(steps) or not all_hold(asked, measured):
            return False
        self._at, self._trigger = after, START
        return True

    def _untried(self, turn: ChainTurn) -> list[str]:
        """Strategies that were not executed to the end often enough in this turn, in order of preference."""
        names = self._doing(turn.step)[: 1 if self._one_plan else None]
        return [name for name in names if turn.tries.get(name, 0) < MAX_TRIES]

    def _doing(self, step: Step) -> list[str]:
        """Strategies that do a step, in order of preference; not those that make room for it."""
        return [name for name in step.strategies if self._strategies[name].makes_room is None]

    def _foreseen(self, name: str) -> kpam.Plan | None:
        """The plan of the present step by a strategy that the grasp foresaw by which the hand holds something."""
        grasp = self._held_by
        if grasp is None or self._held is None or grasp.step != self._step.name:
            return None
        return grasp.plan if self._step.strategies[grasp.strategy] == name else None

    def _plan(self, scene: Scene, name: str, at_step: int, warm_start: kpam.Plan | None) -> ChainPlan:
        planned = self._planner.plan(
            scene,
            self._step,
            self._strategies[name],
            following=self._following(),
            warm_start=warm_start,
            lost=self._lost.get(self._step.object, ()),
        )
        room = room_for_hand(planned.after, self._step, self._task.steps[self._at + 1 :])
        return ChainPlan(name, planned, scene, at_step, self._trigger, self._profile, room)

    def _following(self) -> list[Ways]:
        later = self._task.steps[self._at + 1 :]
        return [(step, [self._strategies[each] for each in step.strategies]) for step in later]

    def _plan_ahead(self, scene: Scene) -> list[list[ChainPlan]]:
        """The plans of every step, a whole one last, up to the first step that has none."""
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
