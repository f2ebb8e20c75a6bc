"""Blueprint of an instance of a generated class, in the object's model frame.

As in PartNet-Mobility, the origin is near the middle of the body. For a viewer in front of the object, x points right,
y up and z towards the viewer. The geometry is given at joint value zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gensim2.objects.shapes import Solid, Vec3


@dataclass(frozen=True)
class Blueprint:
    """Geometry, joint and keypoints of a generated object.

    Attributes:
        body: fixed parts.
        moving: parts that the joint moves.
        joint_type: ``"revolute"`` or ``"prismatic"``.
        joint_origin: (3,) a point on the joint axis, metres.
        joint_axis: (3,) direction of the joint axis; positive values open the joint.
        limits: joint value (rad or m) at openness 0, and joint value at openness 1.
        keypoints: position (m) and description by name. Keypoints with ``base`` in their names are fixed to the body,
            others to the moving link.
    """

    body: list[Solid]
    moving: list[Solid]
    joint_type: Literal["revolute", "prismatic"]
    joint_origin: Vec3
    joint_axis: Vec3
    limits: tuple[float, float]
    keypoints: dict[str, tuple[Vec3, str]]

    @property
    def object_axis(self) -> Literal["x", "y", "z"]:
        """Axis of the model frame that is closest to the joint axis. The hand turns about it in "rotate" motions."""
        axes: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
        return axes[int(np.argmax(np.abs(self.joint_axis)))]


@dataclass(frozen=True)
class ObjectClass:
    """A class of generated objects, defined as ``OBJECT_CLASS`` in a module of ``gensim2.objects.generators.classes``.

    Attributes:
        name: folder name of the class in the GenSim2 release.
        count: number of built-in (listed) instances.
        joint_type: joint type of the class's objects.
        build: function that returns the blueprint of a random instance.
        others: builders of other designs. Instances beyond the built-in ones use all builders equally often; built-in
            ones use only ``build``.
    """

    name: str
    count: int
    joint_type: Literal["revolute", "prismatic"]
    build: Callable[[np.random.Generator], Blueprint]
    others: tuple[Callable[[np.random.Generator], Blueprint], ...] = ()
