"""Collision shapes of ``shape_msgs`` as shapes of the solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import gensim2_kpam as kpam

from .poses import Array, matrix, rigid
from .refusals import ErrorCode, RefusedError

BOX, SPHERE, CYLINDER, CONE, PRISM = 1, 2, 3, 4, 5
#: A plane becomes a box with this length of its sides, and this thickness, m.
PLANE_SIDE, PLANE_THICKNESS = 20.0, 0.002
#: Number of sides of the pyramid around a cone.
SIDES = 32


@dataclass(frozen=True)
class Part:
    """A shape and its pose (4, 4) in the frame of its object."""

    build: Callable[[Array], kpam.Shape]
    pose: Array


def parts_of(message: Any, field: str) -> list[Part]:
    """Return the shapes of a CollisionObject. Shapes without a pose are at the origin of the object."""
    out = []
    for kind, make in (("primitive", _primitive), ("mesh", _mesh), ("plane", _plane)):
        names = {"primitive": "primitives", "mesh": "meshes", "plane": "planes"}
        shapes, poses = getattr(message, names[kind]), getattr(message, f"{kind}_poses")
        if poses and len(poses) != len(shapes):
            raise _refused(f"{field}.{kind}_poses", f"has {len(poses)} poses for {len(shapes)} shapes")
        for k, shape in enumerate(shapes):
            pose = matrix(poses[k], f"{field}.{kind}_poses[{k}]") if poses else np.eye(4)
            out.append(Part(make(shape, f"{field}.{names[kind]}[{k}]"), pose))
    return out


def _refused(field: str, message: str) -> RefusedError:
    return RefusedError(ErrorCode.INVALID_OBJECT_NAME, field, message)


def _primitive(message: Any, field: str) -> Callable[[Array], kpam.Shape]:
    kind, size = int(message.type), [float(each) for each in message.dimensions]
    count = {BOX: 3, SPHERE: 1, CYLINDER: 2, CONE: 2, PRISM: 1}.get(kind)
    if count is None:
        raise _refused(f"{field}.type", f"{kind} is no primitive; use 1 (box) to 5 (prism)")
    if len(size) < count or not all(np.isfinite(each) and each > 0.0 for each in size[:count]):
        raise _refused(f"{field}.dimensions", f"{size} must hold {count} lengths above 0 m")
    if kind == BOX:
        half = np.array(size[:3]) / 2.0
        return lambda pose: kpam.Shape.box(half, pose)
    if kind == SPHERE:
        return lambda pose: kpam.Shape.sphere(size[0], pose[:3, 3])
    if kind == CYLINDER:
        return lambda pose: kpam.Shape.cylinder(size[1], size[0], pose)
    if kind == CONE:
        # A pyramid around the cone, whose axis is z and whose origin is halfway up.
        turn = 2.0 * np.pi * np.arange(SIDES) / SIDES
        wide = size[1] / np.cos(np.pi / SIDES)
        base = np.column_stack([wide * np.cos(turn), wide * np.sin(turn), np.full(SIDES, -0.5 * size[0])])
        return _hull(np.vstack([base, [[0.0, 0.0, 0.5 * size[0]]]]))
    corners = np.array([[point.x, point.y] for point in message.polygon.points], dtype=np.float64)
    if len(corners) < 3 or not np.isfinite(corners).all() or not _convex(corners):
        raise _refused(f"{field}.polygon", "must have at least three finite points that form a convex polygon")
    ends = [np.column_stack([corners, np.full(len(corners), z)]) for z in (-0.5 * size[0], 0.5 * size[0])]
    return _hull(np.vstack(ends))


def _convex(corners: Array) -> bool:
    """Return whether the corners (N, 2) of a polygon turn in one direction only, by one full turn in all."""
    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    cross = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    turns = np.arctan2(cross, (edges * following).sum(axis=1))
    return bool(((cross >= 0.0).all() or (cross <= 0.0).all()) and abs(abs(turns.sum()) - 2.0 * np.pi) < 1e-6)


def _hull(points: Array) -> Callable[[Array], kpam.Shape]:
    return lambda pose: kpam.Shape.convex_hull(points @ pose[:3, :3].T + pose[:3, 3])


def _mesh(message: Any, field: str) -> Callable[[Array], kpam.Shape]:
    points = np.array([[p.x, p.y, p.z] for p in message.vertices], dtype=np.float64).reshape(-1, 3)
    triangles = np.array([list(t.vertex_indices) for t in message.triangles], dtype=np.int64).reshape(-1, 3)
    if not len(triangles) or not np.isfinite(points).all() or triangles.max() >= len(points):
        raise _refused(field, f"must have triangles over its {len(points)} finite vertices")
    return lambda pose: kpam.Shape.mesh(points @ pose[:3, :3].T + pose[:3, 3], triangles)


def _plane(message: Any, field: str) -> Callable[[Array], kpam.Shape]:
    coefficients = np.array([float(each) for each in message.coef])
    length = float(np.linalg.norm(coefficients[:3]))
    if len(coefficients) != 4 or not np.isfinite(coefficients).all() or length < 1e-9:
        raise _refused(f"{field}.coef", f"{coefficients.tolist()} is no plane ax + by + cz + d = 0")
    normal = coefficients[:3] / length
    across = np.eye(3)[int(np.argmin(np.abs(normal)))]
    x = np.cross(across, normal)
    x /= np.linalg.norm(x)
    local = rigid(np.column_stack([x, np.cross(normal, x), normal]), -coefficients[3] / length * normal)
    half = [0.5 * PLANE_SIDE, 0.5 * PLANE_SIDE, 0.5 * PLANE_THICKNESS]
    return lambda pose: kpam.Shape.box(half, pose @ local)
