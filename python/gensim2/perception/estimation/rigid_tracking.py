"""Follow the rigid objects of a task over the point clouds of an episode."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gensim2.core.arrays import Array
from gensim2.perception.estimation.rigid import (
    LEAST_IN_CLUSTER,
    TABLE,
    RigidEstimate,
    RigidShape,
    assigned,
    clusters,
    fitted,
    found_inside,
)

Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

ON_OBJECT = 0.012
"""Maximum distance (m) of an object's points from its estimated surface."""
ABOUT = 0.025
"""Distance (m) from the estimated surface within which points must lie on the surface if the object has not moved."""
UNMOVED, UNMOVED_ERROR = 1.5, 0.004
"""An object counts as unmoved if the mean distance of the points about it is at most ``UNMOVED`` times the error of its
fit, or at most ``UNMOVED_ERROR`` (m).
"""
CHANGED, CHANGED_SHARE = 0.012, 0.5
"""Minimum distance (m) of a point from the previous cloud if the point shows a change, and the minimum fraction of such
points in the cluster of an object that has moved. The points of the task's rigid objects in the previous cloud do not
count.
"""
LIFTED = 0.03
"""Minimum displacement (m) of the hand since the grasp, before a cloud shows whether the hand holds the object."""
STRAY = 0.04
"""Maximum distance (m) of a point that belongs to no cluster from the cluster of an object that it may show."""
UNUSUAL = 3.0
"""Additional cost of a cluster for each of these properties: the network considers it a part of the articulated object,
it is connected to other points, or it does not reach down to the table.
"""
DROPPED_ERROR = 0.006
"""Maximum mean distance (m) of points from the surface of an object that was released into a container."""
FARTHEST_DROP = 0.08
"""Maximum horizontal distance (m) of a released object from the place of the release. A long object, which may have
tipped over, may be as far away as its diagonal is long.
"""
LONG = 1.25
"""Minimum ratio of the largest dimension of a long object to the second largest."""
FARTHEST_ROLL = 0.06
"""Maximum horizontal distance (m) of an object in a moving part from the pose to which the part has carried it."""
MOST_RISE = 0.04
"""Maximum height (m) of a released object above its height at the release. If the hand sets an object down too low, the
object slips between the fingers.
"""
EXCESS = 0.015
"""Maximum excess (m) of a cluster's dimensions over the dimensions of a released object."""
LEAST_SHOWN = 0.4
"""Minimum of the two largest dimensions of a cluster, as a fraction of the dimensions of a released object."""
MAX_ITERATIONS = 20
"""Maximum number of iterations of the fit of a released object."""
UNDERSIDE = 0.2
"""Quantile of the heights of an object's surface up to which the surface counts as its underside."""
EQUAL = 1.2
"""Maximum ratio of the errors of two fits that fit equally well."""
TILTED = 0.8
"""Maximum ratio of the errors of two fits, with and without a rotation, if the object has tilted or tumbled."""


class RigidTracker:
    """Estimates the rigid objects of a task from the point clouds of an episode.

    Call :meth:`take_in` with each point cloud, and :meth:`hold` while the hand holds an object. A hidden object stays
    at its last pose.

    Args:
        shapes: shapes of the objects' classes, by name of the object.

    Attributes:
        found: latest estimates by name of the object.
        start: positions (3,) of the object frames in the first cloud, by name, in the world frame, m.
        held: name of the grasped object, or None.
    """

    def __init__(self, shapes: Mapping[str, RigidShape]) -> None:
        self.shapes = dict(shapes)
        self.reset()

    def reset(self) -> None:
        """Start an episode."""
        self.found: dict[str, RigidEstimate] = {}
        self.start: dict[str, Array] = {}
        self.held: str | None = None
        # Whether a cloud has shown the grasped object outside the hand.
        self._is_left = False
        # Estimate of the grasped object before the grasp.
        self._before_grasp: RigidEstimate | None = None
        # Height (m) of the object frame at the release, of each released object that no cloud has shown since.
        self._released: dict[str, float] = {}
        self._hidden: set[str] = set()
        # Objects that lie in another body since the start. The points of this body are near them.
        self._inside: set[str] = set()
        self._past: Array | None = None

    @property
    def missing(self) -> list[str]:
        """Names of the objects that no cloud has shown."""
        return [name for name in self.shapes if name not in self.found]

    def hold(self, name: str | None, T_world_object: Array | None = None) -> None:
        """Set the grasped object and its pose (4, 4) in the world. Call this method at every control step while the
        hand holds the object, and once with None after the release. If a cloud has shown the object outside the hand,
        the pose is ignored, and the estimate stays where the cloud shows the object.
        """
        if name != self.held:
            if self.held is not None and not self._is_left:
                self._released[self.held] = float(self.found[self.held].T_world_object[2, 3])
            self.held, self._is_left = name, False
            self._before_grasp = None if name is None else self.found[name]
            self._inside -= {name}
        if name is not None and T_world_object is not None and not self._is_left:
            self.found[name] = self.found[name].at(T_world_object)

    def is_hidden(self, name: str) -> bool:
        """Return whether the latest cloud does not show an object, although the hand does not hold the object."""
        return name in self._hidden

    def rest_on(self, name: str, height: float) -> None:
        """Raise a hidden released object to a surface at ``height`` (m), but not above the place of the release."""
        if name in self._released and name in self._hidden:
            found = self.found[name]
            most = self._released[name] - float(found.T_world_object[2, 3])
            by = min(height - float(found.bounds[0, 2]), most)
            self.found[name] = found.moved(np.array([0.0, 0.0, max(0.0, by)]))

    def take_in(
        self,
        points: Array,
        on_articulated: Mask,
        carried: Collection[str] = (),
        floors: Mapping[str, float] | None = None,
        *,
        shut: Collection[str] = (),
        containers: Mapping[str, Mask] | None = None,
    ) -> npt.NDArray[np.int64]:
        """Estimate the objects in a cloud.

        Args:
            points: (N, 3) points in the world frame, m, without points of the robot.
            on_articulated: (N,) whether the network considers each point a part of the articulated object.
            carried: names of objects in a moving part. These objects are sought only near their poses, because the part
                hides them, and parts of the articulated object, such as a knob, may have their dimensions.
            floors: heights (m) of the floors below released objects, by name. The objects cannot have fallen lower.
            shut: names of ``carried`` objects that are not sought, because the moving part hides its contents.
            containers: which points (N,) show the body in which an object lies at the start, by name of the object. The
                object is sought among these points if no cluster shows it.

        Returns:
            Index (N,) of the object that each point shows, in the order of ``shapes``; -1: none of the objects.
        """
        own = np.full(len(points), -1, dtype=np.int64)
        if not len(points):
            return own
        changed = (
            np.ones(len(points), dtype=bool)
            if self._past is None or not len(self._past)
            else cKDTree(self._past).query(points)[0] > CHANGED
        )
        self._leave_behind(points)
        for name in self.found:
            if name == self.held or (name not in self._released and self._stays(name, points[own < 0])):
                self._claim(name, points, own)
        sought = [name for name in self.shapes if name != self.held and not (own == self._index(name)).any()]
        inside = [name for name in sought if name in carried]
        shown = [name for name in inside if name not in shut]
        released = [name for name in sought if name in self._released and name not in carried]
        unknown = [name for name in sought if name not in inside and name not in released]
        self._place(unknown, points, on_articulated, changed, own)
        for name, mask in (containers or {}).items():
            if name not in self.found:
                self._place_inside(name, points, mask & (own < 0), own)
        held = [] if self.held is None or self._is_left else [self.held]
        self._place([*released, *held], points, on_articulated, changed, own, standing=True)
        for names, farthest in ((released, FARTHEST_DROP), (shown, FARTHEST_ROLL)):
            for name in [each for each in names if (own != self._index(each)).all()]:
                floor = (floors or {}).get(name, 0.0)
                if self._settle(name, points, changed & (own < 0), farthest, floor):
                    self._claim(name, points, own)
                elif name not in carried:
                    # New points of no object may show this object, so it cannot lie on them.
                    self._drop(name, points[~changed | (own >= 0)])
        self._hidden = {name for name in self.found if name != self.held and not (own == self._index(name)).any()}
        rest = own < 0
        if self.held is not None or self._hidden:
            # A new cluster may be the hidden object. The cluster becomes background only after the object has been
            # found.
            rest &= ~_in_new_clusters(points, changed)
        self._past = points[rest]
        for name, each in self.found.items():
            self.start.setdefault(name, each.T_world_object[:3, 3].copy())
        return own

    def _index(self, name: str) -> int:
        return list(self.shapes).index(name)

    def _claim(self, name: str, points: Array, own: npt.NDArray[np.int64]) -> None:
        """Mark the points that lie on an object and on no other object."""
        near = cKDTree(self.found[name].samples).query(points)[0] < ON_OBJECT
        own[near & (own < 0)] = self._index(name)

    def _stays(self, name: str, points: Array) -> bool:
        """Return whether points show an object at its last pose. Points near other objects are left out first, because
        one object may lie on another. If the rest does not show the object, all points are used.
        """
        apart = np.ones(len(points), dtype=bool)
        for other in self.found.keys() - {name}:
            apart &= cKDTree(self.found[other].samples).query(points)[0] > ABOUT
        found = self.found[name]
        if name in self._inside:
            return _is_unmoved(found, points, ON_OBJECT)
        return _is_unmoved(found, points[apart]) or _is_unmoved(found, points)

    def _leave_behind(self, points: Array) -> None:
        """If the cloud shows the grasped object where it was before the grasp, the hand has left it behind."""
        before = self._before_grasp
        if self.held is None or before is None or self._is_left:
            return
        away = self.found[self.held].T_world_object[:3, 3] - before.T_world_object[:3, 3]
        if np.linalg.norm(away) > LIFTED and _is_unmoved(before, points):
            self.found[self.held], self._is_left = before, True

    def _place(
        self,
        names: list[str],
        points: Array,
        on_articulated: Mask,
        changed: Mask,
        own: npt.NDArray[np.int64],
        *,
        standing: bool = False,
    ) -> None:
        """Assign the clusters of the cloud to objects, and fit the objects to their clusters.

        With ``standing``, only clusters count that stand on the table and touch nothing else: any other released object
        has moved little, and :meth:`_settle` looks for it near the place of the release. If a grasped object fits such
        a cluster well, the hand has left it behind.
        """
        if not names:
            return
        free = np.flatnonzero(own < 0)
        found = [free[rows] for rows in clusters(points[free])]
        grown = _with_strays(points, free, found)
        # Index of the cluster to which a part belongs, by index of the part.
        wholes: dict[int, int] = {}
        # An object that touches the articulated object belongs to its cluster, but the network may tell them apart.
        for whole, rows in enumerate(list(found)):
            free = rows[~on_articulated[rows]]
            if 0 < len(free) < len(rows):
                for part in clusters(points[free]):
                    wholes[len(found)] = whole
                    found.append(free[part])
        first_grown = len(found)
        found += grown
        penalties = [
            UNUSUAL * (number in wholes)
            + UNUSUAL * float(on_articulated[rows].mean() > 0.5)
            + UNUSUAL * float(points[rows, 2].min() > TABLE)
            for number, rows in enumerate(found)
        ]
        apart = [number not in wholes and points[rows, 2].min() <= TABLE for number, rows in enumerate(found)]
        kept = [
            number
            for number, rows in enumerate(found)
            if (apart[number] or not standing) and (self._past is None or changed[rows].mean() >= CHANGED_SHARE)
        ]
        found, penalties = [found[number] for number in kept], [penalties[number] for number in kept]
        overlapping = [
            (other, place)
            for place, number in enumerate(kept)
            if number in wholes or number >= first_grown
            for other in range(place)
            if np.isin(found[place], found[other], assume_unique=True).any()
        ]
        shapes = {name: self.shapes[name] for name in names}
        matches = assigned(shapes, [points[rows] for rows in found], penalties, overlapping)
        for name, (column, number) in matches.items():
            cluster = points[found[column]]
            fit = fitted(self.shapes[name], cluster, number)
            if name in self.found:
                # A symmetric object fits in several orientations. Its known orientation is preferred.
                moved = _fallen if name in self._released else _displaced
                known = moved(self.found[name], cluster)
                fit = known if known.error <= max(UNMOVED * fit.error, DROPPED_ERROR) else fit
            if name == self.held:
                if fit.error > DROPPED_ERROR:
                    continue
                # The object cannot be in two places.
                self._is_left = True
            self.found[name] = fit
            self._released.pop(name, None)
            own[found[column]] = self._index(name)
            self._claim(name, points, own)

    def _place_inside(self, name: str, points: Array, within: Mask, own: npt.NDArray[np.int64]) -> None:
        """Find an object among the points of the body that contains it, which are marked in ``within`` (N,)."""
        rows = np.flatnonzero(within)
        found = found_inside(self.shapes[name], points[rows])
        if found is not None:
            self.found[name], shown = found
            own[rows[shown]] = self._index(name)
            self._inside.add(name)

    def _settle(self, name: str, points: Array, changed: Mask, farthest: float, floor: float) -> bool:
        """Estimate where a released object, or an object in a moving part, has come to rest. Return whether the cloud
        shows the object.

        The points that the previous cloud does not contain show the object, if their dimensions and their shape fit, if
        they are within the horizontal distance ``farthest`` (m) of the object's last pose, and if they are not below
        the height ``floor`` (m).
        """
        before = self.found[name]
        height = self._released.get(name, float(before.T_world_object[2, 3]))
        fits = []
        new = points[changed]
        second, longest = np.sort(before.size)[1:]
        if name in self._released and longest > LONG * second:
            farthest = max(farthest, float(np.linalg.norm(before.size)))
        for rows in clusters(new):
            part = new[rows]
            if not _may_show(before, part):
                continue
            fit = _fallen(before, part) if name in self._released else _displaced(before, part)
            drop = fit.T_world_object[:2, 3] - before.T_world_object[:2, 3]
            away = float(np.linalg.norm(drop))
            rise = float(fit.T_world_object[2, 3]) - height
            is_above = float(fit.bounds[0, 2]) >= floor - MOST_RISE
            if fit.error <= DROPPED_ERROR and away <= farthest and rise <= MOST_RISE and is_above:
                fits.append((away, fit))
        if fits:
            self.found[name] = min(fits, key=lambda each: each[0])[1]
            self._released.pop(name, None)
        return bool(fits)

    def _drop(self, name: str, points: Array) -> None:
        """Move a released object that the cloud does not show to the highest points below it, or to the table."""
        before = self.found[name]
        low, high = before.bounds
        middle, radius = 0.5 * (low + high)[:2], 0.25 * float(np.linalg.norm((high - low)[:2]))
        below = points[np.linalg.norm(points[:, :2] - middle, axis=1) <= radius, 2]
        below = below[below <= low[2]]
        support = float(below.max()) if len(below) else 0.0
        self.found[name] = before.moved(np.array([0.0, 0.0, min(0.0, support - float(low[2]))]))


def _with_strays(points: Array, free: Indices, found: Sequence[Indices]) -> list[Indices]:
    """Return the clusters that have strays nearby, together with these strays: points that belong to no cluster. The
    points of a slanting face that is far from the camera are farther apart than the points of a cluster.

    Args:
        points: (N, 3) points in the world frame, m.
        free: rows of the points that may belong to an object.
        found: rows of each cluster.
    """
    strays = np.setdiff1d(free, np.concatenate([free[:0], *found]), assume_unique=True)
    if not len(strays):
        return []
    tree, grown = cKDTree(points[strays]), []
    for rows in found:
        near = tree.query_ball_point(points[rows], STRAY)
        more = np.unique(np.concatenate([np.asarray(each, dtype=np.int64) for each in near]))
        if len(more):
            grown.append(np.concatenate([rows, strays[more]]))
    return grown


def _is_unmoved(found: RigidEstimate, points: Array, within: float = ABOUT) -> bool:
    """Return whether points (N, 3) in the world frame lie on an object at its last pose. Only points at distances of
    less than ``within`` (m) count.
    """
    distances = cKDTree(found.samples).query(points)[0]
    about = distances[distances < within]
    limit = max(UNMOVED * found.error, UNMOVED_ERROR)
    return len(about) >= LEAST_IN_CLUSTER and float(about.mean()) <= limit


def _in_new_clusters(points: Array, changed: Mask) -> Mask:
    """Return which points (N, 3) belong to a cluster that consists mainly of ``changed`` points (N,)."""
    found = np.zeros(len(points), dtype=bool)
    for rows in clusters(points):
        found[rows] = changed[rows].mean() >= CHANGED_SHARE
    return found


def _may_show(found: RigidEstimate, points: Array) -> bool:
    """Return whether the dimensions of points (N, 3) fit an object: in its last orientation, or in any orientation."""
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    for seen, size in (
        (np.ptp(points, axis=0), np.ptp(found.bounds, axis=0)),
        (np.ptp(points @ axes.T, axis=0), found.size),
    ):
        seen, size = np.sort(seen), np.sort(size)
        if (seen <= size + EXCESS).all() and (seen[1:] >= LEAST_SHOWN * size[1:]).all():
            return True
    return False


def _fallen(found: RigidEstimate, points: Array) -> RigidEstimate:
    """Return the estimate of a released object after the motion that fits it best to points (N, 3) in the world frame,
    m: a displacement, or a large rotation if this fits much better.
    """
    moved = _displaced(found, points)
    if moved.error <= UNMOVED_ERROR:
        return moved
    tumbled = _tumbled(found, points)
    return tumbled if tumbled.error < TILTED * moved.error else moved


def _tumbled(found: RigidEstimate, points: Array) -> RigidEstimate:
    """Return an estimate in the orientation that fits it best to points (N, 3) in the world frame, m. The principal
    axes of the surface are turned to the principal axes of the points, in each of the four possible ways.

    The points of a symmetric object, such as a box, fit several orientations equally well. The object tips over an edge
    of its underside, so among these orientations, the result is the one whose underside has moved least.
    """
    samples = found.samples
    of_points = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    of_samples = np.linalg.svd(samples - samples.mean(axis=0), full_matrices=False)[2]
    fits = []
    for signs in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        turn = of_points.T @ np.diag([*signs, 1.0]) @ of_samples
        turn = turn if np.linalg.det(turn) > 0.0 else of_points.T @ np.diag([*signs, -1.0]) @ of_samples
        T = np.eye(4)
        T[:3, :3] = turn
        T[:3, 3] = points.mean(axis=0) - turn @ samples.mean(axis=0)
        fits.append(_registered(found.at(T @ found.T_world_object), points, turns=True))
    least = min(each.error for each in fits)
    underside = samples[:, 2] <= np.quantile(samples[:, 2], UNDERSIDE)

    def slid(each: RigidEstimate) -> float:
        return float(np.linalg.norm((each.samples - samples)[underside, :2], axis=1).mean())

    return min((each for each in fits if each.error <= EQUAL * least), key=slid)


def _displaced(found: RigidEstimate, points: Array) -> RigidEstimate:
    """Return an estimate after the displacement that fits it best to points (N, 3) in the world frame, m. If no
    displacement without a rotation fits well, the object has tilted, and the result is rotated as well.
    """
    low, high = found.bounds
    by = 0.5 * (points.min(axis=0) + points.max(axis=0)) - 0.5 * (low + high)
    by[2] = points[:, 2].max() - high[2]
    moved = _registered(found.moved(by), points, turns=False)
    if moved.error <= UNMOVED_ERROR:
        return moved
    turned = _registered(moved, points, turns=True)
    return turned if turned.error < TILTED * moved.error else moved


def _registered(found: RigidEstimate, points: Array, *, turns: bool) -> RigidEstimate:
    """Return an estimate that is registered to points (N, 3) in the world frame, m, by iterated closest points.

    Args:
        found: estimate that is near the points.
        points: points of the object in the world frame, m.
        turns: whether the registration rotates the object, or only shifts it.
    """
    tree, samples = cKDTree(found.samples), found.samples
    T = np.eye(4)
    for _ in range(MAX_ITERATIONS):
        local = (points - T[:3, 3]) @ T[:3, :3]
        nearest = samples[tree.query(local)[1]]
        step = np.eye(4)
        if turns:
            step[:3, :3] = _rotation(nearest - nearest.mean(axis=0), local - local.mean(axis=0))
        step[:3, 3] = local.mean(axis=0) - step[:3, :3] @ nearest.mean(axis=0)
        T = T @ step
        if np.linalg.norm(step - np.eye(4)) < 1e-4:
            break
    local = (points - T[:3, 3]) @ T[:3, :3]
    return replace(found.at(T @ found.T_world_object), error=float(tree.query(local)[0].mean()))


def _rotation(before: Array, after: Array) -> Array:
    """Return the rotation (3, 3) that brings vectors (N, 3) nearest to other vectors (N, 3), in the sense of least
    squares.
    """
    left, _, right = np.linalg.svd(after.T @ before)
    handed = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    return np.asarray(left * handed @ right)
