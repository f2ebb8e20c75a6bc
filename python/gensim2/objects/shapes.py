"""Create convex solids with materials. Generated objects are built from these solids.

The frame is an object's model frame: x points to the right as seen from the front, y points up, and z points out of the
front. Lengths are in metres. A ``Solid`` is a convex collision part, a visual mesh, or both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

Faces = npt.NDArray[np.int64]
Vec3 = Sequence[float] | Array


@dataclass(frozen=True)
class Look:
    """Surface appearance: linear RGBA in 0..1, metallic and roughness as in glTF."""

    rgba: tuple[float, float, float, float] = (0.7, 0.7, 0.7, 1.0)
    metallic: float = 0.0
    roughness: float = 0.6


@dataclass(frozen=True)
class Mesh:
    """Visual triangles: ``vertices`` (N, 3) metres, ``faces`` (M, 3)."""

    vertices: Array
    faces: Faces
    look: Look


@dataclass(frozen=True)
class Solid:
    """A convex part of an object.

    Attributes:
        hull: (N, 3) vertices of the collision hull, or None for a part without collision.
        mesh: visual mesh, or None for a part that only collides.
    """

    hull: Array | None
    mesh: Mesh | None

    def moved(self, T: Array) -> Solid:
        """Return the part after the rigid transform ``T`` (4, 4)."""
        hull = None if self.hull is None else transform(T, self.hull)
        mesh = None if self.mesh is None else replace(self.mesh, vertices=transform(T, self.mesh.vertices))
        return Solid(hull, mesh)

    def visual_only(self) -> Solid:
        """Return a copy of the part without collision hull."""
        return Solid(None, self.mesh)


def transform(T: Array, points: Array) -> Array:
    """Apply a (4, 4) rigid transform to (N, 3) points."""
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def rotation(axis: Vec3, angle: float) -> Array:
    """Return the (3, 3) rotation by ``angle`` rad about the vector ``axis``, which may have any length."""
    from scipy.spatial.transform import Rotation  # imported here because listing classes does not need SciPy

    k = np.asarray(axis, float) / np.linalg.norm(axis)
    return np.asarray(Rotation.from_rotvec(angle * k).as_matrix())


def pose(position: Vec3 = (0, 0, 0), axis: Vec3 = (0, 0, 1), angle: float = 0.0) -> Array:
    """Return the (4, 4) transform that rotates by ``angle`` rad about ``axis`` and then translates by ``position``."""
    T = np.eye(4)
    T[:3, :3] = rotation(axis, angle)
    T[:3, 3] = position
    return T


def convex_hull(points: Array) -> ConvexHull:
    """Return SciPy's convex hull of (N, 3) points."""
    from scipy.spatial import ConvexHull  # imported here because listing classes does not need SciPy

    return ConvexHull(points)


def hull_mesh(points: Array, look: Look) -> Mesh:
    """Return the surface of the convex hull of (N, 3) points, facing outwards."""
    hull = convex_hull(points)
    faces = hull.simplices.astype(np.int64)
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    used, renumbered = np.unique(faces, return_inverse=True)
    return Mesh(points[used], renumbered.reshape(-1, 3).astype(np.int64), look)


def convex(points: Array | Sequence[Vec3], look: Look) -> Solid:
    """Return the convex hull of (N, 3) points as a solid."""
    p = np.asarray(points, float)
    return Solid(p[convex_hull(p).vertices], hull_mesh(p, look))


def box(center: Vec3, size: Vec3, look: Look, bevel: float = 0.0015) -> Solid:
    """Return a box with edge lengths ``size``, m; its visual edges are bevelled by ``bevel`` metres."""
    c, half = np.asarray(center, float), np.asarray(size, float) / 2
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    corners = c + signs * half
    cut = min(bevel, 0.3 * float(half.min()))
    if cut <= 0:
        return Solid(corners, hull_mesh(corners, look))
    seen = np.concatenate([c + signs * (half - cut * (1 - np.eye(3)[axis])) for axis in range(3)])
    return Solid(corners, hull_mesh(seen, look))


def rounded_box(center: Vec3, size: Vec3, look: Look, radius: float, axis: int = 1, steps: int = 5) -> Solid:
    """Return a box whose four edges along ``axis`` are rounded with ``radius``."""
    c, half = np.asarray(center, float), np.asarray(size, float) / 2
    u, v = [i for i in range(3) if i != axis]
    r = min(radius, 0.98 * float(min(half[u], half[v])))
    points = []
    for su, sv, start in ((1, 1, 0.0), (-1, 1, 0.5), (-1, -1, 1.0), (1, -1, 1.5)):
        for angle in np.pi * (start + 0.5 * np.linspace(0, 1, steps)):
            p = np.zeros(3)
            p[u] = su * (half[u] - r) + r * np.cos(angle)
            p[v] = sv * (half[v] - r) + r * np.sin(angle)
            for end in (-1, 1):
                q = p.copy()
                q[axis] = end * half[axis]
                points.append(c + q)
    return convex(np.array(points), look)


def _frame(direction: Array) -> tuple[Array, Array]:
    """Return two unit vectors that complete ``direction`` to a right-handed frame."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    u = np.cross(direction, helper)
    u /= np.linalg.norm(u)
    return u, np.cross(direction, u)


def ring(center: Vec3, direction: Vec3, radius: float, sides: int, start: float = 0.0) -> Array:
    """Return points (sides, 3) on a circle around ``center``, perpendicular to ``direction``."""
    d = np.asarray(direction, float) / np.linalg.norm(direction)
    u, v = _frame(d)
    angle = start + 2 * np.pi * np.arange(sides) / sides
    return np.asarray(np.asarray(center, float) + radius * (np.outer(np.cos(angle), u) + np.outer(np.sin(angle), v)))


def cone(a: Vec3, b: Vec3, radius_a: float, radius_b: float, look: Look, sides: int = 16) -> Solid:
    """Return a truncated cone from ``a`` to ``b``.

    Its hull has ``sides`` edges, and its visual mesh has twice as many.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    hull = np.concatenate([ring(a, b - a, radius_a, sides), ring(b, b - a, radius_b, sides)])
    seen = np.concatenate([ring(a, b - a, radius_a, 2 * sides), ring(b, b - a, radius_b, 2 * sides)])
    return Solid(hull, hull_mesh(seen, look))


def rod(a: Vec3, b: Vec3, radius: float, look: Look, sides: int = 12) -> Solid:
    """Return a cylinder from ``a`` to ``b``."""
    return cone(a, b, radius, radius, look, sides)


def ball(center: Vec3, radius: float | Vec3, look: Look) -> Solid:
    """Return a sphere, or an ellipsoid if ``radius`` has three values."""
    c = np.asarray(center, float)
    scale = np.broadcast_to(np.asarray(radius, float), (3,))

    def sphere(rows: int, sides: int) -> Array:
        lat = np.pi * (np.arange(1, rows) / rows - 0.5)
        points = [
            np.column_stack(
                [
                    np.cos(t) * np.cos(2 * np.pi * np.arange(sides) / sides),
                    np.full(sides, np.sin(t)),
                    np.cos(t) * np.sin(2 * np.pi * np.arange(sides) / sides),
                ]
            )
            for t in lat
        ]
        return np.concatenate([*points, [[0, -1.0, 0], [0, 1.0, 0]]])

    return Solid(c + scale * sphere(5, 10), hull_mesh(c + scale * sphere(12, 24), look))


def path(points: Sequence[Vec3], radius: float, look: Look, sides: int = 10) -> list[Solid]:
    """Return a round bar along a polyline: one collision cylinder for each segment, and a smooth visual mesh."""
    p = [np.asarray(q, float) for q in points]
    legs = [Solid(rod(a, b, radius, look, sides).hull, None) for a, b in pairwise(p)]
    return [*legs, Solid(None, swept(_rounded(p, radius), radius, look))]


def _rounded(points: Sequence[Array], radius: float, steps: int = 4) -> list[Array]:
    """Round a polyline's corners by parabolas from three times ``radius``, at most half an edge, from each."""
    line = [points[0]]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        ends = []
        for other in (before, after):
            length = float(np.linalg.norm(other - corner))
            ends.append(corner + (other - corner) * min(3 * radius, 0.5 * length) / length)
        for t in np.linspace(0, 1, steps + 1):
            line.append((1 - t) ** 2 * ends[0] + 2 * t * (1 - t) * corner + t**2 * ends[1])
    line.append(points[-1])
    return [line[0]] + [b for a, b in pairwise(line) if float(np.linalg.norm(b - a)) > 1e-6]


def swept(points: Sequence[Array], radius: float, look: Look, sides: int = 14) -> Mesh:
    """Return the surface of a round bar along a polyline, closed at both ends."""
    p = np.array(points)
    tangents = np.gradient(p, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    u, _ = _frame(tangents[0])
    rings = []
    for point, tangent in zip(p, tangents, strict=True):
        # Remove the part of ``u`` along the tangent. The cross-section then does not twist about the path.
        u = u - (u @ tangent) * tangent
        u /= np.linalg.norm(u)
        v = np.cross(tangent, u)
        angle = 2 * np.pi * np.arange(sides) / sides
        rings.append(point + radius * (np.outer(np.cos(angle), u) + np.outer(np.sin(angle), v)))
    return loft(rings, look)


def loft(rings: Sequence[Array], look: Look, closed: bool = True) -> Mesh:
    """Return the surface of successive rings (N, 3), which are counterclockwise as seen from the last ring.

    If ``closed``, flat faces are added at both ends. Otherwise the surface returns to the first ring, as in a torus.
    """
    n, k = len(rings[0]), len(rings)
    vertices = [*rings]
    i, j = np.meshgrid(np.arange(n), np.arange(k - 1 if closed else k), indexing="xy")
    a, b = j * n + i, j * n + (i + 1) % n
    c, d = (a + n) % (k * n), (b + n) % (k * n)
    faces = [np.stack([a, b, d], axis=-1).reshape(-1, 3), np.stack([a, d, c], axis=-1).reshape(-1, 3)]
    if closed:
        for ring, start, step in ((rings[0], 0, -1), (rings[-1], (k - 1) * n, 1)):
            center = sum(len(v) for v in vertices)
            vertices.append(ring.mean(axis=0)[None])
            around = np.arange(n)
            fan = [np.full(n, center), start + around, start + (around + 1) % n]
            faces.append(np.stack(fan if step > 0 else [fan[0], fan[2], fan[1]], axis=1))
    return Mesh(np.concatenate(vertices), np.concatenate(faces).astype(np.int64), look)


def turned_profile(a: Vec3, b: Vec3, profile: Sequence[tuple[float, float]], look: Look, sides: int = 48) -> Solid:
    """Return a visual solid of revolution: a closed profile rotated about the line from ``a`` to ``b``.

    Args:
        a, b: (3,) ends of the axis, m.
        profile: corners (radius in m, position along the axis from 0 at ``a`` to 1 at ``b``). The corners are
            counterclockwise in a diagram with the radius to the right and the axis upwards.
        look: material.
        sides: number of flat sides that approximate the circle around the axis.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    rings = [ring(a + share * (b - a), b - a, radius, sides) for radius, share in profile]
    return Solid(None, loft(rings, look, closed=False))


def arc(center: Vec3, u: Vec3, v: Vec3, radius: float, start: float, stop: float, legs: int) -> list[Array]:
    """Return ``legs`` + 1 points ``center + radius (cos t u + sin t v)`` for t from ``start`` to ``stop`` (rad)."""
    c, u, v = np.asarray(center, float), np.asarray(u, float), np.asarray(v, float)
    return [c + radius * (np.cos(t) * u + np.sin(t) * v) for t in np.linspace(start, stop, legs + 1)]


def tray(
    center: Vec3, size: Vec3, wall: float, look: Look, open_side: str = "+y", floor: float | None = None
) -> list[Solid]:
    """Return a hollow box of five walls, open on one side.

    Args:
        center, size: centre and size (3,) of the outer box, m.
        wall: thickness of the four walls around the opening, m.
        look: material.
        open_side: ``"+x"``, ``"-x"``, ``"+y"``, ``"-y"``, ``"+z"`` or ``"-z"``.
        floor: thickness of the wall opposite the opening; None: ``wall``.
    """
    c, s = np.asarray(center, float), np.asarray(size, float)
    axis, sign = "xyz".index(open_side[1]), 1 if open_side[0] == "+" else -1
    base = wall if floor is None else floor
    u, v = [i for i in range(3) if i != axis]
    parts = []

    def add(offset: dict[int, float], extent: dict[int, float]) -> None:
        p, e = c.copy(), s.copy()
        for i, value in offset.items():
            p[i] += value
        for i, value in extent.items():
            e[i] = value
        parts.append(box(p, e, look))

    add({axis: -sign * (s[axis] - base) / 2}, {axis: base})
    for side in (-1, 1):
        add({u: side * (s[u] - wall) / 2, axis: sign * base / 2}, {u: wall, axis: s[axis] - base})
        add({v: side * (s[v] - wall) / 2, axis: sign * base / 2}, {v: wall, u: s[u] - 2 * wall, axis: s[axis] - base})
    return parts


def tube(
    a: Vec3,
    b: Vec3,
    radius_a: float,
    radius_b: float,
    wall: float,
    look: Look,
    segments: int = 12,
    bottom: float | None = None,
) -> list[Solid]:
    """Return a tube from ``a`` to ``b`` with radii from ``radius_a`` to ``radius_b``.

    The tube has ``segments`` convex parts and a round mesh.

    ``bottom`` is the thickness of a disc that closes the tube at ``a``. If it is None, both ends are open.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    d = b - a
    rings = [
        ring(point, d, r, segments)
        for point, r in ((a, radius_a), (a, radius_a - wall), (b, radius_b), (b, radius_b - wall))
    ]
    parts = []
    for i in range(segments):
        j = (i + 1) % segments
        stave = np.array([r[k] for r in rings for k in (i, j)])
        parts.append(Solid(stave[convex_hull(stave).vertices], None))
    # Both edges of the rim are bevelled. ``lip`` is the height of the bevels, as a fraction of the tube's height.
    lip = 0.25 * wall / float(np.linalg.norm(d))
    profile = [
        (radius_a, 0.0),
        (radius_b, 1 - lip),
        (radius_b - 0.25 * wall, 1.0),
        (radius_b - 0.75 * wall, 1.0),
        (radius_b - wall, 1 - lip),
        (radius_a - wall, 0.0),
    ]
    parts.append(turned_profile(a, b, profile, look))
    if bottom is not None:
        unit = d / np.linalg.norm(d)
        inner = radius_a - 0.6 * wall
        disc = np.concatenate([ring(a, d, inner, segments), ring(a + bottom * unit, d, inner, segments)])
        parts.append(Solid(disc[convex_hull(disc).vertices], None))
        parts.append(cone(a, a + bottom * unit, inner, inner, look, 24).visual_only())
    return parts
