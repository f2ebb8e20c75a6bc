"""Decompose the two links of an object into convex hulls that do not collide with each other.

A hull covers hollows of its mesh, where it would collide with the other link although the meshes do not collide.
Therefore hulls that cover space of the other link get a penalty when hulls are chosen and merged. Then planes cut off
parts of hulls that still reach into the other link. A plane may cut if almost none of the surface of the mesh is lost
and the meshes do not overlap there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError

from gensim2.core.arrays import Array
from gensim2.objects.meshwork.convexes import (
    HINGE,
    ConvexBlock,
    depth_inside,
    in_box,
    surface_samples,
    triangle_weights,
)
from gensim2.objects.meshwork.decompose import THINNEST, Faces, connected_pieces, decompose, make_hull
from gensim2.objects.meshwork.voidspace import VoidSpace
from gensim2.objects.shapes import pose, transform

Pieces = Sequence[tuple[Array, Faces]]

# Number of joint values at which overlaps are cut. The later check uses every second one.
POSES = 9
FINE = 0.0012  # m, cell size of the grid that tests which points around a link are not occupied by the link
SPACING = 0.004  # m, distance between neighbouring sample points on a link's own surface
RESIDUE = 0.0007  # m, depth of overlap that may remain after a cut
# m. Limit for a cut: no part of the removed mesh surface may lie farther than this beyond the cutting plane.
LOSS = 0.0012
NOTICED = 0.0009  # m, minimum depth of overlap for which a cut is tried
# m. If every cut would remove surface farther beyond the plane than this, the meshes overlap, and nothing is cut.
HOPELESS = 0.004
# m. A cut may remove surface that is at least this deep inside another hull of the link.
COVERED = 0.0002
PROGRESS = 0.0003  # m, depth of overlap that a cut must remove
ROUNDS = 3
MAX_POINTS = 400  # maximum number of points on each side of a separating plane


@dataclass(frozen=True)
class Motion:
    """Motion of a joint.

    The motion has the pose (4, 4) of the moving link in the root frame at joint value zero, and the unit axis in the
    link's frame.
    """

    T_root_link: Array
    axis: Array
    revolute: bool
    lower: float
    upper: float

    def at(self, openness: float) -> Array:
        """Return the pose (4, 4) of the moving link in the root frame at an openness from 0 to 1."""
        q = self.lower + openness * (self.upper - self.lower)
        return np.asarray(self.T_root_link @ (pose(axis=self.axis, angle=q) if self.revolute else pose(q * self.axis)))

    def off_hinge(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return a mask of the points (N, 3), in the root frame, that lie outside the hinge region."""
        if not self.revolute:
            return np.ones(len(points), bool)
        axis = self.T_root_link[:3, :3] @ self.axis
        apart = np.linalg.norm(np.cross(points - self.T_root_link[:3, 3], axis), axis=1)
        return np.asarray(apart > HINGE, bool)


@dataclass(frozen=True)
class PairHulls:
    """Hulls (N, 3) of the body and the moving link, in the frames of these links.

    The class also has the number of tiny pieces of each link.
    """

    body: list[Array]
    moving: list[Array]
    dropped_body: int
    dropped_moving: int


def decompose_pair(body: Pieces, moving: Pieces, motion: Motion) -> PairHulls:
    """Return the convex hulls of both links of an object.

    Args:
        body, moving: meshes (vertices (N, 3) in metres, faces (M, 3)) in the root frame and in the moving link's frame.
        motion: motion of the joint between the links.
    """
    body, moving = connected_pieces(body), connected_pieces(moving)
    if not body or not moving:
        still, free = decompose(body), decompose(moving)
        return PairHulls(still.hulls, free.hulls, still.dropped, free.dropped)
    of_body, of_moving = VoidSpace(body), VoidSpace(moving)
    own_body, own_moving = _surface(body), _surface(moving)
    poses = [motion.at(float(share)) for share in np.linspace(0, 1, POSES)]
    inverse = [np.asarray(np.linalg.inv(T), float) for T in poses]
    matter = np.concatenate([own_moving, of_moving.occupied()])
    there = [transform(T, matter) for T in poses]
    of_body.keep_clear(_needed(of_body, np.concatenate([p[motion.off_hinge(p)] for p in there])))
    matter = np.concatenate([own_body, of_body.occupied()])
    matter = matter[motion.off_hinge(matter)]
    of_moving.keep_clear(_needed(of_moving, np.concatenate([transform(T, matter) for T in inverse])))
    still, free = decompose(body, of_body), decompose(moving, of_moving)
    parts_body, parts_moving = _Parts(still.hulls, own_body), _Parts(free.hulls, own_moving)
    for _ in range(ROUNDS):
        changed = parts_moving.cut_free(parts_body, inverse, lambda p, k: motion.off_hinge(transform(poses[k], p)))
        changed |= parts_body.cut_free(parts_moving, poses, lambda p, k: motion.off_hinge(p))
        if not changed:
            break
    return PairHulls(parts_body.hulls, parts_moving.hulls, still.dropped, free.dropped)


def _needed(space: VoidSpace, points: Array) -> Array:
    """Return points of the free space through which the other link moves. Hulls must not cover these points.

    Args:
        space: free space around the meshes of this link.
        points: (N, 3) points of the other link at several joint positions, in the frame of this link, with one point in
            a grid cell.
    """
    points = points[in_box(points, space.low, space.high)]
    points = points[_first_in_cells(points, SPACING)]
    return points[space.is_free_finely(points, FINE)]


def _first_in_cells(points: Array, cell: float) -> npt.NDArray[np.int64]:
    """Return the ascending indices of the first of the points (N, 3) in each grid cell."""
    if not len(points):
        return np.zeros(0, np.int64)
    index = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    size = index.max(axis=0) + 1
    _, first = np.unique((index[:, 0] * size[1] + index[:, 1]) * size[2] + index[:, 2], return_index=True)
    return np.sort(first)


def _surface(pieces: Pieces) -> Array:
    """Return sample points (N, 3) on all triangles. Neighbouring points are at most about ``SPACING`` apart."""
    found = []
    for vertices, faces in pieces:
        triangles = vertices[faces]
        edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
        steps = np.maximum(1, np.ceil(edges / SPACING)).astype(np.int64)
        for n in np.unique(steps):
            found.append(np.matmul(triangle_weights(int(n)), triangles[steps == n]).reshape(-1, 3))
    points = np.concatenate(found)
    return points[_first_in_cells(points, 0.5 * SPACING)]


class _Parts:
    """Hulls of one link, each with the samples of the mesh surface that the hull must cover."""

    def __init__(self, hulls: Sequence[Array], surface: Array) -> None:
        self.hulls = list(hulls)
        self.blocks = [ConvexBlock.of(hull) for hull in hulls]
        self._owned = [surface[_near(surface, block)] for block in self.blocks]
        # Whether a hull is known to be free of collisions. It stays free, because the other link's hulls only shrink.
        self._settled = [False] * len(self.hulls)

    def cut_free(
        self, others: _Parts, poses: Sequence[Array], counts: Callable[[Array, int], npt.NDArray[np.bool_]]
    ) -> bool:
        """Cut off the parts of this link's hulls that collide with the other link's hulls.

        Args:
            others: hulls of the other link, in its frame.
            poses: (4, 4) poses of the other link in this link's frame, one for each examined joint value.
            counts: function that returns a mask (N,) of the points outside the hinge region; only these points count as
                collisions. Its arguments are points (N, 3) in this link's frame and the index of a pose.

        Returns:
            Whether any hull was cut.
        """
        samples = [surface_samples(hull) for hull in others.hulls]
        placed = [[transform(T, points) for points in samples] for T in poses]
        changed = False
        for index in reversed(range(len(self.hulls))):
            if self._settled[index]:
                continue
            hull, block = self.hulls[index], self.blocks[index]
            intruders = _intruders(hull, block, placed, others.blocks, poses, counts)
            if not len(intruders):
                self._settled[index] = True
                continue
            rest = [other for k, other in enumerate(self.blocks) if k != index]
            own = self._owned[index]
            part = _clear_of(hull, own[depth_inside(own, rest) < COVERED], intruders)
            if part is hull:
                continue
            changed = True
            if part is None:
                del self.hulls[index], self.blocks[index], self._owned[index], self._settled[index]
            else:
                self.hulls[index], self.blocks[index] = part, ConvexBlock.of(part)
        return changed


def _near(points: Array, block: ConvexBlock) -> npt.NDArray[np.bool_]:
    """Return a mask of the points (N, 3) that lie in a hull or within 0.5 mm of the hull."""
    margin = 0.0005
    around = np.flatnonzero(in_box(points, block.low - margin, block.high + margin))
    found = np.zeros(len(points), bool)
    found[around] = block.depth(points[around]) > -margin
    return found


def _intruders(
    hull: Array,
    block: ConvexBlock,
    placed: Sequence[Sequence[Array]],
    shapes: Sequence[ConvexBlock],
    poses: Sequence[Array],
    counts: Callable[[Array, int], npt.NDArray[np.bool_]],
) -> Array:
    """Return the surface points (N, 3) at which one hull of this link overlaps hulls of the other link.

    Args:
        hull: (K, 3) vertices of the hull, in this link's frame.
        block: the same hull in the same frame, prepared for depth queries.
        placed: sample points on each hull of the other link, in this link's frame, for each of ``poses``.
        shapes: hulls of the other link, in its frame.
        poses: (4, 4) poses of the other link in this link's frame.
        counts: see :meth:`_Parts.cut_free`.

    Returns:
        The points at all poses, in the frame of this link; empty if no overlap is deeper than ``NOTICED``.
    """
    own = surface_samples(hull)
    found = []
    worst = 0.0
    for number, T in enumerate(poses):
        back = np.asarray(np.linalg.inv(T), float)
        corners = transform(back, hull)
        low, high = corners.min(axis=0), corners.max(axis=0)
        touching = [k for k, shape in enumerate(shapes) if (shape.low <= high).all() and (shape.high >= low).all()]
        if not touching:
            continue
        local = transform(back, own)
        for k in touching:
            points, shape = placed[number][k], shapes[k]
            theirs = points[in_box(points, block.low, block.high)]
            near = in_box(local, shape.low, shape.high)
            ours = own[near]
            depth_theirs = block.depth(theirs) if len(theirs) else np.zeros(0)
            depth_ours = shape.depth(local[near]) if len(ours) else np.zeros(0)
            points_in = np.concatenate([theirs[depth_theirs > 0], ours[depth_ours > 0]])
            depths = np.concatenate([depth_theirs[depth_theirs > 0], depth_ours[depth_ours > 0]])
            if len(points_in):
                kept = counts(points_in, number)
                worst = max(worst, float(depths[kept].max(initial=0.0)))
                found.append(points_in[kept & (depths > RESIDUE)])
    return np.concatenate(found) if worst > NOTICED and found else np.zeros((0, 3))


def _thin_out(points: Array) -> Array:
    """Return at most ``MAX_POINTS`` of the points (N, 3), at regular intervals."""
    if len(points) <= MAX_POINTS:
        return points
    step = len(points) / MAX_POINTS
    return points[(np.arange(MAX_POINTS) * step).astype(np.int64)]


def _clear_of(hull: Array, own: Array, intruders: Array) -> Array | None:
    """Cut the overlap with the other link off ``hull``.

    Return the rest of the hull. Return None if nothing is left or needed, or ``hull`` itself if no plane can cut it.

    Args:
        hull: (M, 3) vertices.
        own: (K, 3) samples of this link's mesh surface that only this hull covers.
        intruders: (N, 3) points of the overlap with the other link, which the plane should cut off.
    """
    if not len(own):
        return None  # The hull is not needed: other hulls cover its whole mesh surface.
    normal = _separating(hull, own, intruders)
    if normal is None:
        return hull
    offset = max(float((intruders @ normal).min()) + RESIDUE, float((own @ normal).max()) - LOSS)
    if offset > float((hull @ normal).max()) - PROGRESS:
        return hull
    return cut_by_plane(hull, normal, offset)


def _separating(hull: Array, own: Array, intruders: Array) -> Array | None:
    """Return the unit normal (3,) of a plane between surface samples (``own``) and the other link (``intruders``).

    The plane may cut off samples up to ``HOPELESS`` (m) beyond it. Return None if every plane would cut deeper.
    """
    axes = np.linalg.eigh(np.cov((hull - hull.mean(axis=0)).T))[1].T
    table = np.concatenate([np.eye(3), ConvexHull(hull).equations[:, :3], axes])
    ours, theirs = own @ table.T, intruders @ table.T
    # ``losses`` are the depths of the surface that is cut off, first for the normals in ``table`` and then for the
    # opposite normals.
    losses = np.concatenate([ours.max(axis=0) - theirs.min(axis=0), theirs.max(axis=0) - ours.min(axis=0)]) - RESIDUE
    table = np.concatenate([table, -table])
    best = float(losses.min())
    if best > LOSS and (normal := _widest_gap(hull.mean(axis=0), own, intruders)) is not None:
        loss = float((own @ normal).max() - (intruders @ normal).min()) - RESIDUE
        if loss < best:
            return normal if loss <= HOPELESS else None
    if best > HOPELESS:
        return None
    # Among normals that cut little of the surface, prefer the one that keeps most of the hull.
    fine = np.flatnonzero(losses <= max(0.5 * LOSS, best))
    left = (intruders @ table[fine].T).min(axis=0) - (hull @ table[fine].T).min(axis=0)
    width = np.ptp(hull @ table[fine].T, axis=0)
    return np.asarray(table[fine[int(np.argmax(left / np.maximum(width, 1e-9)))]])


def _widest_gap(center: Array, own: Array, intruders: Array) -> Array | None:
    """Return the unit normal (3,) of the widest gap between ``own`` and ``intruders``, or None if there is no gap."""
    inner, outer = _thin_out(own) - center, _thin_out(intruders) - center
    # Find the plane n·x = d with components of n from -1 to 1 and the largest m such that n·p - d >= m for all p in
    # ``outer`` and n·s - d <= -m for all s in ``inner``.
    rows = [
        np.column_stack([-outer, np.ones(len(outer)), np.ones(len(outer))]),
        np.column_stack([inner, -np.ones(len(inner)), np.ones(len(inner))]),
    ]
    answer = linprog(
        [0, 0, 0, 0, -1],
        A_ub=np.concatenate(rows),
        b_ub=np.zeros(len(inner) + len(outer)),
        bounds=[(-1, 1)] * 3 + [(None, None)] * 2,
        method="highs",
    )
    if answer.x is None or float(np.linalg.norm(answer.x[:3])) < 1e-9:
        return None
    return np.asarray(answer.x[:3] / np.linalg.norm(answer.x[:3]))


def cut_by_plane(hull: Array, normal: Array, offset: float) -> Array | None:
    """Return the vertices (M, 3) of the part of a hull with normal·p <= offset, or None if there is no such part.

    Parts thinner than ``THINNEST``, which engines refuse, are thickened downwards, away from the plane.
    """
    height = hull @ normal - offset
    if (height <= 0).all():
        return hull
    if (height > 0).all():
        return None
    try:
        simplices = ConvexHull(hull).simplices
    except QhullError:
        return None
    edges = np.unique(np.sort(simplices[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    a, b = edges[:, 0], edges[:, 1]
    crossing = (height[a] > 0) != (height[b] > 0)
    a, b = a[crossing], b[crossing]
    t = height[a] / (height[a] - height[b])
    points = np.concatenate([hull[height <= 0], hull[a] + t[:, None] * (hull[b] - hull[a])])
    thickness = float(np.ptp(points @ normal))
    if thickness < THINNEST:
        points = np.concatenate([points, points - (THINNEST - thickness) * normal])
    made = make_hull(points)
    return None if made is None else made.points
