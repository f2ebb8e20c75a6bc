"""Follow the rigid objects of a task over the point clouds of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gensim2.perception.estimation.rigid import (
    LEAST_IN_CLUSTER,
    TABLE,
    RigidEstimate,
    RigidShape,
    assigned,
    clusters,
    fitted,
)

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

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
UNUSUAL = 3.0
"""Additional cost of a cluster for each of these properties: the network considers it a part of the articulated object,
it is connected to other points, or it does not reach down to the table.
"""
DROPPED_ERROR = 0.006
"""Maximum mean distance (m) of points from the surface of an object that was released into a container."""
FARTHEST_DROP = 0.12
"""Maximum horizontal distance (m) of a released object from the place of the release."""
EXCESS = 0.015
"""Maximum excess (m) of a cluster's dimensions over the dimensions of a released object."""
MAX_ITERATIONS = 20
"""Maximum number of iterations of the fit of a released object."""


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
        # Height (m) of the object frame at the release, of each released object that no cloud has shown since.
        self._released: dict[str, float] = {}
        self._hidden: set[str] = set()
        self._past: Array | None = None

    @property
    def missing(self) -> list[str]:
        """Names of the objects that no cloud has shown."""
        return [name for name in self.shapes if name not in self.found]

    def hold(self, name: str | None, T_world_object: Array | None = None) -> None:
        """Set the grasped object and its pose (4, 4) in the world. Call this method at every control step while the
        hand holds the object, and once with None after the release.
        """
        if self.held is not None and name != self.held:
            self._released[self.held] = float(self.found[self.held].T_world_object[2, 3])
        self.held = name
        if name is not None and T_world_object is not None:
            self.found[name] = self.found[name].at(T_world_object)

    def is_hidden(self, name: str) -> bool:
        """Return whether the latest cloud does not show an object, although the hand does not hold the object."""
        return name in self._hidden

    def take_in(self, points: Array, on_articulated: Mask) -> npt.NDArray[np.int64]:
        """Estimate the objects in a cloud.

        Args:
            points: (N, 3) points in the world frame, m, without points of the robot.
            on_articulated: (N,) whether the network considers each point a part of the articulated object.

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
        for name in self.found:
            if name == self.held or (name not in self._released and self._is_unmoved(name, points[own < 0])):
                self._claim(name, points, own)
        sought = [name for name in self.shapes if name != self.held and not (own == self._index(name)).any()]
        self._place([name for name in sought if name not in self._released], points, on_articulated, changed, own)
        self._place([name for name in sought if name in self._released], points, on_articulated, changed, own, 0.0)
        for name in [each for each in sought if each in self._released]:
            if self._settle(name, points, changed & (own < 0)):
                self._claim(name, points, own)
        self._hidden = {name for name in self.found if name != self.held and not (own == self._index(name)).any()}
        self._past = points[own < 0]
        for name, each in self.found.items():
            self.start.setdefault(name, each.T_world_object[:3, 3].copy())
        return own

    def _index(self, name: str) -> int:
        return list(self.shapes).index(name)

    def _claim(self, name: str, points: Array, own: npt.NDArray[np.int64]) -> None:
        """Mark the points that lie on an object and on no other object."""
        near = cKDTree(self.found[name].samples).query(points)[0] < ON_OBJECT
        own[near & (own < 0)] = self._index(name)

    def _is_unmoved(self, name: str, points: Array) -> bool:
        """Return whether points lie on an object at its last pose."""
        found = self.found[name]
        distances = cKDTree(found.samples).query(points)[0]
        about = distances[distances < ABOUT]
        limit = max(UNMOVED * found.error, UNMOVED_ERROR)
        return len(about) >= LEAST_IN_CLUSTER and float(about.mean()) <= limit

    def _place(
        self,
        names: list[str],
        points: Array,
        on_articulated: Mask,
        changed: Mask,
        own: npt.NDArray[np.int64],
        most: float = np.inf,
    ) -> None:
        """Assign the clusters of the cloud to objects, and fit the objects to their clusters. Clusters whose additional
        cost exceeds ``most`` are left out: a released object that does not stand on the table has moved little, and
        :meth:`_settle` looks for it near the place of the release.
        """
        if not names:
            return
        free = np.flatnonzero(own < 0)
        found = [free[rows] for rows in clusters(points[free])]
        # Index of the cluster to which a part belongs, by index of the part.
        wholes: dict[int, int] = {}
        # An object that touches the articulated object belongs to its cluster, but the network may tell them apart.
        for whole, rows in enumerate(list(found)):
            apart = rows[~on_articulated[rows]]
            if 0 < len(apart) < len(rows):
                for part in clusters(points[apart]):
                    wholes[len(found)] = whole
                    found.append(apart[part])
        penalties = [
            UNUSUAL * (number in wholes)
            + UNUSUAL * float(on_articulated[rows].mean() > 0.5)
            + UNUSUAL * float(points[rows, 2].min() > TABLE)
            for number, rows in enumerate(found)
        ]
        kept = [
            number
            for number, rows in enumerate(found)
            if penalties[number] <= most and (self._past is None or changed[rows].mean() >= CHANGED_SHARE)
        ]
        found, penalties = [found[number] for number in kept], [penalties[number] for number in kept]
        overlapping = [
            (kept.index(wholes[number]), place) for place, number in enumerate(kept) if wholes.get(number) in kept
        ]
        shapes = {name: self.shapes[name] for name in names}
        matches = assigned(shapes, [points[rows] for rows in found], penalties, overlapping)
        for name, (column, number) in matches.items():
            self.found[name] = fitted(self.shapes[name], points[found[column]], number)
            self._released.pop(name, None)
            own[found[column]] = self._index(name)
            self._claim(name, points, own)

    def _settle(self, name: str, points: Array, changed: Mask) -> bool:
        """Estimate where a released object has come to rest, and return whether the cloud shows the object.

        The points that the previous cloud does not contain show the object, if their dimensions and their shape fit.
        Without such points the object counts as lying below the place of the release.
        """
        before = self.found[name]
        fits = []
        new = points[changed]
        limit = np.sort(np.ptp(before.bounds, axis=0)) + EXCESS
        for rows in clusters(new):
            part = new[rows]
            if (np.sort(np.ptp(part, axis=0)) > limit).any():
                continue
            fit = _displaced(before, part)
            drop = fit.T_world_object[:2, 3] - before.T_world_object[:2, 3]
            away = float(np.linalg.norm(drop))
            rise = float(fit.T_world_object[2, 3]) - self._released[name]
            if fit.error <= DROPPED_ERROR and away <= FARTHEST_DROP and rise <= EXCESS:
                fits.append((away, fit))
        if fits:
            self.found[name] = min(fits, key=lambda each: each[0])[1]
            del self._released[name]
            return True
        low, high = before.bounds
        middle, radius = 0.5 * (low + high)[:2], 0.25 * float(np.linalg.norm((high - low)[:2]))
        below = points[np.linalg.norm(points[:, :2] - middle, axis=1) <= radius, 2]
        below = below[below <= low[2]]
        support = float(below.max()) if len(below) else 0.0
        self.found[name] = before.moved(np.array([0.0, 0.0, min(0.0, support - float(low[2]))]))
        return False


def _displaced(found: RigidEstimate, points: Array) -> RigidEstimate:
    """Return an estimate after the displacement that fits it best to points (N, 3) in the world frame, m."""

    low, high = found.bounds
    by = 0.5 * (points.min(axis=0) + points.max(axis=0)) - 0.5 * (low + high)
    by[2] = points[:, 2].max() - high[2]
    samples = found.samples
    tree = cKDTree(samples)
    for _ in range(MAX_ITERATIONS):
        _, rows = tree.query(points - by)
        step = (points - by - samples[rows]).mean(axis=0)
        by = by + step
        if np.linalg.norm(step) < 1e-4:
            break
    return replace(found.moved(by), error=float(tree.query(points - by)[0].mean()))
