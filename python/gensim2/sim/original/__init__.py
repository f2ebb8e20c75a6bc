"""Physics of the original GenSim2 as data: constants by class, and where each of its objects stands by default.

``constants.yaml`` and ``default_poses.csv`` beside this file, read through the package so that a wheel carries them.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.yaml_files import parse_yaml

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class DefaultPose:
    """Where the original puts an object before it randomizes.

    Attributes:
        position: (3,) of the root in the world, m.
        quaternion: (4,) (w, x, y, z), root to world.
        openness: mean of the randomized openness.
    """

    position: Array
    quaternion: Array
    openness: float


@dataclass(frozen=True)
class Constants:
    """What holds in every scene, and what a class has.

    Attributes:
        scene: PhysX's settings, by their names in ManiSkill's ``SceneConfig``.
        material: static and dynamic friction and restitution of every surface but the table's.
        rigid_density: kg/m3 of hulls.
        finger_damping: of the fingers' drives where there are no rigid objects, N s/m.
        picking_fingers: stiffness (N/m) and damping (N s/m) of the fingers' drives where there are.
    """

    scene: Mapping[str, Any]
    material: Mapping[str, float]
    rigid_density: float
    finger_damping: float
    picking_fingers: Mapping[str, float]
    _densities: Mapping[str, float]
    _joint_frictions: Mapping[str, float]

    def density(self, asset_class: str) -> float:
        """Of an articulated object's hulls, kg/m3."""
        return _first_match(self._densities, asset_class)

    def joint_friction(self, asset_class: str) -> float:
        """PhysX's coefficient of articulation friction."""
        return _first_match(self._joint_frictions, asset_class)


@cache
def constants() -> Constants:
    """The constants, read once a process."""
    source = files(__name__) / "constants.yaml"
    data = parse_yaml(source.read_bytes(), str(source))
    density = data["density"]
    return Constants(
        scene=data["scene"],
        material=data["material"],
        rigid_density=density["rigid"],
        finger_damping=data["finger_damping"],
        picking_fingers=data["picking_fingers"],
        _densities=density["articulated"],
        _joint_frictions=data["joint_friction"],
    )


def default_pose(asset_class: str, instance_id: str) -> DefaultPose | None:
    """Where the original puts one of its objects; None where it says nothing of it."""
    return _default_poses().get((asset_class, instance_id))


@cache
def _default_poses() -> dict[tuple[str, str], DefaultPose]:
    text = (files(__name__) / "default_poses.csv").read_text(encoding="utf-8")
    return {(row["class"], row["id"]): _pose(row) for row in csv.DictReader(text.splitlines())}


def _pose(row: Mapping[str, str]) -> DefaultPose:
    position = np.array([float(row[name]) for name in ("x", "y", "z")])
    quaternion = np.array([float(row[name]) for name in ("qw", "qx", "qy", "qz")])
    return DefaultPose(position, quaternion / np.linalg.norm(quaternion), float(row["openness"]))


def _first_match(by_pattern: Mapping[str, float], asset_class: str) -> float:
    return next(value for pattern, value in by_pattern.items() if fnmatchcase(asset_class, pattern))
