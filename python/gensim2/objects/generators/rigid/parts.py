"""Define shapes, materials and blueprint of generated rigid objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.shapes import Look, Mesh, Solid, Vec3, box, convex, pose, ring, swept, turned_profile


@dataclass(frozen=True)
class RigidBlueprint:
    """Geometry of a rigid object.

    z points up and the origin is near the middle. Lengths are in metres; the ``scale`` of the class is applied later.

    Attributes:
        parts: convex parts with their materials.
        head, tail: keypoints, each with position (3,) and description; ``tail`` may be None.
    """

    parts: list[Solid]
    head: tuple[Vec3, str]
    tail: tuple[Vec3, str] | None = None


@dataclass(frozen=True)
class RigidClass:
    """Definition of a generated rigid object.

    Attributes:
        mass: mass of the real item, kg, as published with the YCB object set.
        scale: factor on all lengths, so that a Panda can grasp the object. The mass is multiplied by the cube of the
            factor.
        build: function that creates the geometry.
        friction: friction coefficient of the surface.
        description: phrase that describes the object.
    """

    mass: float
    scale: float
    build: Callable[[], RigidBlueprint]
    description: str
    friction: float = 0.6


UP = (0.0, 0.0, 1.0)


def plastic(r: float, g: float, b: float) -> Look:
    """Return a smooth coloured material."""
    return Look((r, g, b, 1.0), 0.0, 0.4)


def matte(r: float, g: float, b: float) -> Look:
    """Return a rough coloured material."""
    return Look((r, g, b, 1.0), 0.0, 0.9)


STEEL = Look((0.75, 0.76, 0.78, 1.0), 0.9, 0.25)
WHITE = plastic(0.93, 0.93, 0.91)
BLACK = plastic(0.04, 0.04, 0.05)
WOOD = matte(0.72, 0.52, 0.32)
STEM = matte(0.25, 0.16, 0.07)
LEAF = matte(0.13, 0.42, 0.12)


def scaled(solid: Solid, factor: float | Vec3) -> Solid:
    """Return the part scaled about the origin by a positive ``factor``.

    The factor is one number, or one for each axis.
    """
    f = np.broadcast_to(np.asarray(factor, float), (3,))
    hull = None if solid.hull is None else solid.hull * f
    mesh = None if solid.mesh is None else replace(solid.mesh, vertices=solid.mesh.vertices * f)
    return Solid(hull, mesh)


def turned(profile: Sequence[tuple[float, float]], look: Look, sides: int = 12, smooth: int = 6) -> list[Solid]:
    """Return a solid of revolution about the z axis.

    The visual mesh is smooth. The collision shape is a stack of hulls. Each has as many profile points as stay convex.

    Args:
        profile: (radius, height) from the bottom up, metres.
        look: material.
        sides: number of sides of the collision hulls.
        smooth: number of points of the visual mesh that are interpolated (monotone) between two points of the profile.
    """
    from scipy.interpolate import PchipInterpolator

    radius, height = np.array(profile).T
    parts = []
    low = 0
    for high in range(1, len(profile)):
        # Each hull is made as long as possible: it ends where the outline is no longer convex.
        last = high + 1 == len(profile)
        if last or not _bulges(radius[low : high + 2], height[low : high + 2]):
            rings = [_circle(radius[k], height[k], sides) for k in range(low, high + 1)]
            parts.append(Solid(convex(np.concatenate(rings), look).hull, None))
            low = high
    if smooth > 1 and len(profile) > 2:
        t = np.concatenate([np.linspace(a, b, smooth, endpoint=False) for a, b in pairwise(range(len(profile)))])
        t = np.append(t, len(profile) - 1)
        at = np.arange(len(profile))
        radius, height = PchipInterpolator(at, radius)(t), PchipInterpolator(at, height)(t)
    bottom, top = float(height[0]), float(height[-1])
    outline = [(1e-5, 0.0), *zip(radius, (height - bottom) / (top - bottom), strict=True), (1e-5, 1.0)]
    parts.append(turned_profile((0, 0, bottom), (0, 0, top), outline, look, 32))
    return parts


def _bulges(radius: Array, height: Array) -> bool:
    """Return whether an outline, from bottom to top, is convex."""
    turn = np.diff(np.diff(radius) / np.maximum(np.diff(height), 1e-9))
    return bool((turn <= 1e-9).all())


def _circle(radius: float, height: float, sides: int) -> Array:
    return ring((0, 0, height), UP, max(radius, 1e-4), sides)


def vessel(outline: Sequence[tuple[float, float]], wall: float, look: Look, sides: int = 12) -> list[Solid]:
    """Return a round vessel that is open at the top.

    The vessel has a floor. Its wall consists of rings of flat segments (staves) between points of the outline.

    Args:
        outline: (outer radius, height) from the foot to the rim, metres.
        wall: thickness of wall and floor, m.
        look: material.
        sides: number of staves in each ring.
    """
    parts = []
    for (r0, z0), (r1, z1) in pairwise(outline):
        rings = [_circle(r, z, sides) for r, z in ((r0, z0), (r0 - wall, z0), (r1, z1), (r1 - wall, z1))]
        for i in range(sides):
            j = (i + 1) % sides
            stave = np.array([c[k] for c in rings for k in (i, j)])
            parts.append(Solid(convex(stave, look).hull, None))
    (r, z), top = outline[0], outline[-1][1]
    floor = np.concatenate([_circle(r - 0.5 * wall, h, sides) for h in (z, z + wall)])
    parts.append(Solid(convex(floor, look).hull, None))
    inside = [(radius - wall, h) for radius, h in reversed(outline)]
    inside[-1] = (inside[-1][0], z + wall)
    section = [(1e-5, z), *outline, *inside, (1e-5, z + wall)]
    seen = [(radius, (h - z) / (top - z)) for radius, h in section]
    parts.append(turned_profile((0, 0, z), (0, 0, top), seen, look, 40))
    return parts


def sphere(radius: float | Vec3, look: Look, at: Vec3 = (0, 0, 0)) -> Solid:
    """Return a sphere or ellipsoid: an icosphere with 42 vertices for collision and 642 vertices for display."""
    import trimesh  # imported here because listing objects does not need it

    scale = np.broadcast_to(np.asarray(radius, float), (3,))
    hull = np.asarray(trimesh.creation.icosphere(1).vertices, float)
    seen = trimesh.creation.icosphere(3)
    vertices = np.asarray(seen.vertices, float) * scale + np.asarray(at, float)
    return Solid(hull * scale + np.asarray(at, float), Mesh(vertices, np.asarray(seen.faces, np.int64), look))


def seam(radius: float, look: Look, thickness: float) -> Solid:
    """Return the seam of a baseball or tennis ball, without collision parts."""
    t = np.linspace(0, 2 * np.pi, 97)
    a, b = 0.75, 0.25
    line = np.column_stack(
        [a * np.cos(t) + b * np.cos(3 * t), a * np.sin(t) - b * np.sin(3 * t), 2 * np.sqrt(a * b) * np.sin(2 * t)]
    )
    line *= radius / np.linalg.norm(line, axis=1)[:, None]
    return Solid(None, swept(list(line), thickness, look, 8))


def carton(size: Vec3, look: Look, stripe: Look, patch: Look) -> list[Solid]:
    """Return a cardboard box with a printed front, back and top."""
    x, y, z = np.asarray(size, float)
    skin = 0.0004
    parts = [box((0, 0, 0), (x, y, z), look, 0.001)]
    for side in (-1, 1):
        parts += [
            box((side * x / 2, 0, 0.22 * z), (2 * skin, 0.8 * y, 0.3 * z), patch, 0).visual_only(),
            box((side * x / 2, 0, -0.25 * z), (2 * skin, 0.98 * y, 0.16 * z), stripe, 0).visual_only(),
            box((0, side * y / 2, 0), (0.8 * x, 2 * skin, 0.7 * z), stripe, 0).visual_only(),
        ]
    parts.append(box((0, 0, z / 2), (0.7 * x, 0.7 * y, 2 * skin), patch, 0).visual_only())
    return parts


def can(radius: float, height: float, label: Look, lid: Look = STEEL) -> list[Solid]:
    """Return a tin can: a metal cylinder with rims and a paper label."""
    h = height / 2
    rim = min(0.004, 0.1 * height)
    body = [(radius, -h), (radius, h)]
    parts = turned(body, lid, 16, 1)
    band = [(radius + 0.0005, -h + 1.5 * rim), (radius + 0.0005, h - 1.5 * rim)]
    parts += [p.visual_only() for p in turned(band, label, 16, 1)]
    for end in (-1, 1):
        edge = ring((0, 0, end * (h - rim / 2)), UP, radius - 0.2 * rim, 48)
        parts.append(Solid(None, swept([*edge, edge[0]], rim / 2, lid, 8)))
    return parts


def blade(points: Sequence[tuple[float, float]], thickness: float, look: Look, at: float = 0.0) -> Solid:
    """Return a convex plate parallel to the xy plane with the outline ``points``. Its middle plane has z = ``at``."""
    flat = np.array([(x, y, at + s * thickness / 2) for x, y in points for s in (-1, 1)])
    return convex(flat, look)


def along_x(parts: Sequence[Solid]) -> list[Solid]:
    """Rotate parts such that their z axis becomes the x axis."""
    T = pose(axis=(0, 1, 0), angle=np.pi / 2)
    return [p.moved(T) for p in parts]


def shifted(parts: Sequence[Solid], by: Vec3) -> list[Solid]:
    """Translate parts by a vector."""
    return [p.moved(pose(by)) for p in parts]


def curved(points: Sequence[Vec3], radii: Sequence[float], look: Look, sides: int = 10) -> list[Solid]:
    """Return a round bar of varying radius along a polyline.

    The bar has one hull for each segment and one smooth visual surface.
    """
    from gensim2.objects.shapes import loft

    p = [np.asarray(q, float) for q in points]
    tangents = np.gradient(np.array(p), axis=0)
    rings = [ring(q, t, r, sides) for q, t, r in zip(p, tangents, radii, strict=True)]
    hulls = [Solid(convex(np.concatenate(pair), look).hull, None) for pair in pairwise(rings)]
    fine = [ring(q, t, r, 24) for q, t, r in zip(p, tangents, radii, strict=True)]
    return [*hulls, Solid(None, loft(fine, look))]


def bounds(parts: Sequence[Solid]) -> tuple[Array, Array]:
    """Return the lower and upper corner (3,) of the bounding box of the collision hulls."""
    points = np.concatenate([p.hull for p in parts if p.hull is not None])
    return points.min(axis=0), points.max(axis=0)


def centred(parts: Sequence[Solid]) -> list[Solid]:
    """Translate parts so that the centre of their bounding box is the origin."""
    low, high = bounds(parts)
    return shifted(parts, -(low + high) / 2)
