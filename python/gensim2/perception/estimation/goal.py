"""Follow the objects of a task over the motions of an episode, and judge the task's success criteria by estimates."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.perception.cloud import farthest_points
from gensim2.perception.estimation.articulated_tracking import ArticulatedTracker
from gensim2.perception.estimation.division import NOTHING, Labels, first_division, next_division
from gensim2.perception.estimation.estimator import ObjectEstimate, Points, SceneEstimate, SceneEstimator
from gensim2.perception.estimation.examples import SETTINGS
from gensim2.perception.estimation.rigid import clusters, shape_of
from gensim2.perception.estimation.rigid_tracking import RigidTracker
from gensim2.perception.estimation.scene import planning_scene
from gensim2.planning.scene import Scene
from gensim2.tasks.criteria import Criterion, all_hold
from gensim2.tasks.measurement import Measurement

DENSE = replace(SETTINGS, points=32768, candidates=0, low=(0.15, -0.8, 0.01), high=(1.15, 0.8, 1.0), outliers=None)
"""Settings of the point clouds. The clouds contain nearly all pixels, because a small object or a thin moving part may
cover only a dozen pixels.
"""
MOST_POINTS = 8192
"""Maximum number of points of an articulated object. More points of a large cabinet would fill more cells of the
planner's scene, and the hand would not reach into the cabinet.
"""
LEFT = 0.03
"""Minimum displacement (m) of a rigid object that has left its goal."""
ABOVE_BOTTOM = 0.002
"""Minimum height (m) of an object that was put on or into another one above the bottom of this one."""
DISTRUST = 1.5
"""A goal counts as reached if the estimated joint exceeds the goal by this number of standard deviations, divided by
the number of motions of the step. The latest motions do not count if they have not moved the joint."""


class GoalTracker:
    """Estimates the objects of a task from the point clouds of an episode, and judges the success criteria.

    Call :meth:`take_in` with each point cloud, and :meth:`begin_motion` before each motion of the robot. Each cloud is
    divided among the articulated objects and other bodies (:mod:`~gensim2.perception.estimation.division`). The network
    estimates each articulated object in its part of the cloud, and the openness is tracked over the motions
    (:mod:`~gensim2.perception.estimation.articulated_tracking`). Rigid objects are found by their dimensions
    (:mod:`~gensim2.perception.estimation.rigid_tracking`), and their points are removed from the cloud before the
    network estimates the articulated objects.

    Args:
        estimator: estimator of scenes.
        objects: classes of the task's objects, by name.
        success: success criteria of the task.
        places: names of the bodies on or in which the objects are at the start, by name of the object. A rigid object
            in an articulated one is also sought among the points of this one. None: all objects are on the table.

    Raises:
        InputError: a class is unknown.

    Attributes:
        estimator: the estimator.
        articulated: trackers of the articulated objects, by name.
        rigid: tracker of the rigid objects.
        looks: estimates from all clouds of the episode, oldest first.
        motions: number of motions so far.
        mismatch: reason why the first cloud does not show the objects of the task, as plain data; None if the cloud
            shows the objects.
    """

    def __init__(
        self,
        estimator: SceneEstimator,
        objects: Mapping[str, str],
        success: Sequence[Criterion],
        places: Mapping[str, str] | None = None,
    ) -> None:
        known = {each.name for each in estimator.classes}
        shapes = {name: shape_of(each) for name, each in objects.items() if each not in known}
        self.rigid = RigidTracker({name: each for name, each in shapes.items() if each is not None})
        self.articulated = {
            name: ArticulatedTracker(name, each, estimator)
            for name, each in objects.items()
            if name not in self.rigid.shapes
        }
        self.estimator, self._success = estimator, tuple(success)
        self._objects, self._places = dict(objects), dict(places or {})
        self.reset()

    @property
    def is_seen(self) -> bool:
        """Whether the first cloud has shown all objects of the task."""
        return bool(self.looks) and self.mismatch is None

    def reset(self) -> None:
        """Start an episode."""
        self.looks: list[SceneEstimate] = []
        self.motions = 0
        self.mismatch: dict[str, Any] | None = None
        self.rigid.reset()
        # Centres (3,) of the rigid objects that were at their goal when a step began, and that have not left it since.
        self._placed: dict[str, Array] = {}
        for each in self.articulated.values():
            each.reset(self._success)
        self._first_motion = 0
        # Names of the rigid objects that the hand has held.
        self._handled: set[str] = set()
        # Points of each articulated object in the latest cloud that showed it, and of other bodies in the latest cloud.
        self._bodies: list[Points] = [_NO_POINTS] * len(self.articulated)
        self._others: Points = _NO_POINTS

    def begin_step(self, done: Sequence[Criterion], q: Array, left: Collection[str] = ()) -> None:
        """Start a step of the task.

        From now on, only the motions of this step count for the displacements of joints and for the safety margin.

        A rigid object that is now at its goal counts as being there until a cloud shows it elsewhere, or until the hand
        grasps it. Newer estimates of its goal are not used, because they are not more accurate.

        Args:
            done: success criteria of the step.
            q: (n,) joint values of the robot.
            left: names of rigid objects that count as being at their goal.
        """
        measured = self.measurement(q, 0.0)
        for name in self.rigid.shapes.keys() - {self.rigid.held}:
            asked = tuple(each for each in self._success if name in each.objects)
            if name in left or (asked and all_hold(asked, measured)):
                self._placed.setdefault(name, self.rigid.found[name].center)
        self._first_motion = self.motions
        for each in self.articulated.values():
            each.begin_step(done)

    def begin_motion(self) -> None:
        """Keep the latest estimates: after the motion, the displacements are measured against their clouds."""
        self.motions += 1
        for each in self.articulated.values():
            each.begin_motion(self.rigid)

    def hold(self, name: str | None, T_world_object: Array | None = None) -> None:
        """Set the object in the hand and its pose (4, 4) in the world; None: the hand is empty."""
        if name is not None:
            # The hand has taken the object out of the moving part.
            for each in self.articulated.values():
                each.carried.pop(name, None)
            self._placed.pop(name, None)
            self._handled.add(name)
        self.rigid.hold(name, T_world_object)

    def take_in(self, cloud: Points, pressed: Mapping[str, bool] = MappingProxyType({})) -> None:
        """Estimate the objects in a cloud. The estimate of a hidden object is not changed.

        Args:
            cloud: (N, 3) points in the base frame, m, without points of the robot.
            pressed: by the name of an object, whether it has blocked the arm in the latest motion. For other objects,
                this is unknown.
        """
        cloud = np.unique(cloud, axis=0)
        labels = self._divided(cloud)
        if self.rigid.shapes:
            rest = self._take_in_rigid(cloud, labels) < 0
            cloud, labels = cloud[rest], labels[rest]
        objects: list[ObjectEstimate] = []
        others = [np.flatnonzero(labels == NOTHING)]
        is_first = not self.looks
        for number, each in enumerate(self.articulated.values()):
            whole = np.flatnonzero(labels == number)
            rows = whole[farthest_points(cloud[whole], MOST_POINTS)] if len(whole) > MOST_POINTS else whole
            part = cloud[rows]
            seen = each.estimate(part)
            objects += [replace(found, points=rows[found.points]) for found in seen.objects]
            others.append(rows[seen.others])
            why = each.why_absent(part, seen) if is_first else None
            if why is not None:
                named = {"object": each.name} if len(self._objects) > 1 else {}
                self.mismatch = self.mismatch or {**named, "class": each.asset_class, **why}
            if self.mismatch is None:
                each.take_in(part, seen, self.rigid, is_pressed=pressed.get(each.name))
            if each.is_shown(seen):
                self._bodies[number] = cloud[whole]
        self._others = _without_strays(cloud[labels == NOTHING])
        self.looks.append(SceneEstimate(tuple(objects), np.sort(np.concatenate(others))))

    def _divided(self, cloud: Points) -> Labels:
        """Return the label (N,) of each point of a cloud: the index of its articulated object, or ``NOTHING``."""
        trackers = list(self.articulated.values())
        if not trackers:
            return np.full(len(cloud), NOTHING, dtype=np.int64)
        if self.looks:
            moved = [number for number, each in enumerate(trackers) if each.moves_joint]
            return next_division(cloud, self._bodies, self._others, moved)
        by_class = {each.asset_class: each for each in trackers}

        def chance(points: Points, name: str) -> float:
            seen = by_class[name].estimate(points)
            why = by_class[name].why_absent(points, seen)
            return 0.0 if not seen.objects or "extent" in (why or {}) else seen.objects[0].confidence

        table = -float(self.estimator.profile.T_world_base[2, 3])
        return first_division(cloud, table, [each.asset_class for each in trackers], chance)

    def _take_in_rigid(self, cloud: Points, labels: Labels) -> Labels:
        """Estimate the rigid objects in a divided cloud (N, 3), and return the index (N,) of the rigid object that each
        point shows; -1: none.
        """
        of_articulated, floors, shut = np.zeros(len(cloud), dtype=bool), dict[str, float](), set[str]()
        containers: dict[str, npt.NDArray[np.bool_]] = {}
        for number, each in enumerate(self.articulated.values()):
            rows = np.flatnonzero(labels == number)
            seen = each.estimate(cloud[rows])
            if not self.looks:
                contained = [name for name in self.rigid.shapes if self._places.get(name) == each.name]
                containers |= dict.fromkeys(contained, labels == number)
            for found in seen.objects:
                of_articulated[rows[found.points]] = True
            if each.foresee(cloud[rows], seen, self.rigid):
                shut |= each.carried.keys()
            if each.floor is not None:
                floors |= dict.fromkeys(each.above_floor(self.rigid), each.floor)
        T = self.estimator.profile.T_world_base
        points = cloud @ T[:3, :3].T + T[:3, 3]
        carried = {name for each in self.articulated.values() for name in each.carried}
        own = self.rigid.take_in(points, of_articulated, carried, floors, shut=shut, containers=containers)
        for name in carried & self._placed.keys():
            self._placed[name] = self.rigid.found[name].center
        self._placed = {name: place for name, place in self._placed.items() if not self._has_left(name, place)}
        for each in self.articulated.values():
            each.carried = {name: found for name, found in each.carried.items() if self.rigid.is_hidden(name)}
        if not self.looks and self.rigid.missing:
            name = self.rigid.missing[0]
            self.mismatch = {"object": name, "class": self._objects[name]}
        return own

    def _has_left(self, name: str, place: Array) -> bool:
        """Return whether the latest cloud shows a rigid object more than ``LEFT`` away from its place (3,)."""
        away = np.linalg.norm(self.rigid.found[name].center - place)
        return not self.rigid.is_hidden(name) and bool(away > LEFT)

    def is_reached(self, q: Array, distrust: float = DISTRUST) -> bool:
        """Return whether the latest estimate meets the success criteria.

        Args:
            q: (n,) joint values of the robot.
            distrust: safety margin, as for :meth:`measurement`.
        """
        asked = tuple(each for each in self._success if self._placed.keys().isdisjoint(each.objects))
        return all_hold(asked, self.measurement(q, distrust))

    def is_displaced(self, q: Array) -> bool:
        """Return whether an object is not at its goal although the current step does not move its joint. This concerns
        rigid objects, and articulated objects of earlier steps.

        Args:
            q: (n,) joint values of the robot.
        """
        measured = self.measurement(q, 0.0)
        moved = {name for name, each in self.articulated.items() if each.moves_joint}
        return any(
            not set(each.objects) <= moved and self._placed.keys().isdisjoint(each.objects) and not each.holds(measured)
            for each in self._success
        )

    def measurement(self, q: Array, distrust: float = DISTRUST) -> Measurement:
        """Return the latest estimate as a measurement, so that success criteria can be evaluated.

        The estimated openness is moved away from the goal by a safety margin, so that an uncertain estimate does not
        count as success. The margin is ``distrust`` times the standard deviation of the estimate, divided by the number
        of motions of the step. The latest motions do not count if they have not moved the joint.

        Args:
            q: (n,) joint values of the robot.
            distrust: factor of the safety margin; 0 ignores the uncertainty of the estimate. With a negative factor,
                an estimate below the goal counts as success if its uncertainty allows this.
        """
        assert self.is_seen, "the first cloud does not show the objects"
        profile = self.estimator.profile
        openness = {}
        keypoints: dict[str, dict[str, Array]] = {name: each.keypoints for name, each in self.rigid.found.items()}
        contents: dict[str, frozenset[str]] = {}
        for name, each in self.articulated.items():
            assert each.track is not None
            joint, motions = each.track.found.joint, self.motions - self._first_motion - each.track.misses
            keypoints[name] = each.keypoints
            openness[name] = joint.openness - distrust * joint.openness_deviation / max(motions, 1) * each.goal
            # Without contents, the criteria compare heights, because an estimate does not show whether the articulated
            # object is a container. A part with a floor is one.
            inside = each.contents(self.rigid)
            if inside or each.floor is not None:
                contents[name] = inside
        return Measurement(
            openness=openness,
            joint_speed=dict.fromkeys(openness, 0.0),
            keypoints=keypoints,
            poses={name: each.pose for name, each in self.rigid.found.items()},
            speeds={name: np.zeros(2) for name in self.rigid.found},
            gripper=profile.gripper_with(q.tolist()),
            finger_opening=profile.gripper.opening(q[profile.arm_size :]),
            start_positions=self.rigid.start,
            bounds=self._bounds(),
            contents=contents,
        )

    def _bounds(self) -> dict[str, Array]:
        """Return the bounding boxes (2, 3) of the rigid objects in the world frame, m.

        An object that the hand has put on or into another one is above the bottom of this one, although the estimate of
        its height may be a few millimetres too low.
        """
        bounds = {name: each.bounds for name, each in self.rigid.found.items()}
        for name in self._handled - {self.rigid.held}:
            center = self.rigid.found[name].center
            for other in bounds.keys() - self._handled:
                low, high = bounds[other]
                if (low[:2] <= center[:2]).all() and (center[:2] <= high[:2]).all():
                    bounds[name][0, 2] = max(bounds[name][0, 2], low[2] + ABOVE_BOTTOM)
        return bounds

    def slides_on_table(self, name: str) -> bool:
        """Return whether the object with the given name in the task moves along the table as a whole."""
        return name in self.articulated and self.articulated[name].slides_on_table

    def scene(self, q: Array) -> Scene:
        """Return the latest estimate as a scene of the planner, with the objects in the order of the task.

        Args:
            q: (n,) joint values of the robot.
        """
        assert self.is_seen, "the first cloud does not show the objects"
        profile = self.estimator.profile
        T_base_world = np.asarray(np.linalg.inv(profile.T_world_base), dtype=np.float64)
        obstacles = [self._others]
        objects = {}
        for name in self._objects:
            if name in self.rigid.found:
                objects[name] = self.rigid.found[name].scene_object(name, T_base_world)
                continue
            each = self.articulated[name]
            assert each.track is not None
            objects[name] = each.scene_object()
            obstacles.append(each.track.cloud[each.track.others])
        return planning_scene(objects, np.concatenate(obstacles), q, profile)


_NO_POINTS: Points = np.zeros((0, 3), dtype=np.float32)


def _without_strays(cloud: Points) -> Points:
    """Return the points (N, 3) of a cloud that belong to a cluster."""
    rows = clusters(cloud.astype(np.float64))
    return cloud[np.sort(np.concatenate(rows))] if rows else cloud[:0]
