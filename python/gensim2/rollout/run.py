"""Run an episode: request actions, step the world, let the scene settle, and evaluate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.core.seeding import rng
from gensim2.perception import EmptyCloudError, Observation, ObservationSpec
from gensim2.planning.steps import PLAN_OPTIONS
from gensim2.rollout.controller import (
    ACTUATION,
    Action,
    Controller,
    Event,
    PrivilegedObservation,
    Reference,
    events_of,
    history_of,
    is_privileged,
    reference_of,
    spec_of,
    turn_of,
)
from gensim2.rollout.controller_spec import ControllerSpec
from gensim2.rollout.diagnose import Outcome, diagnose
from gensim2.rollout.driving import Asked
from gensim2.rollout.motion import GOAL_SECONDS, LASTING_SECONDS, MAX_SETTLE_SECONDS, is_at_rest, is_stable, settle
from gensim2.rollout.no_op import NoOpResult, no_op_baseline
from gensim2.rollout.record import AttemptRecord, Cause, Episode, ObjectRecord, StrictMiss
from gensim2.rollout.recording import EpisodeResult, Recorder, Recording
from gensim2.rollout.strict import StrictMisses, strict_misses
from gensim2.rollout.turns import goal_reached, judged_steps, paper_verdict, told_turns, turns_by_criteria
from gensim2.rollout.world import World
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import Step, TaskSpec

if TYPE_CHECKING:
    from gensim2.scenes.initial_state import InitialState


Stop = Literal["controller", "goal"]
"""End of an episode: when the controller returns None; or with ``"goal"`` also when the goal has held for
``GOAL_SECONDS`` and still holds after settling, or at the step limit.
"""
STOPS: tuple[Stop, ...] = get_args(Stop)


def run(
    world: World,
    controller: Controller,
    *,
    seed: int,
    options: Mapping[str, Any] | None = None,
    record: bool = False,
    stop: Stop = "controller",
    still: Callable[[], NoOpResult] | None = None,
    every: int = 1,
) -> EpisodeResult:
    """Run one episode and evaluate it.

    The controller acts until it ends the episode, until the step limit, or until a point cloud is empty. Then the last
    command is kept until the scene is at rest, and the episode is evaluated. These steps belong to the episode, so a
    replay ends in the same state. If the goal is lost while the scene comes to rest and time is left, the controller
    continues.

    If the goal is reached, two more simulations follow: the scene continues for the verdict ``strict``, and the no-op
    baseline runs.

    Args:
        world: simulated world, which is reset for the episode and again for the no-op baseline.
        controller: controller of the episode; its actions are rounded to float32, as in trajectory files.
        seed: seed of the reset.
        options: options of the reset.
        record: whether to store states and observations of every step.
        stop: rule for the end of the episode. ``"controller"``: the controller must end the episode before the step
            limit, or the episode fails. ``"goal"``: the episode also ends when the goal has held for ``GOAL_SECONDS``
            and holds at rest, or shortly before the step limit, so that the scene can come to rest.
        still: function that returns the no-op baseline, so that a caller can cache it. Default: ``no_op_baseline``.
        every: number of control steps between evaluations of the steps' criteria, for the ``paper`` verdict.

    Raises:
        InputError: the seed, an option or an action is invalid.
    """
    world.reset(seed, options)
    motion = _Motion(world, controller, record)
    asked = Asked(controller, world)
    begun: list[tuple[str, int]] = []
    steps_in = world.profile.steps
    most = steps_in(world.task.max_seconds)
    limit = most - (steps_in(MAX_SETTLE_SECONDS) if stop == "goal" else 0)
    held_for, cut = 0, stop == "controller"
    ended, rested, done = 0, 0, False
    try:
        asked.reset(motion.observation(), controller_seed(seed))
        while not done and world.elapsed_steps < limit:
            action = asked.act(motion.observation())
            turn = turn_of(controller)
            if turn is not None and (not begun or begun[-1][0] != turn):
                begun.append((turn, motion.steps))
            if action is None:
                cut = False
                break
            motion.step(action, reference_of(controller))
            if stop == "goal":
                held_for = held_for + 1 if all_hold(world.task.success, motion.trace[-1]) else 0
                if held_for >= steps_in(GOAL_SECONDS):
                    ended = motion.steps
                    motion.settle()
                    done, held_for, rested = all_hold(world.task.success, motion.trace[-1]), 0, motion.steps
    except EmptyCloudError:
        if not motion.steps:
            raise  # If the cameras see nothing at the start, the input is wrong, so the error is passed to the caller.
        cut = False  # The objects have left the cameras' view, so the episode ends here, before its step limit.
    finally:
        asked.close()
    if motion.steps > rested:
        ended = motion.steps
        if not cut:
            motion.settle()
    steps, trace = motion.steps, motion.trace
    turns = told_turns(world.task, trace, begun, every) if begun else turns_by_criteria(world.task, trace, every)
    truncated = cut or steps > most
    stable, settled = world.is_finite and is_stable(trace[-1]), motion.is_at_rest
    goal = goal_reached(world.task, trace[-1], turns)
    events = events_of(controller)
    # Read the initial state and the recording now, because the no-op baseline below resets the world.
    initial_state = world.initial_state
    objects = _object_records(initial_state, trace[0], trace[-1])
    recording = motion.recording()
    surfaces = {} if goal else _surfaces(world)
    lacking: StrictMisses = {StrictMiss.NOT_HELD: {}}
    by_itself: NoOpResult | None = None
    if ended and goal and stable and settled and not truncated:
        before, later = motion.measure_about(ended + steps_in(LASTING_SECONDS))
        lacking = strict_misses(world, trace[0], _at_actuation(trace, events), before, later)
        by_itself = no_op_baseline(world, seed, options=options) if still is None else still()
    held = by_itself is not None and by_itself.stable and not by_itself.success
    outcome = Outcome(
        goal=goal,
        stable=stable and (by_itself is None or by_itself.stable),
        settled=settled,
        cut=cut,
        truncated=truncated,
        by_itself=by_itself is not None and by_itself.success,
    )
    history = judged_steps(history_of(controller), turns)
    cause: Cause | None = None
    numbers: dict[str, Any] = {miss.value: found for miss, found in lacking.items()}
    if not held:
        cause, numbers = diagnose(world.task, trace, turns, history, events, outcome, surfaces)
    episode = Episode(
        seed=seed,
        objects=objects,
        placement_draws=initial_state.draws,
        steps=history,
        control_steps=steps,
        paper=outcome.stable and paper_verdict(world.task, turns),
        held=held,
        strict=held and not lacking,
        strict_misses=list(lacking) if held else [StrictMiss.NOT_HELD],
        still=None if by_itself is None else by_itself.success,
        settled=settled,
        truncated=truncated,
        cause=cause,
        diagnosis=numbers,
        randomization=initial_state.randomization,
        start=list(map(float, initial_state.start)),
    )
    return EpisodeResult(episode, recording)


def controller_seed(seed: int) -> int:
    """Return the seed of the controller.

    The seed is computed from the scene's seed so that it does not reveal that seed.
    """
    return int(rng(seed, "controller").integers(2**32))


def _surfaces(world: World) -> dict[str, list[npt.NDArray[np.float64]]]:
    """Return the convex hulls (N, 3) of each object in the world, m."""
    scene = world.scene_state()
    return {
        name: [
            hull @ T[:3, :3].T + T[:3, 3]
            for body in thing.bodies
            for T in (scene.T_world_base @ body.T_base_body,)
            for hull in body.hulls
        ]
        for name, thing in scene.objects.items()
    }


class _Motion:
    """A running episode: the last command and all measurements.

    Attributes:
        trace: measurements before the first control step and after each one.
    """

    def __init__(self, world: World, controller: Controller, record: bool) -> None:
        self._world, self._controller, self._privileged = world, controller, is_privileged(controller)
        self._seen: tuple[int, ObservationSpec, Observation] | None = None
        self._action: Action | None = None
        self.trace = [world.measure()]
        self._period = 1.0 / world.profile.control_hz
        self._recorder = Recorder(world) if record else None

    @property
    def steps(self) -> int:
        return len(self.trace) - 1

    @property
    def is_at_rest(self) -> bool:
        """Return whether nothing moved noticeably in the last control step."""
        return self.steps > 0 and is_at_rest(self.trace[-2], self.trace[-1], self._period)

    def observation(self) -> Observation:
        spec = spec_of(self._controller)
        if self._seen is None or self._seen[:2] != (self.steps, spec):
            self._seen = (self.steps, spec, self._world.observe(spec))
        seen = self._seen[2]
        if not self._privileged:
            return seen
        return PrivilegedObservation.of(seen, self.trace[-1], self._world.scene_state)

    def step(self, action: Action, reference: Reference | None = None) -> Measurement:
        self._action = np.asarray(action, dtype=np.float32)
        self._world.step(self._action)
        self.trace.append(self._world.measure())
        if self._recorder is not None:
            self._recorder.add(self._action, self.trace[-1], reference)
        return self.trace[-1]

    def settle(self) -> None:
        """Keep the last command until the scene has settled."""
        action = self._action
        assert action is not None
        settle(lambda: self.step(action), self.trace[-1], self._world.profile)

    def recording(self) -> Recording | None:
        return self._recorder.finish() if self._recorder is not None and self.steps else None

    def measure_about(self, step: int) -> tuple[Measurement, Measurement]:
        """Keep the last command through ``step``, after the episode; return the measurements before and after it."""
        assert self._action is not None
        before, after = self.trace[-2:]
        for _ in range(self.steps, step):
            self._world.step(self._action)
            before, after = after, self._world.measure()
        return before, after


def _at_actuation(trace: Sequence[Measurement], events: Sequence[Event]) -> Measurement | None:
    """Return the measurement at the first actuation pose; None if the controller reports no actuation."""
    first = next((event.at_step for event in events if event.what == ACTUATION), None)
    return None if first is None else trace[first]


def _object_records(initial_state: InitialState, start: Measurement, end: Measurement) -> dict[str, ObjectRecord]:
    records = {}
    for name, placed in initial_state.objects.items():
        model = placed.model
        records[name] = ObjectRecord(
            asset_class=model.asset_class,
            id=model.id,
            source=model.source,
            content_hash=model.content_hash,
            pose=[*map(float, placed.position), *map(float, placed.quaternion)],
            yaw=float(placed.yaw),
            openness_start=_number(start.openness.get(name)),
            openness_end=_number(end.openness.get(name)),
            pose_end=_numbers(end.poses.get(name)),
            default_pose=placed.default_pose,
            mass_factor=placed.factors.mass,
            contact_friction_factor=placed.factors.contact_friction,
            joint_friction_factor=placed.factors.joint_friction,
        )
    return records


def _number(value: float | None) -> float | None:
    """Return a number; None for NaN and infinity, which JSON cannot represent."""
    return float(value) if value is not None and math.isfinite(value) else None


def _numbers(values: npt.NDArray[np.float64] | None) -> list[float] | None:
    return values.tolist() if values is not None and np.isfinite(values).all() else None


NUM_SEEDS = 12
"""Number of start values for an actuation pose in all attempts after the first. With the default of 48, nearly all
solver seeds find the same best pose, so an attempt would repeat the previous motion.
"""


@dataclass(frozen=True)
class Attempt:
    """Settings of one attempt.

    Attributes:
        seed: seed of the solver.
        first: strategy that is tried first, by name of the step. Other steps keep their order of strategies.
    """

    seed: int = 0
    first: dict[str, str] = field(default_factory=dict)

    def task(self, task: TaskSpec) -> TaskSpec:
        """Return ``task`` with its strategies in this attempt's order."""
        return task.model_copy(update={"steps": tuple(self._step(step) for step in task.steps)})

    def _step(self, step: Step) -> Step:
        first = self.first.get(step.name)
        if first is None:
            return step
        return step.model_copy(update={"strategies": (first, *(name for name in step.strategies if name != first))})

    def controller(self, spec: ControllerSpec) -> ControllerSpec:
        """Return the controller for this attempt. Later attempts use another seed and more start values."""
        if self.seed == 0:
            return spec
        options: kpam.Options = {**PLAN_OPTIONS, "seed": self.seed, "num_seeds": NUM_SEEDS}
        return replace(spec, arguments={**spec.arguments, "options": options})

    def after(self, episode: Episode, task: TaskSpec) -> Attempt:
        """Return the next attempt: the failed step starts with its next strategy, and the solver's seed changes."""
        begun = [step.name for step in episode.steps]
        blamed = episode.diagnosis.get("step") or (begun or [task.steps[0].name])[-1]
        ways = next(step.strategies for step in task.steps if step.name == blamed)
        now = self.first.get(blamed, ways[0])
        return Attempt(self.seed + 1, {**self.first, blamed: ways[(ways.index(now) + 1) % len(ways)]})


def attempted(task: TaskSpec, run: Callable[[Attempt], EpisodeResult], max_attempts: int) -> EpisodeResult:
    """Make attempts until one succeeds, and return the result that counts for the episode.

    The first attempt that is ``held`` counts. If there is none, the first attempt that succeeds by ``paper`` counts, or
    else the first attempt. All fields except the list describe the attempt that counts. If the no-op baseline reaches
    the goal, no other attempt is made.

    Args:
        run: function that runs an attempt, always from the same initial scene.
        max_attempts: maximum number of attempts.
    """
    attempt = Attempt()
    counts: EpisodeResult | None = None
    made: list[AttemptRecord] = []
    for _ in range(max_attempts):
        result = run(attempt)
        episode = result.episode
        made.append(
            AttemptRecord(attempt.seed, attempt.first, episode.paper, episode.held, episode.strict, episode.cause)
        )
        if counts is None or episode.held or (episode.paper and not counts.episode.paper):
            counts = result
        if episode.held or episode.cause == Cause.HAPPENS_BY_ITSELF:
            break
        attempt = attempt.after(episode, task)
    assert counts is not None
    return replace(counts, episode=replace(counts.episode, attempts=made)) if max_attempts > 1 else counts
