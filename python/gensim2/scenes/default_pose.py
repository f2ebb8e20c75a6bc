"""Determine the default poses of objects: computed poses, or the poses of the original GenSim2.

The poses of the original GenSim2 are in ``default_poses.csv`` in this folder, which is installed with the package.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects import RigidObject
from gensim2.objects.types import ArticulatedObject
from gensim2.scenes.footprint import lowest_of_moving_link
from gensim2.scenes.physics import PhysicsSource


@dataclass(frozen=True)
class DefaultPose:
    """Pose and openness of an object before randomization.

    Attributes:
        position: (3,) position of the root in the world frame, m.
        quaternion: (4,) orientation of the root in the world frame, (w, x, y, z).
        openness: mean of the randomized openness, 0..1; 0 for a rigid object.
        origin: ``"default"`` for a computed pose, ``"original"`` for a pose of the original GenSim2.
    """

    position: Array
    quaternion: Array
    openness: float
    origin: PhysicsSource


def default_pose(model: ArticulatedObject | RigidObject, poses: PhysicsSource) -> DefaultPose:
    """Return the pose of an object before randomization.

    Args:
        model: object to place.
        poses: ``"default"``: computed poses; ``"original"``: poses published by the original GenSim2. Objects without a
            published pose get a computed one. So do all rigid objects, because some of their published poses overlap
            the table.
    """
    if poses == "original" and isinstance(model, ArticulatedObject):
        pose = released_pose(model)
        if pose is not None:
            # In some original poses the moving link overlaps the table. The overlap blocks the joint at 400 N in SAPIEN
            # 3, but not at 5 N in the original's SAPIEN 2. Therefore the object is lifted.
            sunk = max(0.0, -lowest_of_moving_link(model, pose.position, pose.quaternion))
            return DefaultPose(pose.position + np.array([0.0, 0.0, sunk]), pose.quaternion, pose.openness, "original")
    openness = 0.0 if isinstance(model, RigidObject) else model.default_openness
    return DefaultPose(model.placement.position, model.placement.quaternion, openness, "default")


def released_pose(model: ArticulatedObject) -> DefaultPose | None:
    """Return the pose of the original GenSim2 for a released model; None if the model has no such pose.

    Only real models have such a pose; generated objects use the same ids for other shapes.
    """
    return _released_poses().get((model.asset_class, model.id)) if model.source == "real" else None


@cache
def _released_poses() -> dict[tuple[str, str], DefaultPose]:
    text = (files("gensim2.scenes") / "default_poses.csv").read_text(encoding="utf-8")
    return {(row["class"], row["id"]): _pose(row) for row in csv.DictReader(text.splitlines())}


def _pose(row: Mapping[str, str]) -> DefaultPose:
    position = np.array([float(row[name]) for name in ("x", "y", "z")])
    quaternion = np.array([float(row[name]) for name in ("qw", "qx", "qy", "qz")])
    return DefaultPose(position, quaternion / np.linalg.norm(quaternion), float(row["openness"]), "original")
