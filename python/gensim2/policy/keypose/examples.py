"""Create training examples of keypose programs from scenes that are rendered and planned but not simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.seeding import rng
from gensim2.perception import Observation, ObservationSpec
from gensim2.perception.cloud import to_steps
from gensim2.perception.raycast.observer import Observer
from gensim2.planning import Scene, StepPlan, StepPlanner, Strategy
from gensim2.planning.predict import with_joint
from gensim2.planning.strategies import centered
from gensim2.policy.keypose.program import KEYPOSES, program_of
from gensim2.policy.keypose.teaching import PATIENCE
from gensim2.robots import OPEN, RobotProfile, robot
from gensim2.rollout.worker import parsed, simulator
from gensim2.scenes.config import SceneConfig
from gensim2.scenes.physics import Engines
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import Step
from gensim2.tasks.strategies import Strategies

Example = dict[str, npt.NDArray[Any]]

OTHER_OPENNESS = 0.3
"""Fraction of scenes in which a step's joint starts at a random position, as after an earlier attempt."""
MAX_TOUCHING = 1
"""Worst rank (``StepPlan.rank``) of a plan used for training: a complete motion that may touch the object early."""


@dataclass(frozen=True)
class Drawn:
    """Training examples from one scene.

    Attributes:
        examples: one example for each planned step, and one example for "done"; :func:`example` describes the arrays of
            an example.
        failed: reason for the missing examples: the planner's status, or the failure in simulation. None if no example
            is missing.
    """

    examples: tuple[Example, ...]
    failed: str | None = None


def draw(
    scene: SceneConfig,
    strategies: Strategies,
    spec: ObservationSpec,
    seed: int,
    only: Mapping[str, Sequence[str]] | None = None,
    verify: bool = False,
    engines: Engines = "one",
) -> Drawn:
    """Generate a scene, and plan its steps in order; each plan starts from the state that the previous plan predicts.

    Args:
        scene: settings of the scene.
        strategies: strategies of the task, as plain data.
        seed: seed of the scene.
        only: names of the strategies to use, by step; None for all.
        verify: whether to execute the plans in simulation and leave the scene out if the task does not succeed.
        engines: ``"both"`` executes the plans in both physics engines.
    """
    env, task, profile = simulator(scene), scene.task, robot(scene.robot)
    env.reset(seed, other_openness(scene, seed))
    observer = Observer(profile, {name: thing.model for name, thing in env.initial_state.objects.items()}, spec, seed)
    now = env.scene_state()
    measured = env.measure()
    begin = 0
    while begin < len(task.steps) and task.steps[begin].done and all_hold(task.steps[begin].done, measured):
        begin += 1
    if all_hold(task.success, measured):
        begin = len(task.steps)
    planner, ways = StepPlanner(profile, patience=PATIENCE), parsed(strategies)
    following = [(step, [ways[name] for name in step.strategies]) for step in task.steps]
    examples: list[Example] = []
    taken: dict[str, tuple[str, Strategy]] = {}
    for number in range(begin, len(task.steps)):
        step = task.steps[number]
        if number > 0:
            now = _left_anywhere(now, step, measured, rng(seed, f"{task.name}/keypose/{step.name}"))
        names = [name for name in step.strategies if only is None or name in only.get(step.name, ())]
        found = planned_way(planner, now, step, {name: ways[name] for name in names}, following[number + 1 :])
        if found is None:
            return Drawn(tuple(examples), f"{step.name}: no plan")
        name, strategy, planned = found
        taken[step.name] = name, strategy
        seen = _seen(env, observer, profile, now)
        way = step.strategies.index(name)
        examples.append(example(seen, planned, profile, number, way, seed))
        assert planned.after is not None
        now = _rested(planned.after, profile)
    seen = _seen(env, observer, profile, now)
    examples.append(example(seen, None, profile, len(task.steps), -1, seed))
    if verify and taken:
        for each in scene.in_engines(engines):
            if (cause := refuted(each, taken, seed)) is not None:
                return Drawn((), f"refuted: {cause}")
    return Drawn(tuple(examples))


def refuted(scene: SceneConfig, taken: Mapping[str, tuple[str, Strategy]], seed: int) -> str | None:
    """Run an episode in simulation, with one plan for each step. Return why the task fails, or None if it succeeds.

    Args:
        scene, seed: as for :func:`draw`.
        taken: strategy and its name for each step, by the name of the step. Steps that are already done at the start of
            the episode are left out.
    """
    from gensim2.rollout.chain import ChainController
    from gensim2.rollout.no_op import NoOpResult
    from gensim2.rollout.run import run
    from gensim2.tasks.strategies import with_strategies

    env = simulator(scene)
    task = scene.task.model_copy(update={"steps": tuple(step for step in scene.task.steps if step.name in taken)})
    # The names include the step, because two steps may use the same strategy with different tolerances.
    ways = {step: {f"{step}/{name}": strategy.to_dict()} for step, (name, strategy) in taken.items()}
    chosen = {name: data for own in ways.values() for name, data in own.items()}
    controller = ChainController(with_strategies(task, ways), chosen, robot(scene.robot), one_plan=True)
    # Use a fixed result in place of the no-op baseline, which is a simulation without the robot. The plans do not
    # depend on the result of this simulation.
    still = NoOpResult(success=False, stable=True, start=env.measure(), end=env.measure())
    options = other_openness(scene, seed)
    episode = run(env, controller, seed=seed, options=options, still=lambda: still).episode
    return None if episode.held else "no cause found" if episode.cause is None else episode.cause.value


def example(
    seen: Observation, planned: StepPlan | None, profile: RobotProfile, step: int, way: int, seed: int
) -> Example:
    """Return the arrays of one training example.

    The example contains three arrays of the observation:

    - ``points`` (N, 3), int16: the point cloud in the base frame, in the integer unit of
      :func:`~gensim2.perception.cloud.to_steps`;
    - ``joints`` (n,): all joint positions;
    - ``fingers`` (2,): the finger distance and the last gripper command.

    It also contains the program that the policy should predict: ``positions``, ``rotations``, ``gripper``, ``seconds``
    and ``force``. An example of "done" has the identity as rotations and zeros in the other arrays of the program.

    Three numbers identify the example: ``step`` is the index of the task step, or the number of steps for "done";
    ``way`` is the index of the strategy, or -1 for "done"; ``seed`` is the seed of the scene.
    """
    assert seen.cloud is not None
    program = None if planned is None else program_of(planned, profile)
    arrays: dict[str, Any] = {
        "points": to_steps(seen.cloud.xyz),
        "joints": seen.joint_positions.astype(np.float32),
        "fingers": np.array([seen.gripper_width, seen.gripper_command], dtype=np.float32),
        "positions": np.zeros((KEYPOSES, 3), np.float32) if program is None else program.positions,
        "rotations": np.tile(np.eye(3, dtype=np.float32), (KEYPOSES, 1, 1)) if program is None else program.rotations,
        "gripper": np.zeros(KEYPOSES + 1, np.float32) if program is None else program.gripper,
        "seconds": np.zeros(KEYPOSES, np.float32) if program is None else program.seconds,
        "force": np.float32(0.0 if program is None else program.force),
        "step": np.int16(step),
        "way": np.int16(way),
        "seed": np.int64(seed),
    }
    return arrays


def other_openness(scene: SceneConfig, seed: int) -> dict[str, Any] | None:
    """Return reset options that start the first step's joint at a random position; None for the usual start."""
    generator = rng(seed, f"{scene.task.name}/keypose")
    anywhere, openness = generator.random() < OTHER_OPENNESS, float(generator.random())
    first = scene.task.steps[0].object
    has_joint = any(criterion_is_of_joint(each) for each in scene.task.steps[0].done)
    return {"openness": {first: openness}} if anywhere and has_joint else None


def _left_anywhere(now: Scene, step: Step, measured: Measurement, generator: np.random.Generator) -> Scene:
    """Move the joint that a step acts on to a random position, and return the changed scene.

    ``now`` is the scene in which the step begins. Only the fraction ``OTHER_OPENNESS`` of the scenes is changed; the
    other scenes are returned as they are. A scene is also returned unchanged if the hand holds an object, if the step
    does not move a joint, or if the random position would already complete the step.
    """
    anywhere, openness = generator.random() < OTHER_OPENNESS, float(generator.random())
    joint = now.objects[step.object].joint
    if not anywhere or joint is None or now.held is not None or not any(map(criterion_is_of_joint, step.done)):
        return now
    if all_hold(step.done, replace(measured, openness={**measured.openness, step.object: openness})):
        return now
    return with_joint(now, step.object, joint.lower + openness * (joint.upper - joint.lower))


def criterion_is_of_joint(criterion: Any) -> bool:
    """Return whether a criterion is about a joint's position."""
    return str(criterion.type).startswith("articulated_")


def planned_way(
    planner: StepPlanner, scene: Scene, step: Step, ways: Mapping[str, Strategy], following: Sequence[Any]
) -> tuple[str, Strategy, StepPlan] | None:
    """Return the first strategy with a complete plan, its name and the plan; None without a complete plan.

    Strategies are tried in the order in which the step lists them. The planner first tries to place a grasped object
    near the middle of the strategy's tolerance. If this fails, the planner uses the full tolerance.
    """
    tried = list(ways.items())
    if scene.held is not None:
        tried = [(name, centered(strategy)) for name, strategy in tried] + tried
    best: tuple[str, Strategy, StepPlan] | None = None
    for name, strategy in tried:
        planned = planner.plan(scene, step, strategy, following=following)
        if best is None or planned.rank < best[2].rank:
            best = name, strategy, planned
        if planned.rank == 0:
            break
    return None if best is None or best[2].rank > MAX_TOUCHING else best


def _rested(scene: Scene, profile: RobotProfile) -> Scene:
    """Return the scene with the arm in its rest pose, unless the hand holds an object."""
    if scene.held is not None:
        return scene
    q = np.array(profile.reset_qpos)
    return replace(scene, q=q, qvel=np.zeros_like(q))


def _seen(env: HeadlessEnv, observer: Observer, profile: RobotProfile, scene: Scene) -> Observation:
    """Render a predicted scene with the cameras."""
    rows = {kind: {name: row[None].copy() for name, row in group.items()} for kind, group in env.state().items()}
    arm = rows["articulations"][profile.agent]
    n = len(profile.reset_qpos)
    arm[0, 13 : 13 + n] = scene.q
    for name, thing in scene.objects.items():
        if thing.joint is not None:
            rows["articulations"][name][0, 13] = thing.joint.value
        else:
            rows["actors"][name][0, :7] = _pose(scene.T_world_base @ thing.T_base_object)
    command = OPEN if scene.held is None else float(np.clip(_command(profile, scene.q), -1.0, 1.0))
    return observer.observe(rows, 0, command)


def _command(profile: RobotProfile, q: npt.NDArray[np.float64]) -> float:
    return profile.gripper.command_at(q[list(profile.gripper_columns)])


def _pose(matrix: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    from scipy.spatial.transform import Rotation

    return np.concatenate([matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]).as_quat(scalar_first=True)])
