"""Blueprint of one instance of a generated class, in the object's model frame.

The model frame is that of PartNet-Mobility: origin near the middle of the body, x to the right as seen from the
front, y up, z out of the front. Everything is given at joint value zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gensim2.objects.shapes import Solid, Vec3


@dataclass(frozen=True)
class Blueprint:
    """One generated object.

    Attributes:
        body: parts that stand still.
        moving: parts that the joint moves.
        joint_type: ``"revolute"`` or ``"prismatic"``.
        joint_origin: a point on the axis, metres.
        joint_axis: direction, opening is positive.
        limits: lower and upper joint value in rad or m; openness 0 and 1.
        keypoints: name to (position in metres, description). A name that contains ``base`` belongs to the body, any
            other to the moving link.
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
        """Axis of the model frame along which the joint turns or slides; "rotate" motions turn about it."""
        axes: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
        return axes[int(np.argmax(np.abs(self.joint_axis)))]


@dataclass(frozen=True)
class ObjectClass:
    """A class of generated objects; a module of ``gensim2.objects.generators.classes`` holds one as ``OBJECT_CLASS``.

    Attributes:
        name: folder name of the class in the GenSim2 release.
        count: built-in instances.
        joint_type: what ``build`` makes.
        build: draws one instance.
        others: draw instances of other makes. Built-in instances are never of these, so that they stay what they were;
            of the numbers behind them each make has as many.
    """

    name: str
    count: int
    joint_type: Literal["revolute", "prismatic"]
    build: Callable[[np.random.Generator], Blueprint]
    others: tuple[Callable[[np.random.Generator], Blueprint], ...] = ()
