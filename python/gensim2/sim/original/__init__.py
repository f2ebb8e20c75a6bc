"""Physics of the original GenSim2 as data: constants by class.

``constants.yaml`` beside this file is read through the package so that a wheel carries it.
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
    """Constants of every scene and of a class.

    Attributes:
        scene: PhysX's settings, by their names in ManiSkill's ``SceneConfig``.
        material: static and dynamic friction and restitution of every surface but the table's.
        rigid_density: kg/m3 of hulls.
        fingers: stiffness (N/m) and damping (N s/m) of the original's drives of the fingers.
        fingers_for: of those where there is a rigid object of a class.
        finger_damping: of the soft drives where there are no rigid objects, N s/m.
        picking_fingers: stiffness and damping of the soft drives where there are.
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
        fingers=data["fingers"],
        fingers_for=data["fingers_for"],
        finger_damping=data["finger_damping"],
        picking_fingers=data["picking_fingers"],
        _densities=density["articulated"],
        _joint_frictions=data["joint_friction"],
    )


def _first_match(by_pattern: Mapping[str, float], asset_class: str) -> float:
    return next(value for pattern, value in by_pattern.items() if fnmatchcase(asset_class, pattern))
