"""Blueprint of a generated rigid object, at the size of the real thing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gensim2.objects.shapes import Solid, Vec3


@dataclass(frozen=True)
class RigidBlueprint:
    """One object: z up, origin near its middle, metres before ``scale``.

    Attributes:
        parts: convex parts with their look.
        head, tail: keypoints, each (position, description); ``tail`` may be None.
    """

    parts: list[Solid]
    head: tuple[Vec3, str]
    tail: tuple[Vec3, str] | None = None


@dataclass(frozen=True)
class RigidClass:
    """An object of everyday size.

    Attributes:
        mass: kg of the real thing, as published with the YCB object set.
        scale: of lengths, so that a Panda can hold it; the mass goes with its third power.
        build: its geometry.
        friction: of its surface.
        description: one phrase.
    """

    mass: float
    scale: float
    build: Callable[[], RigidBlueprint]
    description: str
    friction: float = 0.6
