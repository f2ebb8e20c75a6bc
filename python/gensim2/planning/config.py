"""Check strategies against the objects of a task before planning, with errors that name file and field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

import gensim2_kpam as kpam
from gensim2.core.errors import InputError
from gensim2.planning.scene import JointState, Scene, SceneBody, SceneObject
from gensim2.planning.steps import StepPlanner
from gensim2.planning.strategies import MAKES_ROOM, GraspStrategy, PullStrategy, Strategy, named
from gensim2.robots import RobotProfile
from gensim2.tasks.spec import HAND, Step, TaskSpec


@dataclass(frozen=True)
class ObjectNames:
    """Keypoint names and joint type of an object, against which strategies are checked.

    Attributes:
        keypoints: names of the object's keypoints.
        joint: type of the object's joint; None for a rigid object.
    """

    keypoints: tuple[str, ...]
    joint: Literal["revolute", "prismatic"] | None


def check_strategies(
    task: TaskSpec,
    strategies: Mapping[str, Strategy],
    objects: Mapping[str, ObjectNames],
    profile: RobotProfile,
    files: Mapping[str, Path | str] | None = None,
) -> None:
    """Check that the strategies of every step exist and name only keypoints of its tool and of the task's objects.

    Args:
        task: spec of the task.
        strategies: strategies by name.
        objects: keypoint names and joint type of each object, by the object's name in the task.
        profile: profile of the robot.
        files: file of each strategy, by the strategy's name, for error messages.

    Raises:
        InputError: a strategy does not fit the task; the message names the file and the field.

    Example:
        ```python
        found = {name: parse_strategy(data) for name, data in gensim2.load_strategies("OpenDrawer").items()}
        check_strategies(gensim2.load_task("OpenDrawer"), found, objects, gensim2.robot("panda"))
        ```
    """
    planner = StepPlanner(profile)
    scene = _made_up(objects, profile)
    for number, step in enumerate(task.steps):
        if step.tool != HAND and not any(before.object == step.tool for before in task.steps[:number]):
            raise InputError(f"no earlier step grasps {step.tool!r}", field=f"steps.{step.name}.tool")
        for name in step.strategies:
            if name not in strategies:
                raise InputError(f"there is no strategy {name!r}", field=f"steps.{step.name}.strategies")
            _check(planner, scene, step, strategies[name], (files or {}).get(name))
        if all(strategies[name].makes_room is not None for name in step.strategies):
            field = f"steps.{step.name}.strategies"
            wrong = "every strategy of this step only moves another object out of the way"
            raise InputError(wrong, field=field, remedy="add a strategy that handles the step's own object")


def _check(planner: StepPlanner, scene: Scene, step: Step, strategy: Strategy, file: Path | str | None) -> None:
    if isinstance(strategy, GraspStrategy | PullStrategy):
        is_rigid = scene.objects[step.object].is_rigid
        if isinstance(strategy, GraspStrategy) and not is_rigid:
            remedy = "add follow_joint_to: 1.0 to grasp the moving part and move the joint"
            wrong = f"this strategy grasps and carries an object, but {step.object} has a joint"
            raise InputError(wrong, file=file, field="grasp", remedy=remedy)
        if isinstance(strategy, PullStrategy) and is_rigid:
            wrong = f"{step.object} has no joint to follow"
            raise InputError(wrong, file=file, field="follow_joint_to", remedy="remove follow_joint_to")
        if step.tool != HAND:
            wrong = f"the hand already holds {step.tool}"
            raise InputError(wrong, file=file, field="grasp", remedy="remove the step's tool")
        return
    held = None if step.tool == HAND else step.tool
    if strategy.makes_room is not None:
        moved = scene.objects.get(strategy.makes_room)
        if moved is None or moved.is_rigid or moved.name == step.object or held is not None:
            what = "is moved by a hand that holds something" if held else "is no other object of the task with a joint"
            raise InputError(f"{strategy.makes_room!r} {what}", file=file, field=MAKES_ROOM)
        step, strategy = step.model_copy(update={"object": moved.name}), strategy.as_step()
    try:
        planner.problem(_with_held(scene, held), step, strategy)
    except kpam.ProblemError as error:
        raise named(error, file) from error


def _with_held(scene: Scene, held: str | None) -> Scene:
    return Scene(scene.q, scene.qvel, scene.T_world_base, scene.objects, held=held)


def _made_up(objects: Mapping[str, ObjectNames], profile: RobotProfile) -> Scene:
    """Return a dummy scene for the check, with keypoints at distinct points that do not lie on the joint axes."""
    q = np.array(profile.reset_qpos)
    made = {name: _object(name, names, 1.0 + n) for n, (name, names) in enumerate(objects.items())}
    return Scene(q, np.zeros_like(q), profile.T_world_base, made)


def _object(name: str, names: ObjectNames, x: float) -> SceneObject:
    pose = np.eye(4)
    pose[0, 3] = x
    cube = 0.01 * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=np.float64)
    body = SceneBody(name, (cube,), pose)
    points = {key: np.array([x, 0.1 * (n + 1), 0.1]) for n, key in enumerate(names.keypoints)}
    joint = None
    if names.joint is not None:
        axis = np.array([0.0, 0.0, 1.0])
        joint = JointState(names.joint, np.array([x, -0.5, 0.0]), axis, 0.5, 0.0, 1.0, (name,))
    return SceneObject(name, (body,), pose, points, joint, center_of_mass=np.zeros(3) if joint is None else None)
