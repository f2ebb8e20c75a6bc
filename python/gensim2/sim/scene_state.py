"""From the simulator to :class:`~gensim2.planning.scene.Scene`: all in the robot base frame, in float64."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from sapien import physx

from gensim2.objects.types import Instance
from gensim2.planning.scene import JointState, Role, Scene, SceneBody
from gensim2.robots import RobotProfile
from gensim2.sim.objects import link_name
from gensim2.sim.table import HALF_SIZE, corners

Array = npt.NDArray[np.float64]


def read_scene(
    arm: physx.PhysxArticulation,
    robot: RobotProfile,
    articulation: physx.PhysxArticulation,
    instance: Instance,
    object_yaw: float,
) -> Scene:
    """Read out where everything stands.

    Args:
        arm: the robot as it was built.
        robot: its profile.
        articulation: ``instance`` as it was built.
        instance: its hulls, keypoints and joint are carried over.
        object_yaw: what the randomization turned it by, rad.
    """
    T_world_base = robot.T_world_base  # exact: the simulator's own value is rounded to float32
    T_base_world = np.asarray(np.linalg.inv(T_world_base), dtype=np.float64)
    T_base_link = {link_name(link): T_base_world @ _matrix(link) for link in articulation.links}
    T_base_root = T_base_link[link_name(articulation.root)]
    joint = instance.joint
    moving = _moved_by(articulation, joint.child_link)
    bodies = [_table(T_base_world)]
    for link, hulls in instance.hulls.items():
        if hulls:
            role: Role = "moving_link" if link in moving else "object_body"
            bodies.append(SceneBody(f"object/{link}", role, hulls, T_base_link[link]))
    return Scene(
        q=np.asarray(arm.qpos, dtype=np.float64),
        T_world_base=T_world_base,
        T_base_object=T_base_link[joint.child_link] @ instance.T_link_object,
        object_keypoints={
            name: _transform(T_base_link[point.link], point.position) for name, point in instance.keypoints.items()
        },
        joint=JointState(
            type=joint.type,
            origin=_transform(T_base_root, joint.origin),
            axis=_unit(T_base_root[:3, :3] @ joint.axis),
            value=float(articulation.qpos[0]),
            lower=joint.lower,
            upper=joint.upper,
        ),
        object_yaw=object_yaw,
        bodies=tuple(bodies),
    )


def _table(T_base_world: Array) -> SceneBody:
    T_world_table = np.eye(4)
    T_world_table[2, 3] = -HALF_SIZE[2]
    return SceneBody("table", "table", (corners(),), T_base_world @ T_world_table)


def _matrix(link: physx.PhysxArticulationLinkComponent) -> Array:
    return np.asarray(link.entity.pose.to_transformation_matrix(), dtype=np.float64)


def _transform(pose: Array, point: Array) -> Array:
    return np.asarray(pose[:3, :3] @ point + pose[:3, 3], dtype=np.float64)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)


def _moved_by(articulation: physx.PhysxArticulation, link: str) -> set[str]:
    """Names of the link and of everything fixed beneath it."""
    moved = {link}
    for candidate in articulation.links:  # parents come before their children
        parent = candidate.parent
        if parent is not None and link_name(parent) in moved:
            moved.add(link_name(candidate))
    return moved
