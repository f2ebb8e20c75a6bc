"""Strategies against the objects that they are for: what they name must be there, before anything is planned."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import gensim2_kpam as kpam
from gensim2.errors import InputError
from gensim2.objects import Instance, RigidObject
from gensim2.planning.strategies import GraspStrategy, KeypointStrategy, named, parse_strategy
from gensim2.robots import RobotProfile
from gensim2.tasks.spec import HAND, Step, TaskSpec


def check_strategies(
    task: TaskSpec,
    strategies: Mapping[str, Mapping[str, Any]],
    models: Mapping[str, Instance | RigidObject],
    robot: RobotProfile,
    folder: Path,
) -> None:
    """Make sure that every strategy of a task is valid and names only keypoints that there are.

    Args:
        task: whose steps name the strategies.
        strategies: by name, as plain data.
        models: one object each, by name.
        robot: whose tool has keypoints.
        folder: that holds ``strategies/``, for messages.

    Raises:
        InputError: a field is unknown, missing or out of range, or a keypoint is nobody's.
    """
    for step in task.steps:
        for name in step.strategies:
            file = folder / "strategies" / f"{name}.yaml"
            strategy = parse_strategy(strategies[name], file)
            if isinstance(strategy, KeypointStrategy):
                _check_keypoints(step, strategy.solver_config, models, robot, file)
            elif isinstance(strategy, GraspStrategy) and isinstance(models[step.object], Instance):
                raise InputError(
                    f"{step.object} has a joint", file=file, field="grasp", remedy="only rigid objects are grasped so"
                )


def _check_keypoints(
    step: Step, config: kpam.SolverConfig, models: Mapping[str, Instance | RigidObject], robot: RobotProfile, file: Path
) -> None:
    model = robot.model
    points = [f"{role}/{key}" for role, thing in models.items() for key in thing.keypoints]
    points += models[step.object].keypoints
    tool = dict(robot.tool_keypoints)
    if step.tool != HAND:
        tool |= {key: np.array([0.0, 0.01 * n, 0.1]) for n, key in enumerate(models[step.tool].keypoints)}
    thing = models[step.object]
    joint = None
    if isinstance(thing, Instance):
        joint = kpam.Joint(thing.joint.type, np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.5, 0.0, 1.0)
    try:
        kpam.KeypointProblem(
            model,
            config,
            (model.lower + model.upper) / 2,
            tool_keypoints=tool,
            # Anywhere off the joint's axis, no two in one place: names are what is checked.
            object_keypoints={name: np.array([1.0, 0.1 * n, 0.0]) for n, name in enumerate(points)},
            T_base_object=np.eye(4),
            joint=joint,
        )
    except kpam.ProblemError as error:
        raise named(error, file) from error
