"""Whether the robot gets its fingertips to an object's keypoint, by its own kinematics."""

from __future__ import annotations

from functools import cache

import numpy as np

import gensim2_kpam as kpam
from gensim2.inspection.checks import Finding, world_rotation
from gensim2.objects.shapes import transform
from gensim2.objects.types import Array, ArticulatedObject
from gensim2.robots import RobotProfile
from gensim2.scenes.table import HALF_SIZE

SHARES = (0.0, 0.5, 1.0)  # openness
FINGERTIPS = 0.01  # m from the keypoint
HEAD = "articulated_object_head"
BUDGET: kpam.Options = {
    "candidates": 4,
    "samples": 50,
    "extra_seeds": 0,
}  # none is used up: every motion is short or hopeless


def reach_findings(instance: ArticulatedObject, robot: RobotProfile) -> list[Finding]:
    """Openness at which no motion that is clear of the table brings the fingertips to the head keypoint.

    The head is ``articulated_object_head``, or the first keypoint where there is none. What is said is by how many
    millimetres they miss it, or that the table is in the way.

    Raises:
        MissingExtraError: the robot's files come with a package that is not installed.
    """
    name = HEAD if HEAD in instance.keypoints else next(iter(instance.keypoints))
    found = []
    for share in SHARES:
        plan = kpam.plan(_problem(in_base(instance, name, share, robot), robot))
        if plan.status == "solved":
            continue
        check, missed = f"fingertips from {name} at openness {share:g}, mm", plan.residuals[0]
        if missed["satisfied"]:
            found.append(Finding(check, plan.reason, 1000 * FINGERTIPS))
        else:
            found.append(Finding(check, round(1000 * missed["residual"], 1), 1000 * FINGERTIPS))
    return found


def in_base(instance: ArticulatedObject, name: str, openness: float, robot: RobotProfile) -> Array:
    """(3,) keypoint of an instance at its default placement in the robot's base frame, metres."""
    keypoint = instance.keypoints[name]
    point = keypoint.position
    if keypoint.link == instance.joint.child_link:
        point = transform(instance.link_pose(openness), point[None])[0]
    T_base_world = np.linalg.inv(robot.T_world_base)
    at = world_rotation(instance) @ point + instance.placement.position
    return np.asarray(T_base_world[:3, :3] @ at + T_base_world[:3, 3])


@cache
def _config() -> kpam.SolverConfig:
    constraint = {
        "type": "point2point_constraint",
        "keypoint_name": "tool_head",
        "target_keypoint_name": HEAD,
        "tolerance": FINGERTIPS,
    }
    return kpam.SolverConfig(
        {"constraint_list": [constraint], "pre_actuation_motions": [], "post_actuation_motions": []}
    )


def _table(robot: RobotProfile) -> kpam.Body:
    T_world_table = np.eye(4)
    T_world_table[2, 3] = -HALF_SIZE[2]
    T_base_table = np.linalg.inv(robot.T_world_base) @ T_world_table
    return kpam.Body("table", "table", [kpam.Shape.box(HALF_SIZE)], T_base_table)


def _problem(head: Array, robot: RobotProfile) -> kpam.KeypointProblem:
    return kpam.KeypointProblem(
        robot.model,
        _config(),
        np.array(robot.reset_qpos),
        tool_keypoints=robot.tool_keypoints,
        object_keypoints={HEAD: head},
        T_base_object=np.eye(4),
        bodies=[_table(robot)],
        options={**robot.solver, **BUDGET},
    )
