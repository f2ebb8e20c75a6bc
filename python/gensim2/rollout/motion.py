"""Compute displacements between two instants, and test whether a scene is at rest."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.robots import RobotProfile
from gensim2.tasks.measurement import Measurement

SETTLED_CHANGE = 0.02
"""Openness change per second below which a joint counts as settled."""

SETTLED_DISTANCE = 0.01
"""Speed (m/s) below which a rigid object counts as settled."""

SETTLED_TURN = 0.5
"""Angular speed (rad/s) below which a rigid object counts as settled; a ball may slowly roll in place."""

LARGEST_OVERSHOOT = 0.5
"""Maximum openness outside 0..1 in a stable simulation; usually joint limits are exceeded by 1 % of this value."""

FARTHEST = 10.0
"""Maximum distance (m) of a rigid object from the world's origin in a stable simulation, even after a fall."""


@dataclass(frozen=True)
class Change:
    """Change of one object between two instants.

    Attributes:
        openness: signed change of the joint's openness; 0 for a rigid object.
        distance: displacement of a rigid object, m; 0 for an articulated object, whose root is fixed.
        turn: rotation angle about any axis, rad.
        tilt: angle between the directions of the object's vertical axis before and after, rad.
    """

    openness: float = 0.0
    distance: float = 0.0
    turn: float = 0.0
    tilt: float = 0.0

    def exceeds(self, openness: float, distance: float) -> bool:
        """Return whether the change of openness or the displacement exceeds its limit; always True for NaN."""
        return not (abs(self.openness) <= openness and self.distance <= distance)


def change(before: Measurement, after: Measurement, name: str) -> Change:
    if name in after.openness:
        return Change(openness=after.openness[name] - before.openness[name])
    then, now = before.poses[name], after.poses[name]
    if not np.isfinite([then, now]).all():
        return Change(distance=math.nan, turn=math.nan, tilt=math.nan)
    turned = _rotation(now) * _rotation(then).inv()
    upright = turned.apply([0.0, 0.0, 1.0])[2]
    return Change(
        distance=math.dist(then[:3], now[:3]),
        turn=float(turned.magnitude()),
        tilt=math.acos(max(-1.0, min(1.0, float(upright)))),
    )


def changes(before: Measurement, after: Measurement) -> Mapping[str, Change]:
    return {name: change(before, after, name) for name in (*after.openness, *after.poses)}


def is_at_rest(before: Measurement, after: Measurement, period: float) -> bool:
    """Return whether nothing moved noticeably between two measurements that are ``period`` (s) apart."""
    return all(
        not moved.exceeds(SETTLED_CHANGE * period, SETTLED_DISTANCE * period) and moved.turn <= SETTLED_TURN * period
        for moved in changes(before, after).values()
    )


def is_stable(measured: Measurement) -> bool:
    """Return whether the simulation is stable: all positions are finite and near the table."""
    return all(-LARGEST_OVERSHOOT <= value <= 1 + LARGEST_OVERSHOOT for value in measured.openness.values()) and all(
        bool(np.isfinite(pose).all()) and float(np.abs(pose[:3]).max()) <= FARTHEST for pose in measured.poses.values()
    )


def gripper_distance(measured: Measurement, name: str) -> float:
    """Return the smallest distance (m) between a keypoint of the gripper and a keypoint of an object."""
    gripper, points = np.stack(list(measured.gripper.values())), np.stack(list(measured.keypoints[name].values()))
    return float(np.linalg.norm(gripper[:, None] - points[None], axis=2).min())


def _rotation(pose: Array) -> Rotation:
    return Rotation.from_quat(pose[3:], scalar_first=True)


GOAL_SECONDS = 0.5
"""Time (s) for which the goal must be reached without interruption to end an episode."""

SETTLE_SECONDS = 0.5
"""Minimum time (s) for which the last command is kept."""

MAX_SETTLE_SECONDS = 2.0
"""Maximum time (s) until an episode is evaluated, even if an object still moves."""

LASTING_SECONDS = 1.0
"""Time (s) after the last command at which the goal must still be reached to count as lasting."""


def may_judge(held: float, at_rest: bool | None, unit: Callable[[float], float] = float) -> bool:
    """Return whether to evaluate the episode.

    The episode is evaluated when the last command was kept for the minimum time with the scene at rest, or for the
    maximum time.

    Args:
        held: time for which the last command has been kept, in seconds or in control steps.
        at_rest: whether the scene is at rest. With None the scene was not measured, and only the minimum time counts.
        unit: conversion from seconds to the unit of ``held``: ``float``, or :meth:`RobotProfile.steps`.
    """
    return held >= unit(MAX_SETTLE_SECONDS) or (held >= unit(SETTLE_SECONDS) and at_rest is not False)


def settle(step: Callable[[], Measurement], before: Measurement, profile: RobotProfile) -> bool:
    """Keep the last command until the scene is at rest or the time is up. Return whether the scene is at rest.

    Args:
        step: function that executes a control step with the last command and returns a measurement.
        before: measurement before the first of these steps.
        profile: robot profile, which gives the length of a control step.
    """
    held, at_rest = 0, False
    while not may_judge(held, at_rest, profile.steps):
        after = step()
        at_rest = is_at_rest(before, after, 1.0 / profile.control_hz)
        before, held = after, held + 1
    return at_rest
