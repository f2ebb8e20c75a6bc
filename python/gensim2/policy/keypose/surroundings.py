"""Build collision scenes from a point cloud: the table, obstacle points, and points of a grasped object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.sparse.csgraph import connected_components

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.robots import RobotProfile

POINT_RADIUS = 0.006
"""Radius (m) of the ball that models each point of the cloud."""
EVERY = 3
"""Only every ``EVERY``-th waypoint of a path is checked for penetration; waypoints are 1.5 cm apart."""
NEAR_FINGERS, NEXT, CARRIED = 0.02, 0.03, 0.3
"""Distances (m) for segmenting a grasped object. The object consists of points closer than ``NEAR_FINGERS`` to the
fingers, and of points closer than ``NEXT`` to another point of the object, up to the distance ``CARRIED`` from the
hand."""


@dataclass(frozen=True)
class Seen:
    """A point cloud, segmented into obstacles and a grasped object, in the base frame.

    Attributes:
        standing: (N, 3) obstacle points, m.
        held: (M, 3) points of the grasped object, m.
        q: (n,) joints of the observation.
        holds: whether the hand holds an object; the cloud may show no points of the object.
    """

    standing: Array
    held: Array
    q: Array
    holds: bool

    @property
    def without_held(self) -> Seen:
        """Return the cloud without the grasped object, because the object's pose after a release is unknown."""
        return replace(self, held=np.zeros((0, 3)), holds=False)


class Surroundings:
    """Builds collision scenes of one robot from point clouds.

    Attributes:
        bare: collision scene with only the robot and the table, without points of a cloud.
    """

    def __init__(self, profile: RobotProfile) -> None:
        self._model = profile.model
        self._table = _table(profile)
        self.bare = kpam.Scene(profile.model, [self._table])
        self._wrist = _links_of_the_wrist(profile)

    def seen(self, points: Array, q: Array, holds: bool) -> Seen:
        """Segment a cloud into obstacles and the grasped object.

        Args:
            points: (N, 3) points in the base frame, without points of the robot, m.
            q: (n,) joints.
            holds: whether the hand holds an object.
        """
        mine = self._held(points, q) if holds else np.zeros(len(points), dtype=bool)
        return Seen(points[~mine], points[mine], q, holds)

    def scene(self, seen: Seen) -> kpam.Scene:
        """Return a collision scene with the table, the obstacle points, and the grasped object as a part of the
        hand.
        """
        parts = (("cloud", seen.standing), ("held", seen.held))
        bodies = [
            kpam.Body(name, "rigid", [kpam.Shape.point_cloud(part, POINT_RADIUS)], np.eye(4))
            for name, part in parts
            if len(part)
        ]
        scene = kpam.Scene(self._model, [self._table, *bodies])
        return scene.attached("held", seen.q) if len(seen.held) else scene

    def untouched(self, seen: Seen, *joints: Array) -> Seen:
        """Remove obstacle points that overlap the arm or the grasped object at the given joints (n,).

        The joints are the start and the goal of a motion, where an overlapping point cannot be a real obstacle.
        """
        scene, touched = self.scene(seen), np.zeros(len(seen.standing), dtype=bool)
        for q in joints:
            touched |= scene.own_points(q, seen.standing, POINT_RADIUS)
        return replace(seen, standing=seen.standing[~touched])

    def depth_in(self, seen: Seen) -> Callable[[Array], float]:
        """Return a function that computes how deep the arm penetrates the point cloud.

        The function takes joint positions (W, n) along a path and returns the maximum penetration in m. To save time,
        it checks only every ``EVERY``-th position. It ignores the hand, which has to touch objects.
        """
        if not len(seen.standing):
            return lambda joints: 0.0
        scene = self.scene(seen.without_held)

        def depth(joints: Array) -> float:
            overlaps = [
                -pair["distance"]
                for each in scene.check(joints[::EVERY])
                for pair in each
                if "cloud" in pair["bodies"] and not self._wrist.intersection(pair["bodies"])
            ]
            return max(overlaps, default=0.0)

        return depth

    def _held(self, points: Array, q: Array) -> npt.NDArray[np.bool_]:
        """Return a mask (N,) that selects the points of the grasped object. The mask contains the points close to the
        fingers, and all points that a chain of neighbouring points connects with the fingers.
        """
        hand = self._model.forward_kinematics(q)[:3, 3]
        near = np.flatnonzero(np.linalg.norm(points - hand, axis=1) < CARRIED)
        found = np.zeros(len(points), dtype=bool)
        if len(near):
            apart = np.linalg.norm(points[near][:, None] - points[near][None], axis=-1)
            _, piece = connected_components(apart < NEXT)
            found[near] = np.isin(piece, piece[self.bare.own_points(q, points[near], NEAR_FINGERS)])
        return found


def _links_of_the_wrist(profile: RobotProfile) -> frozenset[str]:
    """Return the links that do not move relative to the hand: flange, hand and fingers."""
    model, arm = profile.model, list(profile.arm_columns)
    q = np.array(profile.reset_qpos)
    bent = q.copy()
    bent[arm] = 0.5 * (q[arm] + np.clip(0.5 * (model.lower + model.upper), -1.0, 1.0)[arm]) + 0.1

    def to_hand(name: str, at: Array) -> Array:
        return np.linalg.inv(model.forward_kinematics(at)) @ model.forward_kinematics(at, name)

    return frozenset(name for name in model.link_names if np.allclose(to_hand(name, q), to_hand(name, bent), atol=1e-9))


def _table(profile: RobotProfile) -> kpam.Body:
    from gensim2.scenes.table import HALF_SIZE

    pose = np.eye(4)
    pose[2, 3] = -HALF_SIZE[2]
    return kpam.Body("table", "table", [kpam.Shape.box(HALF_SIZE)], np.linalg.inv(profile.T_world_base) @ pose)
