"""Predict the scene after a step, assuming that the plan succeeds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.types import joint_motion
from gensim2.planning.scene import Scene, SceneObject
from gensim2.planning.world import carried_by


def with_joint(scene: Scene, name: str, value: float) -> Scene:
    """Return the scene with an object's joint at ``value`` (rad or m). Objects inside the moving part move with it."""
    thing = scene.objects[name]
    joint = thing.joint
    assert joint is not None, name
    value = float(np.clip(value, joint.lower, joint.upper))
    motion = joint_motion(joint.type, joint.axis, value - joint.value, joint.origin)
    objects = dict(scene.objects)
    for other in scene.objects.values():
        if other.is_rigid and other.name != scene.held and carried_by(scene, other.name) == name:
            objects[other.name] = moved(other, motion)
    objects[name] = replace(
        thing,
        bodies=tuple(
            replace(body, T_base_body=motion @ body.T_base_body) if body.name in joint.moves else body
            for body in thing.bodies
        ),
        T_base_object=motion @ thing.T_base_object,
        # A keypoint with "base" in its name belongs to the fixed part, which the joint does not move.
        keypoints={key: at if "base" in key else _point(motion, at) for key, at in thing.keypoints.items()},
        joint=replace(joint, value=value),
    )
    return replace(scene, objects=objects)


def with_pose(scene: Scene, name: str, T_base_object: Array) -> Scene:
    """Return the scene with a rigid object at another pose (4, 4) in the base frame."""
    thing = scene.objects[name]
    motion = T_base_object @ np.linalg.inv(thing.T_base_object)
    return replace(scene, objects={**scene.objects, name: moved(thing, motion)})


def moved(thing: SceneObject, motion: Array) -> SceneObject:
    """Return a rigid object after a motion (4, 4) in the base frame."""
    return replace(
        thing,
        bodies=tuple(replace(body, T_base_body=motion @ body.T_base_body) for body in thing.bodies),
        T_base_object=motion @ thing.T_base_object,
        keypoints={key: _point(motion, at) for key, at in thing.keypoints.items()},
    )


def _point(motion: Array, point: Array) -> Array:
    return np.asarray(motion[:3, :3] @ point + motion[:3, 3], dtype=np.float64)
