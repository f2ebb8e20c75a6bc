"""Scenes of library objects on the table, made without a simulator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from gensim2.objects import RigidObject
from gensim2.objects.types import ArticulatedObject
from gensim2.planning.scene import JointState, Scene, SceneBody, SceneObject
from gensim2.robots import robot

Array = npt.NDArray[np.float64]

TABLE = np.array([[x, y, z] for x in (-0.65, 0.65) for y in (-0.65, 0.65) for z in (-0.05, 0.0)])


@dataclass(frozen=True)
class Stands:
    """An object, its pose in the world (of its root, if articulated), and its openness."""

    model: ArticulatedObject | RigidObject
    T_world_root: Array
    openness: float = 0.0
    yaw: float = 0.0
    default_pose: str | None = None


def placed(model: ArticulatedObject, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, openness: float = 0.5) -> Stands:
    """Return an articulated object at its default placement, shifted and turned."""
    pose = _turned(yaw)
    pose[:3, :3] = pose[:3, :3] @ model.placement.rotation
    pose[:3, 3] = model.placement.position
    pose[:2, 3] += x, y
    return Stands(model, pose, openness, yaw)


def resting(model: RigidObject, x: float, y: float, yaw: float = 0.0) -> Stands:
    """Return a rigid object at rest on the table."""
    pose = _turned(yaw)
    pose[:3, :3] = pose[:3, :3] @ model.placement.rotation
    pose[:3, 3] = np.array([x, y, 0.0]) + _turned(yaw)[:3, :3] @ model.placement.position
    return Stands(model, pose, yaw=yaw)


def table_scene(objects: dict[str, Stands]) -> Scene:
    """Return a scene with these objects and the Panda in its rest pose."""
    profile = robot("panda")
    T_base_world = np.linalg.inv(profile.T_world_base)
    q = np.array(profile.reset_qpos)
    return Scene(
        q=q,
        qvel=np.zeros_like(q),
        T_world_base=profile.T_world_base,
        objects={name: _object(name, what, T_base_world) for name, what in objects.items()},
        fixtures=(SceneBody("table", (TABLE,), T_base_world),),
    )


def _object(name: str, stands: Stands, T_base_world: Array) -> SceneObject:
    model, T_base_root = stands.model, T_base_world @ stands.T_world_root
    if isinstance(model, RigidObject):
        return SceneObject(
            name,
            (SceneBody(name, model.hulls["body"], T_base_root),),
            T_base_root,
            {key: _at(T_base_root, point.position) for key, point in model.keypoints.items()},
            yaw=stands.yaw,
            center_of_mass=model.center_of_mass,
        )
    joint = model.joint
    moving = T_base_root @ model.link_pose(stands.openness)
    poses = {link: moving if link == joint.child_link else T_base_root for link in model.hulls}
    return SceneObject(
        name,
        tuple(SceneBody(f"{name}/{link}", hulls, poses[link]) for link, hulls in model.hulls.items() if hulls),
        moving @ model.T_link_object,
        {
            key: _at(moving if point.link == joint.child_link else T_base_root, point.position)
            for key, point in model.keypoints.items()
        },
        JointState(
            joint.type,
            _at(T_base_root, joint.origin),
            T_base_root[:3, :3] @ joint.axis,
            joint.lower + stands.openness * (joint.upper - joint.lower),
            joint.lower,
            joint.upper,
            (f"{name}/{joint.child_link}",),
        ),
        object_axis=model.object_axis,
        yaw=stands.yaw,
    )


def _turned(yaw: float) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
    return pose


def _at(pose: Array, point: Array) -> Array:
    return np.asarray(pose[:3, :3] @ point + pose[:3, 3], dtype=np.float64)
