"""Provide the physics constants of the original GenSim2. Some of the constants differ between object classes.

The constants are stored in ``constants.yaml`` in this folder. The file is part of the installed package.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from importlib.resources import files
from typing import Any

from gensim2.core.yaml_files import parse_yaml


@dataclass(frozen=True)
class Constants:
    """Physics constants for all scenes and for single object classes.

    With the original solver settings, grasped objects slip unless the drives are ``"soft"``, which are weaker than the
    default.

    Attributes:
        scene: PhysX settings, named as in ManiSkill's ``SceneConfig``.
        material: static friction, dynamic friction and restitution of every surface except the table's.
        rigid_density: density of rigid objects' hulls, kg/m3.
        fingers: stiffness (N/m) and damping (N s/m) of the original GenSim2's finger drives.
        fingers_for: original stiffness and damping in scenes with an object of a rigid class; they replace ``fingers``.
        finger_damping: damping (N s/m) of soft drives in scenes without rigid objects. Their stiffness is the robot's.
        picking_fingers: stiffness (N/m) and damping (N s/m) of the soft drives in scenes with rigid objects.
    """

    scene: Mapping[str, Any]
    material: Mapping[str, float]
    rigid_density: float
    fingers: Mapping[str, float]
    fingers_for: Mapping[str, Mapping[str, float]]
    finger_damping: float
    picking_fingers: Mapping[str, float]
    _densities: Mapping[str, float]
    _joint_frictions: Mapping[str, float]

    def density(self, asset_class: str) -> float:
        """Return the density of an articulated object's hulls, kg/m3."""
        return _first_match(self._densities, asset_class)

    def joint_friction(self, asset_class: str) -> float:
        """Return the joint friction coefficient of a class. PhysX multiplies it by the load on the joint."""
        return _first_match(self._joint_frictions, asset_class)


@cache
def constants() -> Constants:
    """Return the constants; the file is read once in each process."""
    source = files(__name__) / "constants.yaml"
    data = parse_yaml(source.read_bytes(), str(source))
    density = data["density"]
    return Constants(
        scene=data["scene"],
        material=data["material"],
        rigid_density=density["rigid"],
        fingers=data["fingers"],
        fingers_for=data["fingers_for"],
        finger_damping=data["finger_damping"],
        picking_fingers=data["picking_fingers"],
        _densities=density["articulated"],
        _joint_frictions=data["joint_friction"],
    )


def _first_match(by_pattern: Mapping[str, float], asset_class: str) -> float:
    return next(value for pattern, value in by_pattern.items() if fnmatchcase(asset_class, pattern))
