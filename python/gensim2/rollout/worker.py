"""Define the jobs of worker processes: plan in a scene, run an episode.

Arguments and results of these functions are plain values that can be pickled.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.core.seeding import rng
from gensim2.objects import open_library
from gensim2.planning.strategies import Strategy, parse_strategy
from gensim2.robots import robot
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.controller import Action, Controller, Reference, WrappedController, is_privileged
from gensim2.rollout.controller_spec import CHAIN, ControllerSpec, planner_spec
from gensim2.rollout.record import Episode, in_all_engines
from gensim2.scenes.config import SceneConfig, SceneOptions
from gensim2.scenes.physics import Engine
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import StepStrategies, Strategies, with_strategies

if TYPE_CHECKING:
    from gensim2.planning.scene import Scene
    from gensim2.planning.steps import StepPlanner
    from gensim2.rollout.checker_result import WorldCount
    from gensim2.rollout.no_op import NoOpResult
    from gensim2.rollout.recording import Recording
    from gensim2.rollout.run import Stop
    from gensim2.sim.headless import HeadlessEnv

Result = TypeVar("Result")

_PLANNING = ("gensim2.rollout.worker", "gensim2.rollout.chain", "gensim2.rollout.run", "gensim2.planning.steps")

#: Modules that a worker needs and that take seconds to import, by simulation engine.
PRELOAD: Mapping[Engine, tuple[str, ...]] = {
    "sapien": (*_PLANNING, "gensim2.sim.headless", "gensim2.sim.sapien_scene"),
    "mujoco": (*_PLANNING, "gensim2.sim.headless", "gensim2.sim.mujoco.scene"),
}

#: Solver options for screening. Most of hundreds of candidates fail, so few poses are tried for each. For CloseLaptop
#: with real objects, the results are the same as with the default options, and screening is 30 times faster.
SCREEN_OPTIONS: kpam.Options = {"allow_partial": True, "extra_seeds": 0, "candidates": 6, "samples": 200}

#: Result of screening a candidate in one scene. It contains a score from 0 to 1, the reason if the score is below 1
#: (otherwise None), and measured values that :func:`gensim2.design.diagnosis.diagnoses` uses.
Screened = tuple[float, str | None, dict[str, Any]]


def prepare(scenes: Sequence[SceneOptions]) -> None:
    """Load the modules and data of all episodes, so that the first episode takes no longer than the others.

    Args:
        scenes: options of the scenes, for each engine of the run.
    """
    from gensim2.sim.engines import scene_class

    for scene in scenes:
        open_library(scene.assets).classes()
        profile = robot(scene.robot)
        assert profile.model
        scene_class(scene.engine).prepare(profile, scene.physics)


@lru_cache(maxsize=2)
def simulator(scene: SceneConfig) -> HeadlessEnv:
    """Return the simulator of a scene. The last two simulators are cached, because consecutive jobs share them."""
    from gensim2.sim.headless import HeadlessEnv

    return HeadlessEnv(scene)


def screen_scene(config: EpisodeConfig, seed: int, candidates: Sequence[StepStrategies]) -> list[Screened]:
    """Plan every candidate in the scene of one seed.

    Returns:
        A score, a reason and measured values for each candidate. The score is 1 and the reason None if every step has a
        complete plan. Otherwise the score is the fraction of steps before the first step without a complete plan. This
        step counts half if it reaches the actuation pose.
    """
    from gensim2.planning.steps import StepPlanner

    env = simulator(config.scene)
    env.reset(seed)
    scene = env.scene_state()
    planner = StepPlanner(robot(config.scene.robot), options=SCREEN_OPTIONS)
    return [_screen(planner, config.task, scene, candidate) for candidate in candidates]


def _screen(planner: StepPlanner, task: TaskSpec, scene: Scene, candidate: StepStrategies) -> Screened:
    try:
        ways = [(step, parsed(candidate[step.name])) for step in task.steps]
        following = [(step, list(strategies.values())) for step, strategies in ways]
        for number, (step, strategies) in enumerate(ways):
            rest = following[number + 1 :]
            planned = {}
            for name, strategy in strategies.items():
                planned[name] = planner.plan(scene, step, strategy, following=rest)
                if planned[name].rank <= 1:
                    break
            name = min(planned, key=lambda each: planned[each].rank)
            best = planned[name]
            if not best.is_solved or best.after is None:
                half = 0.5 if _reaches_actuation(best.plan) else 0.0
                numbers = {"step": step.name, "strategy": name, "plan": best.detail()}
                return (number + half) / len(task.steps), best.status, numbers
            scene = best.after
    except MemoryError:
        raise
    except BaseException as error:
        # An error or a Rust panic, which is no Exception in PyO3, in one candidate gives it a score of 0. The screening
        # continues.
        if not isinstance(error, Exception) and type(error).__module__ != "pyo3_runtime":
            raise
        return 0.0, f"planner error: {type(error).__name__}: {error}", {}
    return 1.0, None, {}


def judge_scene(config: EpisodeConfig, seed: int) -> list[WorldCount]:
    """Count how often the criteria hold in changed copies of a successful end state, in the scene of one seed."""
    from gensim2.rollout.mutated import judge

    return judge(simulator(config.scene), seed)


def _reaches_actuation(plan: kpam.Plan | None) -> bool:
    return (
        plan is not None
        and plan.trajectory is not None
        and any(frame["label"] == "actuation" and frame["reached"] for frame in plan.keyframes)
    )


def parsed(strategies: Mapping[str, Mapping[str, Any]]) -> dict[str, Strategy]:
    """Parse strategies from plain data.

    Raises:
        InputError: a strategy cannot be used.
    """
    return {name: parse_strategy(data, f"strategies/{name}.yaml") for name, data in strategies.items()}


def episode(config: EpisodeConfig, strategies: Strategies, seed: int) -> Episode:
    """Simulate one episode and, if it reaches the goal, the no-op baseline of the same seed."""
    return _run(config, config.task, strategies, seed, record=False)[0]


def trial(config: EpisodeConfig, ways: StepStrategies, seed: int) -> Episode:
    """Run one episode of the configured task with the strategies of one candidate."""
    strategies = {name: data for own in ways.values() for name, data in own.items()}
    return _run(config, with_strategies(config.task, ways), strategies, seed, record=False)[0]


def demonstrate(config: EpisodeConfig, strategies: Strategies, seed: int) -> tuple[Episode, Recording | None]:
    """Run one episode as :func:`episode` does. Return its record and, after a success, its states."""
    found, recording = _run(config, config.task, strategies, seed, record=True)
    return found, recording if found.held else None


def record(
    config: EpisodeConfig, strategies: Strategies, seed: int, keep: Callable[[Episode, Recording | None], Result]
) -> Result:
    """Run one episode as :func:`episode` does, and pass its states to a function in this process.

    With engines ``"both"``, the episode also runs in the other engine, and the record has the verdicts of both.

    Args:
        keep: picklable function that receives the episode's record and its recorded states, and stores them.

    Returns:
        The result of ``keep``.
    """
    found, recording = _run(config, config.task, strategies, seed, record=True)
    first, *others = config.scene.in_engines(config.rollout.engines)
    if others:
        there = {each.engine: episode(replace(config, scene=each), strategies, seed) for each in others}
        found = in_all_engines({first.engine: found, **there})
    return keep(found, recording)


def evaluate(
    config: EpisodeConfig,
    controller: ControllerSpec,
    seed: int,
    stop: Stop,
    keep: Callable[[Episode, Recording | None], Result] | None,
    index: int | None = None,
) -> Episode | Result:
    """Run one episode of a task with a given controller, which may be the planner or a policy.

    Args:
        controller: controller, which is created once in each process and reset for each episode.
        stop: condition that ends the episode, as for :func:`gensim2.rollout.run.run`.
        keep: as for :func:`record`; None if the states are not recorded.
        index: index of the episode among the task's episodes, for error messages.

    Returns:
        The record, or the result of ``keep``.

    Raises:
        ControllerError: the controller fails or returns an invalid action.
    """
    found, recording = _rollout(config, config.task, controller, seed, keep is not None, stop, index)
    return found if keep is None else keep(found, recording)


def _run(
    config: EpisodeConfig, task: TaskSpec, strategies: Strategies, seed: int, record: bool
) -> tuple[Episode, Recording | None]:
    spec = planner_spec(task, strategies, config.rollout, config.scene.robot)
    return _rollout(config, task, spec, seed, record)


def _rollout(
    config: EpisodeConfig,
    task: TaskSpec,
    spec: ControllerSpec,
    seed: int,
    record: bool,
    stop: Stop = "controller",
    index: int | None = None,
) -> tuple[Episode, Recording | None]:
    from gensim2.rollout.disturbance import Disturbed
    from gensim2.rollout.recording import EpisodeResult
    from gensim2.rollout.run import Attempt, attempted, run

    given = config.rollout
    env = simulator(config.scene)
    which = f"{task.name}, seed {seed}" if index is None else f"{task.name}, episode {index}, seed {seed}"

    def once(attempt: Attempt) -> EpisodeResult:
        controller = _made(attempt.controller(spec), attempt.task(task), config.scene.robot, which)
        disturbed: Disturbed | None = None
        if given.disturbance is not None:
            controller = disturbed = Disturbed(controller, env, config.task, given.disturbance, seed)
        if given.noise:
            profile = env.profile
            controller = Noisy(controller, profile.control_hz, profile.arm_size, given.noise, seed)
        still = partial(no_op_episode, config.scene, seed)
        every = env.physics.criteria_steps(env.profile)
        found = run(env, controller, seed=seed, record=record, stop=stop, still=still, every=every)
        if disturbed is None:
            return found
        return replace(found, episode=replace(found.episode, disturbed_at=disturbed.happened_at))

    result = attempted(task, once, given.attempts)
    return result.episode, result.recording


def _made(spec: ControllerSpec, task: TaskSpec, robot_name: str, which: str) -> Controller:
    """Return the controller of an episode. Policies are cached, because loading a network takes time."""
    from gensim2.rollout.controller import is_privileged
    from gensim2.rollout.guarded import Guarded

    profile = robot(robot_name)
    if spec.target == CHAIN:
        return spec.make(task, profile)
    if is_privileged(spec.load()):
        controller = spec.make(task, profile)
    else:
        # The key contains the digest, so that a controller is loaded again after its checkpoint or class has changed.
        key = (spec.target, json.dumps(spec.arguments, sort_keys=True), spec.digest)
        if key not in _kept:
            forget()
            _kept[key] = spec.make(task, profile)
        controller = _kept[key]
    return Guarded(controller, spec, task, profile, which)


def forget() -> None:
    from gensim2.rollout.controller_spec import close

    while _kept:
        close(_kept.popitem()[1])


_kept: dict[tuple[str, str, str], Controller] = {}
"""The last controller that was created in this process."""


@lru_cache(maxsize=4096)
def no_op_episode(scene: SceneConfig, seed: int) -> NoOpResult:
    """Run the no-op baseline of a seed; results are cached, because searches repeat seeds."""
    from gensim2.rollout.no_op import no_op_baseline

    return no_op_baseline(simulator(scene), seed)


PERIOD = 0.6
"""Duration (s) of one disturbance of the arm."""
SHARE = 0.5
"""Fraction of the periods with noise."""


class Noisy(WrappedController):
    """Controller that sometimes adds noise to the joint targets of another controller.

    The other controller does not know of the noise. Time is divided into equal periods, and random periods have noise.
    In these periods, each joint target gets an offset like half a sine wave of random amplitude. The noise-free action
    is ``reference/action``.

    Args:
        controller: controller whose actions get noise.
        control_hz: control rate, Hz.
        arm: number of the arm's joints.
        noise: standard deviation of the random amplitudes, rad.
        seed: seed of the episode.
    """

    def __init__(self, controller: Controller, control_hz: int, arm: int, noise: float, seed: int) -> None:
        self._controller, self._noise, self._arm, self._seed = controller, noise, arm, seed
        self.privileged = is_privileged(controller)
        self._steps = max(2, round(PERIOD * control_hz))

    def reset(self, observation: object, seed: int) -> None:
        self._rng = rng(self._seed, "noise")
        self._at, self._angles = 0, np.zeros(self._arm)
        self._meant: Action | None = None
        self._controller.reset(observation, seed)

    def act(self, observation: object) -> Action | None:
        """Return the controller's action with noise on the arm's joints."""
        given = self._controller.act(observation)
        self._meant = None if given is None else np.asarray(given, dtype=np.float32)
        if self._meant is None:
            return None
        phase = self._at % self._steps
        if phase == 0:
            drawn: npt.NDArray[np.float64] = self._rng.normal(0.0, self._noise, self._arm)
            self._angles = drawn * float(self._rng.random() < SHARE)
        self._at += 1
        sent = self._meant.copy()
        sent[: self._arm] += (np.sin(np.pi * phase / self._steps) * self._angles).astype(np.float32)
        return sent

    @property
    def reference(self) -> Reference | None:
        """Return the controller's reference, with the noise-free action in the field ``action``."""
        told = super().reference
        if told is None and self._meant is not None:
            nothing = np.full(self._arm, np.nan, np.float32)
            told = Reference(nothing, nothing, np.full(2, np.nan, np.float32))
        return None if told is None else replace(told, action=self._meant)
