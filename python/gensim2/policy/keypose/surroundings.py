"""Collision scenes from a point cloud: the table, obstacle points, and the points of a grasped object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.sparse.csgraph import connected_components

import gensim2_kpam as kpam
from gensim2.robots import RobotProfile

Array = npt.NDArray[np.float64]

POINT_RADIUS = 0.006
"""Radius (m) of the ball that models each point of the cloud."""
EVERY = 3
"""Stride over a path's waypoints (1.5 cm apart) at which penetration into the cloud is computed."""
NEAR_FINGERS, NEXT, CARRIED = 0.02, 0.03, 0.3
"""Distances (m) that segment a held object: points so near to the fingers start it, points so near to one of its points
join it, and points further from the hand do not belong to it."""


@dataclass(frozen=True)
class Seen:
    """A cloud as obstacles, in the base frame.

    Attributes:
        standing: (N, 3) points of what stands about, m.
        held: (M, 3) points of what the hand holds.
        q: (n,) joints at which it was seen.
        holds: the hand held something, of which there may be no point.
    """

    standing: Array
    held: Array
    q: Array
    holds: bool

    @property
    def without_held(self) -> Seen:
        """Cloud without the held object, whose pose after its release was not seen."""
        return replace(self, held=np.zeros((0, 3)), holds=False)


class Surroundings:
    """Makes planning scenes of one robot and what is seen about it.

    Args:
        profile: the robot.

    Attributes:
        bare: the robot and the table, which is known for certain.
    """

    def __init__(self, profile: RobotProfile) -> None:
        self._model = profile.model
        self._table = _table(profile)
        self.bare = kpam.Scene(profile.model, [self._table])
        self._wrist = _links_of_the_wrist(profile)

    def seen(self, points: Array, q: Array, holds: bool) -> Seen:
        """Take apart a cloud (N, 3) that was seen at joints ``q``.

        Args:
            points: in the base frame, without the robot's own.
            q: (n,) joints.
            holds: the hand holds something.
        """
        mine = self._held(points, q) if holds else np.zeros(len(points), dtype=bool)
        return Seen(points[~mine], points[mine], q, holds)

    def scene(self, seen: Seen) -> kpam.Scene:
        """The table, what stands about, and what is held as a part of the hand."""
        parts = (("cloud", seen.standing), ("held", seen.held))
        bodies = [
            kpam.Body(name, "rigid", [kpam.Shape.point_cloud(part, POINT_RADIUS)], np.eye(4))
            for name, part in parts
            if len(part)
        ]
        scene = kpam.Scene(self._model, [self._table, *bodies])
        return scene.attached("held", seen.q) if len(seen.held) else scene

    def untouched(self, seen: Seen, *joints: Array) -> Seen:
        """Remove the standing points that the arm, or an object that it holds, overlaps at some (n,) joints.

        At the start and the goal of a motion such points cannot be obstacles.
        """
        scene, touched = self.scene(seen), np.zeros(len(seen.standing), dtype=bool)
        for q in joints:
            touched |= scene.own_points(q, seen.standing, POINT_RADIUS)
        return replace(seen, standing=seen.standing[~touched])

    def depth_in(self, seen: Seen) -> Callable[[Array], float]:
        """Return a function: joints (W, n) -> deepest penetration (m) of the arm, hand excluded, into the standing
        points, at every ``EVERY``-th row.
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
        """Mask (N,) of the held object: the points between the fingers, and those connected to them."""
        hand = self._model.forward_kinematics(q)[:3, 3]
        near = np.flatnonzero(np.linalg.norm(points - hand, axis=1) < CARRIED)
        found = np.zeros(len(points), dtype=bool)
        if len(near):
            apart = np.linalg.norm(points[near][:, None] - points[near][None], axis=-1)
            _, piece = connected_components(apart < NEXT)
            found[near] = np.isin(piece, piece[self.bare.own_points(q, points[near], NEAR_FINGERS)])
        return found


def _links_of_the_wrist(profile: RobotProfile) -> frozenset[str]:
    """Names of the links that no joint of the arm moves against the hand: the flange, the hand, its fingers."""
    model, arm = profile.model, list(profile.arm_columns)
    q = np.array(profile.reset_qpos)
    bent = q.copy()
    bent[arm] = 0.5 * (q[arm] + np.clip(0.5 * (model.lower + model.upper), -1.0, 1.0)[arm]) + 0.1

    def to_hand(name: str, at: Array) -> Array:
        return np.linalg.inv(model.forward_kinematics(at)) @ model.forward_kinematics(at, name)

    return frozenset(name for name in model.link_names if np.allclose(to_hand(name, q), to_hand(name, bent), atol=1e-9))


def _table(profile: RobotProfile) -> kpam.Body:
    """The table before the robot, as large as a scene's."""
    from gensim2.scenes.table import HALF_SIZE

    pose = np.eye(4)
    pose[2, 3] = -HALF_SIZE[2]
    return kpam.Body("table", "table", [kpam.Shape.box(HALF_SIZE)], np.linalg.inv(profile.T_world_base) @ pose)
