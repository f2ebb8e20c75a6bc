"""Detect deviations from the executed plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.planning.scene import Scene
from gensim2.planning.step_plan import StepPlan
from gensim2.robots import RobotProfile
from gensim2.tasks.measurement import Measurement

MAX_DRIFT = 0.005
"""Maximum distance (m) that an object may move before the hand touches it."""
MAX_OPENNESS_DRIFT = 0.02
"""Maximum openness change of a joint before the hand touches the object."""
MAX_SLIP = 0.03
"""Maximum distance (m) of a grasped object from its planned position in the hand, and maximum slip."""
LEAST_OPENING = 0.002
"""Minimum distance between the pads (m) at which the hand can hold an object of unknown width."""
LEAST_SHARE, LEAST_WIDTH = 0.4, 0.001
"""Minimum distance between the pads at which an object of known width still counts as held: a fraction of the planned
width, and a length (m). The pads may sink into a thin wall, such as that of a bowl, by a millimetre.
"""


@dataclass(frozen=True)
class Held:
    """A grasped object.

    Attributes:
        T_hand_object: (4, 4) pose of the object in the hand frame after the fingers have closed.
        width: planned distance between the pads, m; None if unknown.
        force: force of each finger, N; None if unknown.
    """

    name: str
    T_hand_object: Array
    width: float | None
    force: float | None = None

    def is_lost(self, profile: RobotProfile, q: Array, measured: Measurement) -> bool:
        if measured.finger_opening < _least_opening(self.width):
            return True
        now = in_hand(profile, q, measured, self.name)
        return bool(np.linalg.norm(now[:3, 3] - self.T_hand_object[:3, 3]) > MAX_SLIP)


def taken(profile: RobotProfile, q: Array, measured: Measurement, plan: StepPlan) -> Held | None:
    """Return the grasped object after the fingers have closed; None if the fingers closed on nothing."""
    if plan.picks is None or plan.after is None or measured.finger_opening < _least_opening(plan.width):
        return None
    T_hand_base = np.linalg.inv(profile.model.forward_kinematics(plan.after.q))
    planned = T_hand_base @ plan.after.objects[plan.picks].T_base_object
    T_hand_object = in_hand(profile, q, measured, plan.picks)
    if np.linalg.norm(T_hand_object[:3, 3] - planned[:3, 3]) > MAX_SLIP:
        # The object is not between the fingers. Their distance does not show this, because weak fingers close slowly.
        return None
    return Held(plan.picks, T_hand_object, plan.width, plan.force)


def in_hand(profile: RobotProfile, q: Array, measured: Measurement, name: str) -> Array:
    """Return the pose (4, 4) of a rigid object in the hand's frame."""
    x, y, z, *quaternion = measured.poses[name]
    T_world_object = np.eye(4)
    T_world_object[:3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    T_world_object[:3, 3] = x, y, z
    T_world_hand = profile.T_world_base @ profile.model.forward_kinematics(q)
    return np.asarray(np.linalg.solve(T_world_hand, T_world_object), dtype=np.float64)


def has_drifted(planned: Scene, measured: Measurement, name: str) -> bool:
    """Return whether an object differs from the planned scene by more than a tolerance in its position or openness."""
    thing = planned.objects[name]
    if thing.joint is not None:
        return abs(measured.openness[name] - thing.joint.openness) > MAX_OPENNESS_DRIFT
    planned_at = planned.T_world_base @ np.append(thing.T_base_object[:3, 3], 1.0)
    return bool(np.linalg.norm(measured.poses[name][:3] - planned_at[:3]) > MAX_DRIFT)


def _least_opening(width: float | None) -> float:
    return LEAST_OPENING if width is None else max(LEAST_WIDTH, LEAST_SHARE * width)
