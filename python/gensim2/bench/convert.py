"""Convert a recorded problem and its scene to a solver problem."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2 import robots
from gensim2.bench.problems import PlanProblem
from gensim2.bench.scene import ProblemScene, SceneObstacle
from gensim2.core.errors import InputError

Array = npt.NDArray[np.float64]
Frames = Literal["original", "object"]


def _body(obstacle: SceneObstacle) -> kpam.Body:
    shapes = [kpam.Shape.convex_hull(points) for points in obstacle.hulls]
    return kpam.Body(obstacle.name, obstacle.role, shapes, obstacle.pose)


def keypoint_problem(
    problem: PlanProblem,
    scene: ProblemScene,
    robot: kpam.Robot,
    *,
    frames: Frames = "original",
    options: kpam.Options | None = None,
) -> kpam.KeypointProblem:
    """Convert a recorded planning problem to a problem of the keypoint solver.

    Args:
        problem: recorded problem, with its keyframe times and keypoints.
        scene: scene with the obstacles of the problem.
        robot: model of the arm with hand and fingers.
        frames: frame of the hand's motions in the config: ``"object"`` (the hand's), or ``"original"``, as in the
            original GenSim2, rotated by the object's yaw.
        options: solver options that replace the default options for recorded problems.

    Raises:
        InputError: the solver rejects the problem's config, or a number is out of range.
    """
    joint = scene.joint
    # The solver of the original GenSim2 keeps no margin to obstacles, and it ignores collisions between the hand and
    # the manipulated object.
    recorded: kpam.Options = {
        "timing": "config",
        "frames": frames,
        "start_time": problem.start_time,
        "velocity_scale": 1.0,
        "acceleration_scale": 1.0,
        "allow_partial": True,
        **robots.robot("panda").solver,
        "least_margin": 0.0,
        "contact_depth": None,
        "start_depth": 1.0,
    }
    if options is not None:
        recorded.update(options)
    try:
        return kpam.KeypointProblem(
            robot,
            kpam.SolverConfig(problem.timed_config()),
            np.asarray(problem.q_current),
            tool_keypoints={name: np.asarray(p) for name, p in problem.tool_keypoints_hand.items()},
            object_keypoints={name: np.asarray(p) for name, p in problem.object_keypoints_base.items()},
            T_base_object=problem.pose("T_base_object"),
            joint=None
            if joint is None
            else kpam.Joint(joint.kind, joint.origin, joint.axis, joint.value, joint.lower, joint.upper),
            object_axis=problem.object_axis or "y",
            object_yaw=problem.object_yaw,
            T_base_world=np.asarray(np.linalg.inv(problem.pose("T_world_base")), dtype=np.float64),
            bodies=[_body(obstacle) for obstacle in scene.obstacles],
            options=recorded,
        )
    except kpam.KpamError as error:
        raise InputError(
            str(error), field=f"problem {problem.id}", remedy="see docs/reference/solver.md for the config language"
        ) from error
