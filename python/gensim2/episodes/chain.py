"""A task's steps one after the other: planned, watched, planned again where something goes otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import gensim2_kpam as kpam
from gensim2.episodes.controller import Action, Observation
from gensim2.episodes.record import PlanRecord, StepRecord
from gensim2.episodes.watch import DRIFTED, LOST, MISSED, NOT_DONE, Held, has_drifted, taken
from gensim2.planning.scene import Scene
from gensim2.planning.steps import PLAN_OPTIONS, StepPlan, StepPlanner, Ways
from gensim2.planning.strategies import Strategy, parse_strategy
from gensim2.robots import RobotProfile
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import HAND, Step, TaskSpec

START = "start"

MOST_PLANS = 8
"""Plans of one step in one episode."""
MOST_TRIES = 2
"""Times that a strategy is executed to its end without its step being done."""
WAIT_STEPS = 10
"""Control steps that a step has after its motion to become done."""
CALM_STEPS = 40
"""Control steps for which the arm waits at most for an object that rolls."""
CALM = 0.02
"""Speed (m/s) below which an object lies still enough to be planned for."""


@dataclass
class _Plan:
    """A plan and what becomes of it."""

    strategy: str
    planned: StepPlan
    scene: Scene
    at_step: int
    trigger: str
    ran: int = 0

    @property
    def is_over(self) -> bool:
        return self.planned.schedule is None or self.ran >= len(self.planned.schedule)

    def next_action(self) -> Action:
        """Of a plan that is not over."""
        assert self.planned.schedule is not None
        action: Action = self.planned.schedule.actions[self.ran]
        self.ran += 1
        return action

    def record(self) -> PlanRecord:
        planned = self.planned
        return PlanRecord(
            strategy=self.strategy,
            status=planned.status,
            reason=planned.reason,
            at_step=self.at_step,
            trigger=self.trigger,
            ran=self.ran,
            detail=planned.detail(),
        )


@dataclass
class _Turn:
    """What became of one step."""

    step: Step
    plans: list[_Plan] = field(default_factory=list)
    tries: dict[str, int] = field(default_factory=dict)
    paper: bool = False
    done: bool = False

    def note(self, measured: Measurement) -> None:
        self.done = all_hold(self.step.done, measured)
        self.paper |= self.done

    def record(self) -> StepRecord:
        return StepRecord(self.step.name, [plan.record() for plan in self.plans], self.paper, self.done)


class ChainController:
    """Executes the steps of a task in order.

    A step is planned on the scene as it stands at its turn. It is planned again, from the robot's present state and
    velocity, where its object drifts before it is touched or the fingers close on nothing; where what is held is lost,
    the step that took it up has its turn again; where a motion has ended and the step is not done, it is tried once
    more and then by the next strategy. Plans are counted, and bounded by ``MOST_PLANS`` a step.

    Args:
        task: whose steps.
        strategies: by name, as plain data or parsed.
        profile: the robot.
        open_loop: plan every step at the start, on the scenes that are foreseen, by its first strategy, and look at
            nothing afterwards.
        options: the solver's, for every plan.

    Raises:
        InputError: a strategy cannot be used.
    """

    def __init__(
        self,
        task: TaskSpec,
        strategies: Mapping[str, Mapping[str, Any] | Strategy],
        profile: RobotProfile,
        *,
        open_loop: bool = False,
        options: kpam.Options = PLAN_OPTIONS,
    ) -> None:
        self._task, self._profile, self._options = task, profile, options
        self._open_loop = open_loop
        self._strategies: dict[str, Strategy] = {
            name: parse_strategy(given) if isinstance(given, Mapping) else given for name, given in strategies.items()
        }

    def reset(self, scene: Scene) -> None:
        """Begin an episode in ``scene``."""
        self._planner = StepPlanner(self._profile, self._options)
        self._turns: dict[str, _Turn] = {}
        self._at = 0
        self._running: _Plan | None = None
        self._held: Held | None = None
        self._trigger = START
        self._waited = 0
        self._last: Action | None = None
        self._over = False
        if self._open_loop:
            self._plan_ahead(scene)

    @property
    def steps(self) -> list[StepRecord]:
        """The steps that were begun, with all their plans."""
        return [turn.record() for turn in self._turns.values()]

    @property
    def plans(self) -> list[tuple[Scene, StepPlan]]:
        """Every plan that was made, with the scene that it was made for."""
        return [(plan.scene, plan.planned) for turn in self._turns.values() for plan in turn.plans]

    def act(self, observation: Observation) -> Action | None:
        """The next action, (m + 1,); None: done, or nothing more can be done."""
        if not self._over:
            action = self._blind(observation) if self._open_loop else self._next(observation)
            if action is not None:
                self._last = action
                return action
            self._over = True
        if self._at < len(self._task.steps):
            self._turn.note(observation.measurement)  # it may yet come true while all comes to rest
        return None

    @property
    def _step(self) -> Step:
        return self._task.steps[self._at]

    @property
    def _turn(self) -> _Turn:
        return self._turns.setdefault(self._step.name, _Turn(self._step))

    def _next(self, observation: Observation) -> Action | None:
        measured = observation.measurement
        while True:
            self._turn.note(measured)
            run = self._running
            if run is not None:
                schedule = run.planned.schedule
                assert schedule is not None
                deviation = self._deviation(observation, run)
                if deviation is None and not run.is_over:
                    return run.next_action()
                if deviation is None and not self._turn.done and self._waited < WAIT_STEPS:
                    self._waited += 1
                    return self._last
                self._running, self._waited = None, 0
                if deviation is None and self._turn.done:
                    if self._at + 1 == len(self._task.steps):
                        return None
                    self._at, self._trigger = self._at + 1, START
                    continue
                if deviation is None:
                    self._turn.tries[run.strategy] = self._turn.tries.get(run.strategy, 0) + 1
                self._trigger = deviation or NOT_DONE
            if self._must_wait(measured):
                self._waited += 1
                return self._stay(observation)
            self._waited = 0
            if not self._begin(observation):
                return None

    def _deviation(self, observation: Observation, run: _Plan) -> str | None:
        """What goes otherwise than planned; takes note of what the hand takes and releases."""
        measured, schedule = observation.measurement, run.planned.schedule
        assert schedule is not None
        if run.ran == schedule.gripped and run.planned.picks is not None:
            self._held = taken(self._profile, observation.q, measured, run.planned)
            if self._held is None:
                return MISSED
        if run.ran >= schedule.released:
            self._held = None
        if self._held is not None and self._held.is_lost(self._profile, observation.q, measured):
            self._held = None
            return LOST
        name = self._step.object
        until = schedule.actuation if self._is_rigid(run, name) else schedule.contact
        if run.ran < min(until, schedule.gripped) and has_drifted(run.scene, measured, name):
            return DRIFTED
        return None

    @staticmethod
    def _is_rigid(run: _Plan, name: str) -> bool:
        return run.scene.objects[name].is_rigid

    def _must_wait(self, measured: Measurement) -> bool:
        """Whether what the step acts on still rolls; not for ever."""
        speed = measured.speeds.get(self._step.object)
        return speed is not None and float(speed[0]) > CALM and self._waited < CALM_STEPS

    def _stay(self, observation: Observation) -> Action:
        """Stop where the arm is, the fingers as they were commanded."""
        if self._last is None or self._waited == 1:
            names = self._profile.model.joint_names
            arm = observation.q[[names.index(name) for name in self._profile.arm_joints]]
            gripper = 1.0 if self._last is None else float(self._last[-1])
            return np.append(arm, gripper).astype(np.float32)
        return self._last

    def _begin(self, observation: Observation) -> bool:
        """Plan the step whose turn it is, or the one that must come before it; whether there is a motion."""
        step = self._step
        held = None if self._held is None else self._held.name
        if step.tool not in (HAND, held):
            before = [i for i in range(self._at) if self._task.steps[i].object == step.tool]
            if not before:
                return False
            self._at, self._trigger = before[-1], LOST
        turn = self._turn
        scene = replace(observation.scene(), held=held)
        found: list[_Plan] = []
        for name in self._untried():
            if len(turn.plans) >= MOST_PLANS:
                break
            plan = self._plan(scene, name, observation.step, former=turn.plans[-1] if turn.plans else None)
            turn.plans.append(plan)
            found.append(plan)
            if plan.planned.is_solved:
                break
        with_motion = [plan for plan in found if plan.planned.schedule is not None]
        best = next((plan for plan in with_motion if plan.planned.is_solved), None) or next(iter(with_motion), None)
        self._running = best
        return best is not None

    def _untried(self) -> list[str]:
        """Strategies of the step that have not been tried to the end often enough, in order of preference."""
        turn = self._turn
        return [name for name in self._step.strategies if turn.tries.get(name, 0) < MOST_TRIES]

    def _plan(self, scene: Scene, name: str, at_step: int, former: _Plan | None) -> _Plan:
        use = former.planned if former is not None and former.strategy == name else None
        planned = self._planner.plan(
            scene, self._step, self._strategies[name], following=self._following(self._at), former=use
        )
        return _Plan(name, planned, scene, at_step, self._trigger)

    def _following(self, at: int) -> list[Ways]:
        return [(step, [self._strategies[name] for name in step.strategies]) for step in self._task.steps[at + 1 :]]

    def _plan_ahead(self, scene: Scene) -> None:
        """Plan all steps; the first that cannot be planned whole is the last to be executed."""
        for self._at in range(len(self._task.steps)):
            plan = self._plan(scene, self._step.strategies[0], 0, None)
            self._turn.plans.append(plan)
            if plan.planned.after is None or not plan.planned.is_solved:
                break
            scene = plan.planned.after
        self._at = 0
        self._running = self._turn.plans[0]

    def _blind(self, observation: Observation) -> Action | None:
        self._turn.note(observation.measurement)
        run = self._running
        while run is not None and run.is_over:
            following = self._at + 1
            if following >= len(self._task.steps) or self._task.steps[following].name not in self._turns:
                return None
            self._at = following
            run = self._running = self._turn.plans[0]
        if run is None or run.planned.schedule is None:
            return None
        return run.next_action()
