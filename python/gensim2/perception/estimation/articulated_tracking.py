"""Follow an articulated object of a task over the point clouds of an episode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gensim2.core.arrays import Array
from gensim2.objects.known import JOINT_TYPES
from gensim2.objects.types import joint_motion
from gensim2.perception.cloud import farthest_points, inlier_mask, uniform_stride
from gensim2.perception.estimation.classes import by_name
from gensim2.perception.estimation.estimator import (
    LEAST_POINTS,
    LEVEL,
    Points,
    SceneEstimate,
    SceneEstimator,
)
from gensim2.perception.estimation.examples import SETTINGS
from gensim2.perception.estimation.network import OTHER, STRAY, TARGET
from gensim2.perception.estimation.presence import why_absent
from gensim2.perception.estimation.rigid import RigidEstimate
from gensim2.perception.estimation.rigid_tracking import RigidTracker
from gensim2.perception.estimation.scene import at_push_height, scene_object
from gensim2.perception.estimation.tracking import MOVED, STALLED, UNKNOWN, Track
from gensim2.planning.scene import SceneObject
from gensim2.tasks.criteria import JOINT, ArticulatedClosed, ArticulatedOpen, Criterion

LOWEST = 0.05
"""Quantile of the heights of a moving part's points that counts as the height of its floor."""
SHUT = 0.2
"""Estimated openness of a part below which the cameras cannot see its contents."""
LEAST_SEEN = 0.25
"""Minimum number of object points, as a fraction of the number in the first cloud. With fewer points the object counts
as hidden, and the estimate is discarded."""


class ArticulatedTracker:
    """Estimates one articulated object of a task from the point clouds of an episode.

    Call :meth:`take_in` with the part of each point cloud that may show the object, and :meth:`begin_motion` before
    each motion of the robot.

    Args:
        name: name of the object in the task.
        asset_class: class of the object. If the estimator does not know the class, but has stand-ins, the most probable
            stand-in in the first cloud is used, with the type of joint that the package lists for the class.
        estimator: estimator of scenes.

    Raises:
        InputError: the estimator does not know the class and has no stand-ins.

    Attributes:
        name, asset_class: name and class of the object.
        track: latest estimate; None before the first cloud, and if the first cloud does not show the object.
        goal: 1 if the current step should open the joint, -1 if the step should close it, otherwise 0.
        moves_joint: whether the current step should move the joint.
        carried: hidden rigid objects in the moving part, by name, with their estimates before the latest motion.
    """

    def __init__(self, name: str, asset_class: str, estimator: SceneEstimator) -> None:
        self.name, self.asset_class = name, asset_class
        is_known = not estimator.stand_ins or asset_class in {each.name for each in estimator.classes}
        self._known = estimator.classes[by_name(estimator.classes, asset_class)] if is_known else None
        self._estimator = estimator
        self.reset(())

    def reset(self, success: Sequence[Criterion]) -> None:
        """Start an episode with the success criteria of its task."""
        self.track: Track | None = None
        # Class with which the object is estimated; None before the first cloud if the class is unknown.
        self._kind = self._known
        self.carried: dict[str, RigidEstimate] = {}
        self._before: Track | None = None
        self._seen_at_first = 0
        # Heights (m) of the lowest points of the part into which objects are put, one for each cloud.
        self._floors: list[float] = []
        self.begin_step(success)

    def begin_step(self, criteria: Sequence[Criterion]) -> None:
        """Start a step with its criteria.

        From now on, the displacement of the joint counts the motions of this step.
        """
        kinds = {type(each) for each in criteria if self.name in each.objects}
        self.goal = (ArticulatedOpen in kinds) - (ArticulatedClosed in kinds)
        self.moves_joint = any(issubclass(kind, JOINT) for kind in kinds)
        if self._before is not None:
            self._before = replace(self._before, moved=0.0, misses=0)
        if self.track is not None:
            self.track = replace(self.track if self._before else self._begun(self.track), moved=0.0, misses=0)

    def begin_motion(self, rigid: RigidTracker) -> None:
        """Keep the latest estimate: after the motion, the displacement of the joint is measured against its cloud."""
        self._before = self.track
        # A closed drawer hides the objects in it, and its visible points do not show where it ends.
        self.carried = {
            name: each
            for name, each in rigid.found.items()
            if name != rigid.held and (name in self.carried or self._is_in_moving_part(each))
        }

    def estimate(self, cloud: Points) -> SceneEstimate:
        """Return an estimate of the object in a cloud (N, 3), without changing the tracker. A dense cloud is thinned
        first, because the network was trained on clouds of a fixed size; the result has the rows of the whole cloud.
        """
        if len(cloud) <= SETTINGS.points:
            return self._estimated(cloud)
        seen = thinned(cloud)
        estimate = self._estimated(seen)
        groups = _nearest_labels(cloud, seen, _groups(estimate, len(seen)))
        others = np.flatnonzero(groups == OTHER)
        if not estimate.objects:
            return SceneEstimate((), others)
        [found] = estimate.objects
        rows = np.flatnonzero(groups == TARGET)
        moving = _nearest_labels(cloud[rows], seen[found.points], found.moving)
        dense = replace(found, points=rows, moving=moving)
        return SceneEstimate((self._estimator.measured(dense, cloud),), others)

    def _estimated(self, cloud: Points) -> SceneEstimate:
        kind = self._kind or self._estimator.stand_in(cloud, JOINT_TYPES.get(self.asset_class))
        return self._estimator.estimate(cloud, kind.name)

    def why_absent(self, cloud: Points, seen: SceneEstimate) -> dict[str, Any] | None:
        """Return why an estimate of a cloud (N, 3) does not show the object, as plain data; None if it does."""
        return why_absent(seen.objects[0] if seen.objects else None, cloud, self._known)

    def is_shown(self, seen: SceneEstimate) -> bool:
        """Return whether an estimate shows enough of the object to change what is known about it."""
        return bool(seen.objects) and len(seen.objects[0].points) >= LEAST_SEEN * self._seen_at_first

    def foresee(self, cloud: Points, seen: SceneEstimate, rigid: RigidTracker) -> bool:
        """Move the carried objects to where the moving part has carried them, before a cloud shows them. Return whether
        the part now hides them.

        Args:
            cloud: (N, 3) new points that may show the articulated object, base frame, m.
            seen: estimate of these points.
            rigid: tracker of the rigid objects.
        """
        if not self.carried or self._before is None or not self.is_shown(seen):
            return False
        [found] = seen.objects
        measured = self._before.displacement(found, cloud, self.goal, is_expected=self.moves_joint)
        self.carry(None if measured is None else measured.value, rigid)
        return found.joint.openness < SHUT

    def take_in(
        self, cloud: Points, seen: SceneEstimate, rigid: RigidTracker, *, is_pressed: bool | None = None
    ) -> None:
        """Update the estimate. The estimate of a hidden object is not changed.

        Args:
            cloud: (N, 3) points that may show the object, without rigid objects of the task, base frame, m.
            seen: estimate of these points.
            rigid: tracker of the rigid objects. Objects in the moving part move with the joint.
            is_pressed: whether the object has blocked the arm in the latest motion; None: unknown.
        """
        if not self.is_shown(seen):
            self.track = None if self.track is None else replace(self.track, change=None)
            return
        [found] = seen.objects
        self._seen_at_first = self._seen_at_first or len(found.points)
        classes = self._estimator.classes
        self._kind = self._kind or classes[by_name(classes, found.asset_class)]
        before, latest = self._before, self.track
        if before is None:
            self.track = self._begun(Track(found, cloud, seen.others))
        else:
            goal, moves = self.goal, self.moves_joint
            self.track = before.after(found, cloud, seen.others, goal, is_expected=moves, is_pressed=is_pressed)
            if is_pressed and latest is not None and latest is not before:
                # Until the latest cloud of this motion, the object may have moved back, for example with the hand.
                back = goal * (latest.moved - self.track.moved)
                if back >= MOVED[found.joint.type]:
                    self.track = before.after(found, cloud, seen.others, goal, is_expected=moves, is_pressed=False)
        self.carry(self.track.change, rigid)
        if self.has_floor:
            moving = self._in_world(cloud[found.points[found.moving]])
            if len(moving) >= LEAST_POINTS:
                self._floors.append(float(np.quantile(moving[:, 2], LOWEST)))
        self.rest_on_floor(rigid)

    def _begun(self, track: Track) -> Track:
        """Return the track of the first cloud at the start of a step. A joint of unknown openness counts as being at
        the end that is away from the goal, so that the hand moves it over its whole range.
        """
        found = track.latest or track.found
        if not self.goal or found.joint.openness_deviation <= UNKNOWN:
            return replace(track, found=found)
        begun = found.at(0.5 - 0.5 * self.goal, found.joint.openness_deviation)
        return replace(track, found=begun, latest=found)

    def carry(self, change: float | None, rigid: RigidTracker) -> None:
        """Move the hidden objects in the moving part by a displacement (rad or m) of the joint since the latest motion
        began.
        """
        if self._before is None or change is None:
            return
        joint, T = self._before.found.joint, self._estimator.profile.T_world_base
        motion = T @ joint_motion(joint.type, joint.axis, change, joint.origin) @ np.linalg.inv(T)
        for name, before in self.carried.items():
            rigid.found[name] = before.at(motion @ before.T_world_object)

    @property
    def has_moved(self) -> bool:
        """Whether the joint has measurably moved towards the goal since the first cloud."""
        track = self.track
        return track is not None and self.goal * track.moved >= MOVED[track.found.joint.type]

    @property
    def stands_still(self) -> bool:
        """Whether the joint stood still in the latest motion; False if no displacement was measured."""
        track = self.track
        return track is not None and track.change is not None and abs(track.change) < STALLED[track.found.joint.type]

    @property
    def slides_on_table(self) -> bool:
        """Whether the object moves along the table as a whole."""
        return self._slides_level and self.track is not None and bool(self.track.found.moving.all())

    @property
    def _slides_level(self) -> bool:
        """Whether the joint slides horizontally."""
        joint = None if self.track is None else self.track.found.joint
        return joint is not None and joint.type == "prismatic" and abs(joint.axis[2]) <= LEVEL

    @property
    def has_floor(self) -> bool:
        """Whether the moving part slides horizontally and carries objects, as a drawer does: the joint moves the
        measured keypoint, which is the last of several keypoints.
        """
        track = self.track
        if track is None or not self._slides_level:
            return False
        names = list(track.found.keypoints)
        return len(names) > 1 and names[-1] in track.found.moving_keypoints

    @property
    def floor(self) -> float | None:
        """Height (m) of the floor of the moving part in the world frame: the median over all clouds, or None if the
        moving part has no floor, or if it has too few points.
        """
        return float(np.median(self._floors)) if self._floors else None

    def above_floor(self, rigid: RigidTracker) -> list[str]:
        """Return the names of the rigid objects whose centre is above the moving part."""
        if self.track is None:
            return []
        low, high = self._bounds_of(self.track.found.points[self.track.found.moving])
        return [
            name
            for name, each in rigid.found.items()
            if (low[:2] <= each.center[:2]).all() and (each.center[:2] <= high[:2]).all()
        ]

    def rest_on_floor(self, rigid: RigidTracker) -> None:
        """Raise hidden released objects above the moving part to its floor, which no camera may see."""
        if self.floor is not None:
            for name in self.above_floor(rigid):
                rigid.rest_on(name, self.floor)

    def contents(self, rigid: RigidTracker) -> frozenset[str]:
        """Return the names of the rigid objects in the bounding box of the object, except the grasped object. An object
        is not in a drawer if even its highest point is below the floor of the drawer.
        """
        assert self.track is not None
        low, high = self._bounds_of(self.track.found.points)
        low[2], floor = 0.0, 0.0 if self.floor is None else self.floor
        return frozenset(
            name
            for name, each in rigid.found.items()
            if name != rigid.held
            and (low <= each.center).all()
            and (each.center <= high).all()
            and each.bounds[1, 2] >= floor
        )

    @property
    def keypoints(self) -> dict[str, Array]:
        """Estimated positions (3,) of the keypoints by name, in the world frame, m."""
        assert self.track is not None
        return {name: self._in_world(at) for name, at in self.track.found.keypoints.items()}

    def scene_object(self) -> SceneObject:
        """Return the latest estimate as an object of the planner's scene."""
        assert self.track is not None
        profile, cloud = self._estimator.profile, self.track.cloud
        floor = None if self.floor is None or not self.has_floor else self.floor - float(profile.T_world_base[2, 3])
        return scene_object(self.name, at_push_height(self.track.to_plan, cloud, profile), cloud, floor)

    def _is_in_moving_part(self, thing: RigidEstimate) -> bool:
        """Return whether the centre of a rigid object lies in the bounding box of the moving part. Only a part with a
        floor carries objects.
        """
        if self.track is None or not self.has_floor:
            return False
        low, high = self._bounds_of(self.track.found.points[self.track.found.moving])
        return bool((low <= thing.center).all() and (thing.center <= high).all())

    def _bounds_of(self, rows: npt.NDArray[np.int64]) -> tuple[Array, Array]:
        """Return the lowest and the highest corner (3,) of points of the latest cloud in the world frame, m."""
        assert self.track is not None
        points = self._in_world(self.track.cloud[rows])
        if not len(points):
            return np.full(3, np.inf), np.full(3, -np.inf)
        return points.min(axis=0), points.max(axis=0)

    def _in_world(self, points: npt.NDArray[Any]) -> Array:
        """Transform points (..., 3) from the base frame to the world frame."""
        T = self._estimator.profile.T_world_base
        return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def thinned(cloud: Points) -> Points:
    """Return a cloud as the network was trained on it, from a dense cloud (N, 3) in the base frame, m."""
    points = cloud[cloud[:, 2] > SETTINGS.low[2]]
    points = points[uniform_stride(len(points), SETTINGS.candidates)]
    if not len(points):
        return points
    assert SETTINGS.outliers is not None
    points = points[inlier_mask(points, SETTINGS.neighbors, SETTINGS.outliers)]
    return points[farthest_points(points, SETTINGS.points)]


def _groups(seen: SceneEstimate, count: int) -> npt.NDArray[np.int64]:
    """Return the group of each of ``count`` points: ``STRAY``, ``OTHER`` or ``TARGET``."""
    groups = np.full(count, STRAY, dtype=np.int64)
    groups[seen.others] = OTHER
    for each in seen.objects:
        groups[each.points] = TARGET
    return groups


def _nearest_labels(points: Points, labelled: Points, labels: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return for each point (N, 3) the label of the nearest labelled point (M, 3)."""
    if not len(labelled):
        return np.zeros(len(points), dtype=labels.dtype)
    found: npt.NDArray[Any] = labels[cKDTree(labelled).query(points)[1]]
    return found
