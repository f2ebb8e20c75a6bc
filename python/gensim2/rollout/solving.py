"""Plan one motion for each step of a task, without executing the motions (``gensim2 solve``)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.core.errors import MissingExtraError
from gensim2.core.files import cache_dir, check_writable, replacing, write_json
from gensim2.core.record_files import SCHEMA_VERSION
from gensim2.planning.scene import Scene
from gensim2.robots import RobotProfile
from gensim2.rollout.config import RolloutArguments
from gensim2.rollout.inputs import read_task_input, require_true_scene
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import Strategies

if TYPE_CHECKING:
    from gensim2.planning.step_plan import StepPlan

#: Statuses of plans that can be executed, completely or in part.
FOUND = ("solved", "partial")


@dataclass(frozen=True)
class SolvedStep:
    """One step of a task with its plan, which starts from the scene that the earlier plans predict.

    Attributes:
        name, strategy: names of the step and of the planned strategy.
        scene: scene at the start of the step.
    """

    name: str
    strategy: str
    scene: Scene = field(repr=False)
    found: StepPlan

    def to_dict(self) -> dict[str, Any]:
        """Return the step as plain data.

        ``plan`` is the solver's result for the complete motion, also if it is a failure; it is null if the solver was
        not called. After a failure, ``part`` may have the plan of a shortened motion, which moves the object as far as
        possible and releases it.
        """
        plan, part = self.found.plan, None
        if self.found.whole is not None:
            plan, part = self.found.whole, self.found.plan
        return {
            "name": self.name,
            "strategy": self.strategy,
            "status": self.found.status,
            "reason": self.found.reason,
            "plan": None if plan is None else plan.to_dict(),
            "part": None if part is None else part.to_dict(),
        }


@dataclass(frozen=True)
class SolveResult:
    """Plans for the steps of a task in the scene of one seed.

    Attributes:
        task: name of the task.
        objects: class and id of each object, by name.
        steps: planned steps in the order of the task.
        count: number of the task's steps.
        picture: image of the first step without a complete motion, or of the last step. None if no image was made.
    """

    task: str
    objects: dict[str, dict[str, str]]
    steps: tuple[SolvedStep, ...]
    count: int
    picture: Path | None = None

    @property
    def is_whole(self) -> bool:
        """Return whether every step has a motion that can be executed, completely or in part."""
        return len(self.steps) == self.count and all(step.found.status in FOUND for step in self.steps)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data. ``class`` and ``instance`` are of the first object, and ``plan`` is of the first step."""
        steps = [step.to_dict() for step in self.steps]
        first = next(iter(self.objects.values()))
        return {
            "schema_version": SCHEMA_VERSION,
            "task": self.task,
            "class": first["class"],
            "instance": first["instance"],
            "objects": self.objects,
            "plan": steps[0]["plan"],
            "steps": steps,
            "picture": None if self.picture is None else str(self.picture),
        }


def solve(
    task: str,
    *,
    seed: int = 0,
    out: Path | None = None,
    view: Callable[[Scene, kpam.Plan, RobotProfile], None] | None = None,
    **scene: Unpack[RolloutArguments],
) -> SolveResult:
    """Plan the steps of a task in the scene of one seed, without executing the plans.

    Steps are planned as in an episode, each on the predicted scene. Strategies are tried until one has a complete plan
    without early contact. If none has, the best plan is used, which may be partial. Planning ends at the first step
    without a motion.

    Example:
        ```python
        result = gensim2.solve("OpenDrawer", seed=3, assets="builtin")
        result.is_whole, [step.strategy for step in result.steps]
        ```

    Args:
        task: name of a library task, or a folder with task.yaml and strategies/.
        seed: seed of the scene.
        out: folder for ``plan.json`` and ``plan.png``. None: only a picture of an incomplete plan is written, into the
            cache.
        view: function that is called at the end with the scene, the plan of the first step and the robot, for example
            to show them.
        scene: see :class:`~gensim2.rollout.config.RolloutArguments`; the seed selects one of several instances, and
            ``open_loop`` uses only the first strategy of each step.

    Returns:
        Plans of the steps, up to the first step without a motion.

    Raises:
        InputError: an argument is invalid.
    """
    if out is not None:
        check_writable(Path(out) / "plan.json")
    require_true_scene(**scene)
    given = read_task_input(task, seed=seed, **scene)
    # These modules are imported here because they take seconds to import.
    from gensim2.sim.headless import HeadlessEnv

    env = HeadlessEnv(given.scene)
    env.reset(seed)
    objects = {
        role: {"class": placed.model.asset_class, "instance": placed.model.id}
        for role, placed in env.initial_state.objects.items()
    }
    steps = plan_steps(given.spec, env.profile, given.strategies, env.scene_state())
    result = SolveResult(given.spec.name, objects, tuple(steps), len(given.spec.steps))
    shown = step_to_draw(steps)
    if out is not None or not shown.found.is_solved:
        where = cache_dir() / "plans" / f"{given.spec.name}_{seed}.png" if out is None else Path(out) / "plan.png"
        result = replace(result, picture=draw_plan(shown, given.spec, given.strategies, env.profile, where))
    if out is not None:
        write_json(Path(out) / "plan.json", result.to_dict())
    if view is not None and steps[0].found.plan is not None:
        view(steps[0].scene, steps[0].found.plan, env.profile)
    return result


def plan_steps(task: TaskSpec, profile: RobotProfile, given: Strategies, scene: Scene) -> list[SolvedStep]:
    """Plan the steps of a task in order, until a step has no plan.

    Args:
        given: strategies of the task by name, as plain data.
        scene: scene at the start of the first step.

    Returns:
        One entry for each planned step, in order. If a step has no plan, the list ends with the failed step.
    """
    from gensim2.planning.steps import StepPlanner
    from gensim2.rollout.worker import parsed

    planner, strategies = StepPlanner(profile), parsed(given)
    ways = [(step, [strategies[name] for name in step.strategies]) for step in task.steps]
    steps: list[SolvedStep] = []
    for index, (step, _) in enumerate(ways):
        tried: list[SolvedStep] = []
        for name in step.strategies:
            found = planner.plan(scene, step, strategies[name], following=ways[index + 1 :])
            tried.append(SolvedStep(step.name, name, scene, found))
            if found.rank == 0:
                break
        best = min(tried, key=lambda solved: solved.found.rank)
        steps.append(best)
        if best.found.status not in FOUND or best.found.after is None:
            break
        scene = best.found.after
    return steps


def step_to_draw(steps: Sequence[SolvedStep]) -> SolvedStep:
    """Return the first step without a complete motion, or the last step."""
    return next((step for step in steps if not step.found.is_solved), steps[-1])


def draw_plan(solved: SolvedStep, task: TaskSpec, given: Strategies, profile: RobotProfile, file: Path) -> Path | None:
    """Write a picture of a planned step as PNG.

    Args:
        solved: planned step.
        given: strategies of the task by name, as plain data.
        file: file to write, atomically.

    Returns:
        Path of the file; None if Embree, which renders the picture, is not installed.
    """
    targets = _targets(solved, task, given, profile)
    try:
        from gensim2.planning.picture import plan_picture

        found = solved.found
        title = f"{task.name}, step {solved.name}, strategy {solved.strategy}: {found.status}"
        plan = found.whole or found.plan
        picture = plan_picture(solved.scene, plan, profile, title=title, reason=found.reason, targets=targets)
    except (ImportError, MissingExtraError):
        return None
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file) as path:
        picture.save(path, "PNG")
    return file


def _targets(
    solved: SolvedStep, task: TaskSpec, given: Strategies, profile: RobotProfile
) -> Sequence[npt.NDArray[np.float64]]:
    """Return the targets (3,) of the strategy's point constraints, m, in the base frame; none without a plan."""
    from gensim2.planning.steps import StepPlanner
    from gensim2.planning.strategies import KeypointStrategy
    from gensim2.rollout.worker import parsed

    strategy = parsed(given)[solved.strategy]
    if solved.found.plan is None or not isinstance(strategy, KeypointStrategy):
        return ()
    step = next(step for step in task.steps if step.name == solved.name)
    return StepPlanner(profile).problem(solved.scene, step, strategy).point_targets
