"""Provide convex parts for coal, and compute the minimum distance of two bodies along a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import trimesh

Array = np.ndarray

#: Flat point sets are thickened to this, metres.
FLAT = 5e-4
#: Least distances along a motion are found up to this, metres.
RESOLUTION = 2e-4
#: Samples that are looked at together while nothing is near.
CHUNK = 128


def transform(pose: Array) -> coal.Transform3s:
    """Convert a pose (4, 4) to coal's transform."""
    return coal.Transform3s(np.ascontiguousarray(pose[:3, :3]), np.ascontiguousarray(pose[:3, 3]))


def hull(points: Array) -> coal.ConvexBase | None:
    """Return the convex hull of points (N, 3). Flat sets are thickened to 0.5 mm; sets without area give None."""
    if len(points) < 3:
        return None
    center = points.mean(axis=0)
    axes = np.linalg.svd(points - center, full_matrices=False)[2]
    if len(axes) < 3:
        axes = np.vstack([axes, np.cross(axes[0], axes[1])])
    spread = np.ptp((points - center) @ axes.T, axis=0)
    if spread[1] < 1e-6:
        return None
    if spread[2] < FLAT:
        shift = 0.5 * (FLAT - spread[2]) * axes[2]
        points = np.concatenate([points + shift, points - shift])
    solid = trimesh.convex.convex_hull(points)
    vertices = coal.StdVec_Vec3s()
    vertices.extend([np.asarray(vertex, dtype=float) for vertex in solid.vertices])
    triangles = coal.StdVec_Triangle()
    triangles.extend([coal.Triangle(*(int(corner) for corner in face)) for face in solid.faces])
    return coal.Convex(vertices, triangles)


@dataclass
class Part:
    """A convex shape at a pose in its body.

    ``center`` and ``radius`` bound it by a sphere, ``corners`` (8, 3) by a box, both in the body frame; ``points`` are
    points whose hull holds it.
    """

    shape: Any
    pose: Array
    center: Array
    radius: float
    points: Array
    corners: Array


def part(shape: Any, pose: Array) -> Part:
    """Wrap a coal shape."""
    signs = np.array(np.meshgrid(*([[-1.0, 1.0]] * 3))).reshape(3, -1).T
    if isinstance(shape, coal.Convex):
        points = np.array([np.asarray(shape.point(index)).reshape(3) for index in range(shape.num_points)])
    else:
        if isinstance(shape, coal.Box):
            half = np.asarray(shape.halfSide).reshape(3)
        elif isinstance(shape, coal.Sphere):
            half = np.full(3, shape.radius)
        else:
            cap = shape.radius if isinstance(shape, coal.Capsule) else 0.0
            half = np.array([shape.radius, shape.radius, shape.halfLength + cap])
        points = signs * half
    points = points @ pose[:3, :3].T + pose[:3, 3]
    low, high = points.min(axis=0), points.max(axis=0)
    center = 0.5 * (low + high)
    radius = float(np.linalg.norm(points - center, axis=1).max())
    if isinstance(shape, coal.Sphere):
        radius = float(shape.radius)
    return Part(shape, pose, center, radius, points, center + 0.5 * signs * (high - low))


REQUEST = coal.DistanceRequest()
REQUEST.enable_signed_distance = True
REQUEST.enable_nearest_points = True


def shape_distance(one: Any, at_one: Any, two: Any, at_two: Any) -> float:
    """Return the signed distance (m) of two convex shapes: the negative penetration depth if they overlap."""
    return float(coal.distance(one, at_one, two, at_two, REQUEST, coal.DistanceResult()))


@dataclass
class Moved:
    """A body along a motion, with poses (M, 4, 4), or (1, 4, 4) if it does not move."""

    name: str
    parts: list[Part]
    poses: Array


def inverted(poses: Array) -> Array:
    """Return the inverses of rigid poses (M, 4, 4)."""
    out = np.zeros_like(poses)
    out[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    out[:, :3, 3] = -(out[:, :3, :3] @ poses[:, :3, 3, None])[..., 0]
    out[:, 3, 3] = 1.0
    return out


def least_distance(one: Moved, two: Moved, samples: Array, cutoff: float) -> tuple[float, int] | None:
    """Return the minimum signed distance of two bodies over samples of a motion, if it is below ``cutoff``.

    Args:
        one, two: the bodies; the first one moves.
        samples: (K,) increasing sample numbers.
        cutoff: maximum distance that is reported, m.

    Returns:
        Distance in metres, up to ``RESOLUTION``, and the sample where it occurs.
    """
    if len(samples) == 0 or not one.parts or not two.parts:
        return None
    poses = one.poses[samples]
    others = two.poses if len(two.poses) == 1 else two.poses[samples]
    middles = np.array([each.center for each in one.parts])
    low = np.array([each.corners.min(axis=0) for each in two.parts])
    high = np.array([each.corners.max(axis=0) for each in two.parts])
    best, at = cutoff, -1
    # As wholes first: a sphere around the one and a box around the other, which most pairs keep apart.
    middle = 0.5 * (middles.min(axis=0) + middles.max(axis=0))
    reach = max(float(np.linalg.norm(each.center - middle)) + each.radius for each in one.parts)
    near = np.flatnonzero(_gap(_seen_from(others, poses, middle), low.min(axis=0), high.max(axis=0)) < best + reach)
    if len(near) == 0:
        return None
    samples, poses = samples[near], poses[near]
    others = others if len(others) == 1 else others[near]
    relative: Array | None = None
    for each in one.parts:
        local = _seen_from(others, poses, each.center)
        if not (_gap(local, low.min(axis=0), high.max(axis=0)) < best + each.radius).any():
            continue
        for index, other in enumerate(two.parts):
            near = np.flatnonzero(_gap(local, low[index], high[index]) < best + each.radius)
            if len(near):
                away = local[:, near] - other.center[:, None]
                near = near[np.sqrt(np.einsum("ik,ik->k", away, away)) - other.radius < best + each.radius]
            if len(near) == 0:
                continue
            if relative is None:
                relative = np.broadcast_to(inverted(others), (len(samples), 4, 4)) @ poses
            best, found = _least_of_parts(each, other, relative[near], best)
            if found >= 0:
                at = int(samples[near[found]])
    return None if at < 0 else (best, at)


def _seen_from(others: Array, poses: Array, point: Array) -> Array:
    """A point (3,) of a body at ``poses`` (K, 4, 4) in the frame of another one at ``others``, K or one: (3, K)."""
    apart = poses[:, :3, :3] @ point + poses[:, :3, 3] - others[:, :3, 3]
    if len(others) == 1:
        return np.ascontiguousarray(others[0, :3, :3].T @ apart.T)
    return np.einsum("kji,kj->ik", others[:, :3, :3], apart)


def _gap(points: Array, low: Array, high: Array) -> Array:
    """(K,) distances of points (3, K) from a box, zero inside."""
    gap = np.maximum(np.maximum(low[:, None] - points, points - high[:, None]), 0.0)
    return np.sqrt(np.einsum("ik,ik->k", gap, gap))


def _least_of_parts(one: Part, two: Part, relative: Array, best: float) -> tuple[float, int]:
    """As :func:`least_distance` for two parts; poses (K, 4, 4) of the first one's body in the second one's.

    No point of a part moves further than some corner of a box around it, so a distance bounds those at other samples.
    """
    placed = relative[:, None, :3, :3] @ one.corners[None, :, :, None]
    corners = placed[..., 0] + relative[:, None, :3, 3]
    shapes = relative @ one.pose
    fixed = transform(two.pose)
    at, sample, count = -1, 0, len(relative)
    while sample < count:
        distance = shape_distance(one.shape, transform(shapes[sample]), two.shape, fixed)
        if distance < best:
            best, at = distance, sample
        # Until something has moved so far that it may be nearer than the nearest so far.
        room = distance - best + RESOLUTION
        begin, sample = sample, sample + 1
        while sample < count:
            moved = corners[sample : sample + CHUNK] - corners[begin]
            far = np.flatnonzero(np.einsum("kci,kci->kc", moved, moved).max(axis=1) > room * room)
            if len(far):
                sample += int(far[0])
                break
            sample += CHUNK
    return best, at
