"""``gensim2 solve``: one motion for each step of one task, without executing it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import gensim2_kpam as kpam
from gensim2.core.files import check_writable, write_json
from gensim2.core.record_files import SCHEMA_VERSION
from gensim2.planning.scene import Scene
from gensim2.robots import RobotProfile
from gensim2.rollout.config import RolloutArguments
from gensim2.rollout.inputs import TaskInput, read_task_input

if TYPE_CHECKING:
    from gensim2.planning.step_plan import StepPlan

#: What can be executed, whole or in part.
FOUND = ("solved", "partial")


@dataclass(frozen=True)
class SolvedStep:
    """One step, planned on the scene that the plans before it foresee."""

    name: str
    strategy: str
    scene: Scene
    found: StepPlan

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data; ``plan`` is null where there was no motion to be looked for. Where it is partial and
        a shorter motion is executed in its place, after which the hand lets go, that is ``part``.
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
    """Plans on the scene of one seed.

    Attributes:
        task: its name.
        objects: class and id of each object, by name.
        steps: in order, as far as they could be planned.
        count: of the task's steps.
    """

    task: str
    objects: dict[str, dict[str, str]]
    steps: tuple[SolvedStep, ...]
    count: int

    @property
    def is_whole(self) -> bool:
        """Whether every step has something to execute."""
        return len(self.steps) == self.count and all(step.found.status in FOUND for step in self.steps)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data; ``class``, ``instance`` and ``plan`` are those of the first object and step."""
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
        }


def solve(
    task: str,
    *,
    seed: int = 0,
    out: Path | None = None,
    view: Callable[[Scene, kpam.Plan, RobotProfile], None] | None = None,
    **scene: Unpack[RolloutArguments],
) -> SolveResult:
    """Plan the steps of a task on the scene of one seed as an episode would, without executing them.

    Each step after the first is planned on the scene that the plans before it foresee. Where the whole motion of a step
    cannot be had, its plan holds the longest part (status ``partial``), as episodes take it. Strategies are tried in
    order until one is planned whole without touching anything early, and the best is taken; without a motion the result
    ends with that step.

    Example:
        ```python
        result = gensim2.solve("OpenDrawer", seed=3, assets="builtin")
        result.is_whole, [step.strategy for step in result.steps]
        ```

    Args:
        task: name of a library task, or a folder that holds task.yaml and strategies/.
        seed: seed of the scene.
        out: folder to leave ``plan.json`` in.
        view: called with the scene and the plan of the first step, and the robot, at the end, for example to show them.
        scene: see :class:`~gensim2.rollout.config.RolloutArguments`; the seed draws one of several instances, and
            ``open_loop`` takes the first strategy of each step only.

    Returns:
        The plan of each step, as far as the steps could be planned.

    Raises:
        InputError: an argument cannot be used.
    """
    if out is not None:
        check_writable(Path(out) / "plan.json")
    given = read_task_input(task, seed=seed, **scene)
    # Only now what takes seconds to import.
    from gensim2.sim.headless import HeadlessEnv

    env = HeadlessEnv(given.scene)
    env.reset(seed)
    objects = {
        role: {"class": placed.model.asset_class, "instance": placed.model.id}
        for role, placed in env.initial_state.objects.items()
    }
    steps = _plan(given, env.scene_state())
    result = SolveResult(given.spec.name, objects, tuple(steps), len(given.spec.steps))
    if out is not None:
        write_json(Path(out) / "plan.json", result.to_dict())
    if view is not None and steps[0].found.plan is not None:
        view(steps[0].scene, steps[0].found.plan, env.profile)
    return result


def _plan(given: TaskInput, scene: Scene) -> list[SolvedStep]:
    from gensim2.planning.steps import StepPlanner
    from gensim2.robots import robot
    from gensim2.rollout.worker import parsed

    planner, strategies = StepPlanner(robot(given.scene.robot)), parsed(given.strategies)
    ways = [(step, [strategies[name] for name in step.strategies]) for step in given.spec.steps]
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
