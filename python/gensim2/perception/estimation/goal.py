"""Follow the object of a task over the motions of an episode, and judge the task's success criteria by estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.perception.estimation.classes import by_name
from gensim2.perception.estimation.estimator import ObjectEstimate, Points, SceneEstimate, SceneEstimator
from gensim2.perception.estimation.tracking import MOVED, STALLED, Track
from gensim2.tasks.criteria import Criterion, all_hold
from gensim2.tasks.measurement import Measurement

Array = npt.NDArray[np.float64]

CLASS_ODDS = 100.0
"""Prior odds that an articulated object in the cloud has the task's class instead of another class."""
LEAST_SEEN = 0.25
"""Minimum number of object points, as a fraction of the number in the first cloud. With fewer points the object counts
as hidden, and the estimate is discarded."""
DISTRUST = 0.5
"""A goal counts as reached if the estimated joint exceeds the goal by this number of standard deviations, divided by
the number of motions so far."""


class GoalTracker:
    """Estimates the object of a task from the point clouds of an episode, and judges the success criteria.

    Call :meth:`take_in` with each point cloud, and :meth:`begin_motion` before each motion of the robot. The openness
    is tracked over the motions (:mod:`~gensim2.perception.estimation.tracking`).

    Args:
        estimator: estimator of scenes.
        objects: classes of the task's objects, by name. There must be exactly one object.
        success: success criteria of the task.

    Raises:
        InputError: the estimator does not know the object's class, or the task has several objects.

    Attributes:
        estimator: the estimator.
        name: name of the object in the task.
        asset_class: class of the object.
        looks: estimates from all clouds of the episode, oldest first.
        track: latest estimate of the object; None before the first cloud, and if the first cloud does not show the
            object.
        motions: number of motions so far.
        mismatch: reason why the first cloud does not show an object of the task's class, as plain data; None if the
            cloud shows the object.
    """

    def __init__(self, estimator: SceneEstimator, objects: Mapping[str, str], success: Sequence[Criterion]) -> None:
        if len(objects) != 1:
            message = f"the task has {len(objects)} objects, but an estimator supports only one"
            raise InputError(message, field="objects", remedy="run the task without an estimator, on the true scene")
        [(self.name, asset_class)] = objects.items()
        self.asset_class = estimator.classes[by_name(estimator.classes, asset_class)].name
        self.estimator, self._success = estimator, tuple(success)
        kinds = {each.type for each in success}
        self._goal = ("articulated_open" in kinds) - ("articulated_closed" in kinds)
        self.reset()

    def reset(self) -> None:
        """Start an episode."""
        self.looks: list[SceneEstimate] = []
        self.track: Track | None = None
        self.motions = 0
        self.mismatch: dict[str, Any] | None = None
        self._before: Track | None = None
        self._seen_at_first = 0

    def begin_motion(self) -> None:
        """Keep the latest estimate: after the motion, the displacement of the joint is measured against its cloud."""
        self.motions, self._before = self.motions + 1, self.track

    def take_in(self, cloud: Points) -> None:
        """Estimate the object in a cloud. The estimate is discarded if the object is hidden.

        Args:
            cloud: (N, 3) points in the base frame, m, without points of the robot.
        """
        seen = self.estimator.estimate(cloud, self.asset_class)
        self.looks.append(seen)
        found = seen.objects[0] if seen.objects else None
        if self.track is None:
            self.mismatch = self._mismatch(found)
        if found is None or self.mismatch is not None or len(found.points) < LEAST_SEEN * self._seen_at_first:
            self.track = None if self.track is None else replace(self.track, change=None)
            return
        self._seen_at_first = self._seen_at_first or len(found.points)
        self.track = (
            Track(found, cloud, seen.others)
            if self._before is None
            else self._before.after(found, cloud, seen.others, self._goal)
        )

    def _mismatch(self, found: ObjectEstimate | None) -> dict[str, Any] | None:
        """Return why a cloud does not show an object of the task's class; None if the cloud shows the object."""
        detail: dict[str, Any] = {"class": self.asset_class}
        if found is not None:
            likeliest = max(found.classes, key=lambda name: found.classes[name])
            if CLASS_ODDS * found.confidence >= found.classes[likeliest]:
                return None
            detail |= {
                "probability": round(found.confidence, 4),
                "likeliest": likeliest,
                "probability_of_likeliest": round(found.classes[likeliest], 4),
            }
        return detail

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

    def is_reached(self, q: Array, distrust: float = DISTRUST) -> bool:
        """Return whether the latest estimate meets the success criteria.

        Args:
            q: (n,) joint values of the robot.
            distrust: safety margin, as for :meth:`measurement`.
        """
        return all_hold(self._success, self.measurement(q, distrust))

    def measurement(self, q: Array, distrust: float = DISTRUST) -> Measurement:
        """Return the latest estimate as a measurement, from which success criteria are computed.

        The estimated openness is moved away from the goal by a safety margin, so that an uncertain estimate does not
        count as success. The margin is ``distrust`` times the standard deviation of the estimate, divided by the number
        of motions so far.

        Args:
            q: (n,) joint values of the robot.
            distrust: factor of the safety margin; 0 ignores the uncertainty of the estimate. With a negative factor,
            an estimate below the goal counts as success if its uncertainty allows this.
        """
        assert self.track is not None, "the first cloud does not show the object"
        found, profile = self.track.found, self.estimator.profile
        T_world_base = profile.T_world_base
        keypoints = {name: T_world_base[:3, :3] @ at + T_world_base[:3, 3] for name, at in found.keypoints.items()}
        doubt = distrust * found.joint.openness_deviation / max(self.motions, 1)
        return Measurement(
            openness={self.name: found.joint.openness - doubt * self._goal},
            joint_speed={self.name: 0.0},
            keypoints={self.name: keypoints},
            poses={},
            speeds={},
            gripper=profile.gripper_with(q.tolist()),
            finger_opening=profile.gripper.opening(q[profile.arm_size :]),
        )
