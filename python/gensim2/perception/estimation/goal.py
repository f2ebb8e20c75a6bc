"""Follow the objects of a task over the motions of an episode, and judge the task's success criteria by estimates."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gensim2.core.errors import InputError
from gensim2.objects.types import joint_motion
from gensim2.perception.cloud import CloudSettings, farthest_points, inlier_mask, uniform_stride
from gensim2.perception.estimation.classes import by_name
from gensim2.perception.estimation.estimator import (
    LEAST_POINTS,
    LEVEL,
    ObjectEstimate,
    Points,
    SceneEstimate,
    SceneEstimator,
)
from gensim2.perception.estimation.examples import SETTINGS
from gensim2.perception.estimation.network import OTHER, STRAY, TARGET
from gensim2.perception.estimation.presence import why_absent
from gensim2.perception.estimation.rigid import RigidEstimate, clusters, shape_of
from gensim2.perception.estimation.rigid_tracking import RigidTracker
from gensim2.perception.estimation.scene import CELL, planning_scene
from gensim2.perception.estimation.tracking import MOVED, STALLED, Track
from gensim2.planning.scene import Scene
from gensim2.tasks.criteria import JOINT, Criterion, all_hold
from gensim2.tasks.measurement import Measurement

Array = npt.NDArray[np.float64]

DENSE = replace(SETTINGS, points=8192, candidates=0, low=(0.15, -0.8, 0.01), high=(1.15, 0.8, 1.0), outliers=None)
"""Settings of the point clouds for tasks with rigid objects. They contain nearly all pixels, because a small object may
cover only a dozen pixels."""
FINE_CELL = 0.02
"""Side of the grid cells (m) of obstacle boxes in dense clouds (:data:`~gensim2.perception.estimation.scene.CELL`)."""
LOWEST = 0.05
"""Quantile of the heights of a moving part's points that counts as the height of its floor."""
SHUT = 0.2
"""Estimated openness of a part below which the cameras cannot see its contents."""
LEAST_SEEN = 0.25
"""Minimum number of object points, as a fraction of the number in the first cloud. With fewer points the object counts
as hidden, and the estimate is discarded."""
DISTRUST = 1.0
"""A goal counts as reached if the estimated joint exceeds the goal by this number of standard deviations, divided by
the number of motions of the step. The latest motions do not count if they have not moved the joint."""


class GoalTracker:
    """Estimates the objects of a task from the point clouds of an episode, and judges the success criteria.

    Call :meth:`take_in` with each point cloud, and :meth:`begin_motion` before each motion of the robot. The openness
    is tracked over the motions (:mod:`~gensim2.perception.estimation.tracking`). The network estimates the articulated
    object. Rigid objects are found by their dimensions (:mod:`~gensim2.perception.estimation.rigid_tracking`), and
    their points are removed from the cloud before the network estimates the articulated object.

    Args:
        estimator: estimator of scenes.
        objects: classes of the task's objects, by name. At most one object may be articulated.
        success: success criteria of the task.

    Raises:
        InputError: a class is unknown, or the task has several articulated objects.

    Attributes:
        estimator: the estimator.
        name: name of the articulated object in the task; None if all objects are rigid.
        asset_class: class of the articulated object; None if all objects are rigid.
        rigid: tracker of the rigid objects.
        looks: estimates from all clouds of the episode, oldest first.
        track: latest estimate of the articulated object; None before the first cloud, if the first cloud does not show
            an object of the task, and if all objects are rigid.
        motions: number of motions so far.
        mismatch: reason why the first cloud does not show the objects of the task, as plain data; None if the cloud
            shows the objects.
    """

    def __init__(self, estimator: SceneEstimator, objects: Mapping[str, str], success: Sequence[Criterion]) -> None:
        known = {each.name for each in estimator.classes}
        shapes = {name: shape_of(each) for name, each in objects.items() if each not in known}
        self.rigid = RigidTracker({name: each for name, each in shapes.items() if each is not None})
        articulated = [name for name in objects if name not in self.rigid.shapes]
        for name in articulated:
            by_name(estimator.classes, objects[name])
        if len(articulated) > 1:
            message = (
                f"the task has {len(articulated)} articulated objects ({', '.join(articulated)}), but an estimator"
            )
            remedy = "run the task without an estimator, on the true scene"
            raise InputError(f"{message} supports only one", field="objects", remedy=remedy)
        self.name = articulated[0] if articulated else None
        self.asset_class = objects[articulated[0]] if articulated else None
        self.estimator, self._success = estimator, tuple(success)
        self._objects = dict(objects)
        self.reset()

    @property
    def cloud_settings(self) -> CloudSettings:
        """Settings of the point clouds for :meth:`take_in`, without noise."""
        return DENSE if self.rigid.shapes else SETTINGS

    @property
    def is_seen(self) -> bool:
        """Whether the first cloud has shown all objects of the task."""
        is_found = bool(self.looks) if self.name is None else self.track is not None
        return is_found and self.mismatch is None

    def reset(self) -> None:
        """Start an episode."""
        self.looks: list[SceneEstimate] = []
        self.track: Track | None = None
        self.motions = 0
        self.mismatch: dict[str, Any] | None = None
        self.rigid.reset()
        self._before: Track | None = None
        self._carried: dict[str, RigidEstimate] = {}
        self._seen_at_first = 0
        self._first_motion = 0
        self._obstacles: Points = np.zeros((0, 3), dtype=np.float32)
        # Heights (m) of the lowest points of the part into which objects are put, one for each cloud.
        self._floors: list[float] = []
        self._aim(self._success)

    def begin_step(self, done: Sequence[Criterion]) -> None:
        """Start a step of the task with the criteria ``done``: the displacement of the joint and the safety margin are
        from now on those of the motions of this step.
        """
        self._aim(done)
        self._first_motion = self.motions
        if self.track is not None:
            self.track = replace(self.track, moved=0.0, misses=0)

    def _aim(self, criteria: Sequence[Criterion]) -> None:
        kinds = {each.type for each in criteria}
        self._goal = ("articulated_open" in kinds) - ("articulated_closed" in kinds)
        self._moves_joint = any(isinstance(each, JOINT) for each in criteria)

    def begin_motion(self) -> None:
        """Keep the latest estimate: after the motion, the displacement of the joint is measured against its cloud."""
        self.motions, self._before = self.motions + 1, self.track
        # A closed drawer hides the objects in it, and its visible points do not show where it ends.
        self._carried = {
            name: each
            for name, each in self.rigid.found.items()
            if name != self.rigid.held and (name in self._carried or self._is_in_moving_part(each))
        }

    def hold(self, name: str | None, T_world_object: Array | None = None) -> None:
        """Set the object in the hand and its pose (4, 4) in the world; None: the hand is empty."""
        if name is not None:
            # The hand has taken the object out of the moving part.
            self._carried.pop(name, None)
        self.rigid.hold(name, T_world_object)

    def take_in(self, cloud: Points) -> None:
        """Estimate the objects in a cloud. The estimate of a hidden object is not changed.

        Args:
            cloud: (N, 3) points in the base frame, m, without points of the robot.
        """
        if not self.rigid.shapes:
            self._take_in_articulated(cloud)
            return
        cloud = np.unique(cloud, axis=0)
        of_articulated = np.zeros(len(cloud), dtype=bool)
        if self.asset_class is not None:
            seen = thinned(cloud)
            estimate = self.estimator.estimate(seen, self.asset_class)
            of_articulated = _nearest_labels(cloud, seen, _groups(estimate, len(seen))) == TARGET
        is_shut = False
        if self._carried and self._before is not None:
            # Before the objects in the moving part are sought, they are moved to where the part has carried them.
            [found] = self._estimate(cloud, self._before.found.asset_class).objects or [None]
            if found is not None:
                self._carry(self._before.displacement(found, cloud, is_expected=self._moves_joint))
                is_shut = found.joint.openness < SHUT
        T = self.estimator.profile.T_world_base
        floors = {} if self.floor is None else dict.fromkeys(self._above_floor(), self.floor)
        points = cloud @ T[:3, :3].T + T[:3, 3]
        own = self.rigid.take_in(points, of_articulated, self._carried, floors, is_shut=is_shut)
        self._carried = {name: each for name, each in self._carried.items() if self.rigid.is_hidden(name)}
        if not self.looks and self.rigid.missing:
            name = self.rigid.missing[0]
            self.mismatch = {"object": name, "class": self._objects[name]}
        rest = cloud[own < 0]
        if self.asset_class is not None:
            self._take_in_articulated(rest)
        else:
            self.looks.append(SceneEstimate((), np.arange(len(rest))))
            self._obstacles = _without_strays(rest)

    def _take_in_articulated(self, cloud: Points) -> None:
        """Estimate the articulated object in a cloud (N, 3) without rigid objects of the task."""
        assert self.asset_class is not None
        seen = self._estimate(cloud, self.asset_class)
        self.looks.append(seen)
        found = seen.objects[0] if seen.objects else None
        if self.track is None:
            self.mismatch = self.mismatch or self._mismatch(found, cloud)
        if found is None or self.mismatch is not None or len(found.points) < LEAST_SEEN * self._seen_at_first:
            self.track = None if self.track is None else replace(self.track, change=None)
            return
        self._seen_at_first = self._seen_at_first or len(found.points)
        self.track = (
            Track(found, cloud, seen.others)
            if self._before is None
            else self._before.after(found, cloud, seen.others, self._goal, is_expected=self._moves_joint)
        )
        self._carry(self.track.change)
        if self.has_floor:
            T = self.estimator.profile.T_world_base
            moving = cloud[found.points[found.moving]] @ T[:3, :3].T + T[:3, 3]
            if len(moving) >= LEAST_POINTS:
                self._floors.append(float(np.quantile(moving[:, 2], LOWEST)))
        self._rest_on_floor()

    def _estimate(self, cloud: Points, asset_class: str) -> SceneEstimate:
        """Estimate the articulated object. A cloud of a task with rigid objects is thinned first, because the network
        was trained on clouds of a fixed size; the result has the rows of the whole cloud.
        """
        if not self.rigid.shapes:
            return self.estimator.estimate(cloud, asset_class)
        seen = thinned(cloud)
        estimate = self.estimator.estimate(seen, asset_class)
        groups = _nearest_labels(cloud, seen, _groups(estimate, len(seen)))
        others = np.flatnonzero(groups == OTHER)
        if not estimate.objects:
            return SceneEstimate((), others)
        [found] = estimate.objects
        rows = np.flatnonzero(groups == TARGET)
        moving = _nearest_labels(cloud[rows], seen[found.points], found.moving)
        return SceneEstimate((replace(found, points=rows, moving=moving),), others)

    def _is_in_moving_part(self, thing: RigidEstimate) -> bool:
        """Return whether the centre of a rigid object lies in the bounding box of the moving part. Only a part with a
        floor carries objects.
        """
        if self.track is None or not self.has_floor:
            return False
        low, high = self._bounds_of(self.track.found.points[self.track.found.moving])
        return bool((low <= thing.center).all() and (thing.center <= high).all())

    def _carry(self, change: float | None) -> None:
        """Move the hidden objects in the moving part by a displacement (rad or m) of the joint since the latest motion
        began.
        """
        if self._before is None or change is None:
            return
        joint, T = self._before.found.joint, self.estimator.profile.T_world_base
        motion = T @ joint_motion(joint.type, joint.axis, change, joint.origin) @ np.linalg.inv(T)
        for name, before in self._carried.items():
            self.rigid.found[name] = before.at(motion @ before.T_world_object)

    @property
    def has_floor(self) -> bool:
        """Whether the moving part slides horizontally and carries objects, as a drawer does: the joint moves the
        measured keypoint, which is the last of several keypoints.
        """
        track = self.track
        if track is None or track.found.joint.type != "prismatic" or abs(track.found.joint.axis[2]) > LEVEL:
            return False
        names = list(track.found.keypoints)
        return len(names) > 1 and names[-1] in track.found.moving_keypoints

    @property
    def floor(self) -> float | None:
        """Height (m) of the floor of the moving part in the world frame: the median over all clouds. None if the moving
        part has no floor, or if it has too few points.
        """
        return float(np.median(self._floors)) if self._floors else None

    def _above_floor(self) -> list[str]:
        """Return the names of the rigid objects whose centre is above the moving part."""
        if self.track is None:
            return []
        low, high = self._bounds_of(self.track.found.points[self.track.found.moving])
        return [
            name
            for name, each in self.rigid.found.items()
            if (low[:2] <= each.center[:2]).all() and (each.center[:2] <= high[:2]).all()
        ]

    def _rest_on_floor(self) -> None:
        """Raise hidden released objects above the moving part to its floor, which no camera may see."""
        if self.floor is not None:
            for name in self._above_floor():
                self.rigid.rest_on(name, self.floor)

    def _bounds_of(self, rows: npt.NDArray[np.int64]) -> tuple[Array, Array]:
        """Return the lowest and the highest corner (3,) of points of the latest cloud in the world frame, m."""
        assert self.track is not None
        T = self.estimator.profile.T_world_base
        points = self.track.cloud[rows] @ T[:3, :3].T + T[:3, 3]
        if not len(points):
            return np.full(3, np.inf), np.full(3, -np.inf)
        return points.min(axis=0), points.max(axis=0)

    def _mismatch(self, found: ObjectEstimate | None, cloud: Points) -> dict[str, Any] | None:
        """Return why a cloud does not show an object of the task's class; None if the cloud shows the object."""
        detail: dict[str, Any] = {"object": self.name} if self.rigid.shapes else {}
        assert self.asset_class is not None
        detail["class"] = self.asset_class
        kind = self.estimator.classes[by_name(self.estimator.classes, self.asset_class)]
        why = why_absent(found, cloud, kind)
        return None if why is None else detail | why

    @property
    def has_moved(self) -> bool:
        """Whether the joint has measurably moved towards the goal since the first cloud."""
        track = self.track
        return track is not None and self._goal * track.moved >= MOVED[track.found.joint.type]

    @property
    def stands_still(self) -> bool:
        """Whether the joint stood still in the latest motion; False if no displacement was measured."""
        track = self.track
        return track is not None and track.change is not None and abs(track.change) < STALLED[track.found.joint.type]

    def is_reached(self, q: Array, distrust: float = DISTRUST, besides: Collection[str] = ()) -> bool:
        """Return whether the latest estimate meets the success criteria.

        Args:
            q: (n,) joint values of the robot.
            distrust: safety margin, as for :meth:`measurement`.
            besides: names of rigid objects whose criteria do not count.
        """
        asked = tuple(each for each in self._success if set(besides).isdisjoint(each.objects))
        return all_hold(asked, self.measurement(q, distrust))

    def is_displaced(self, q: Array, besides: Collection[str] = ()) -> bool:
        """Return whether a rigid object is not where the success criteria require it.

        Args:
            q: (n,) joint values of the robot.
            besides: names of rigid objects whose criteria do not count.
        """
        measured, counted = self.measurement(q, 0.0), self.rigid.shapes.keys() - set(besides)
        return any(not counted.isdisjoint(each.objects) and not each.holds(measured) for each in self._success)

    def measurement(self, q: Array, distrust: float = DISTRUST) -> Measurement:
        """Return the latest estimate as a measurement, from which success criteria are computed.

        The estimated openness is moved away from the goal by a safety margin, so that an uncertain estimate does not
        count as success. The margin is ``distrust`` times the standard deviation of the estimate, divided by the number
        of motions of the step. The latest motions do not count if they have not moved the joint.

        Args:
            q: (n,) joint values of the robot.
            distrust: factor of the safety margin; 0 ignores the uncertainty of the estimate. With a negative factor,
                an estimate below the goal counts as success if its uncertainty allows this.
        """
        assert self.is_seen, "the first cloud does not show the objects"
        profile, track = self.estimator.profile, self.track
        openness, joint_speed = {}, {}
        keypoints: dict[str, dict[str, Array]] = {name: each.keypoints for name, each in self.rigid.found.items()}
        contents: dict[str, frozenset[str]] = {}
        if track is not None and self.name is not None:
            found, T = track.found, profile.T_world_base
            keypoints[self.name] = {name: T[:3, :3] @ at + T[:3, 3] for name, at in found.keypoints.items()}
            doubt = distrust * found.joint.openness_deviation / max(self.motions - self._first_motion - track.misses, 1)
            openness[self.name] = found.joint.openness - doubt * self._goal
            joint_speed[self.name] = 0.0
            # Without contents, the criteria compare heights, because an estimate does not show whether the articulated
            # object is a container. A part with a floor is one.
            inside = self._contents(track)
            contents = {self.name: inside} if inside or self.floor is not None else {}
        return Measurement(
            openness=openness,
            joint_speed=joint_speed,
            keypoints=keypoints,
            poses={name: each.pose for name, each in self.rigid.found.items()},
            speeds={name: np.zeros(2) for name in self.rigid.found},
            gripper=profile.gripper_with(q.tolist()),
            finger_opening=profile.gripper.opening(q[profile.arm_size :]),
            start_positions=self.rigid.start,
            bounds={name: each.bounds for name, each in self.rigid.found.items()},
            contents=contents,
        )

    def _contents(self, track: Track) -> frozenset[str]:
        """Return the names of the rigid objects in the bounding box of the articulated object, except the grasped
        object. An object is not in a drawer if even its highest point is below the floor of the drawer.
        """
        low, high = self._bounds_of(track.found.points)
        low[2], floor = 0.0, 0.0 if self.floor is None else self.floor
        return frozenset(
            name
            for name, each in self.rigid.found.items()
            if name != self.rigid.held
            and (low <= each.center).all()
            and (each.center <= high).all()
            and each.bounds[1, 2] >= floor
        )

    def scene(self, q: Array) -> Scene:
        """Return the latest estimate as a scene of the planner.

        Args:
            q: (n,) joint values of the robot.
        """
        assert self.is_seen, "the first cloud does not show the objects"
        profile, track = self.estimator.profile, self.track
        T_base_world = np.asarray(np.linalg.inv(profile.T_world_base), dtype=np.float64)
        rigid = {name: each.scene_object(name, T_base_world) for name, each in self.rigid.found.items()}
        if track is None or self.name is None:
            return planning_scene({}, self._obstacles, np.arange(len(self._obstacles)), q, profile, rigid=rigid)
        cell = FINE_CELL if rigid else CELL
        floor = None if self.floor is None else self.floor - float(profile.T_world_base[2, 3])
        found = planning_scene(
            {self.name: track.to_plan}, track.cloud, track.others, q, profile, rigid=rigid, cell=cell, floor=floor
        )
        # The objects of the scene are in the order of the task.
        return replace(found, objects={name: found.objects[name] for name in self._objects})


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


def _without_strays(cloud: Points) -> Points:
    """Return the points (N, 3) of a cloud that belong to a cluster."""
    rows = clusters(cloud.astype(np.float64))
    return cloud[np.sort(np.concatenate(rows))] if rows else cloud[:0]
