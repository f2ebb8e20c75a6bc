"""Measurement of a scene at one instant: all that criteria and verdicts go by, free of any simulator's types."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Measurement:
    """One instant, in the world frame.

    Attributes:
        openness: of each articulated object: (q - lower) / (upper - lower); may leave 0..1 by the joint's give.
        joint_speed: of each articulated object, openness per second, as physics reports it: of what is pressed into
            something it may be far from how it moves.
        keypoints: of each object, by name and in the object's own order: (3,) m.
        poses: (7,) of each rigid object: x, y, z, qw, qx, qy, qz.
        speeds: (2,) of each rigid object: m/s and rad/s, as physics reports them.
        gripper: tool keypoints of the robot: (3,) m.
        finger_opening: distance between the fingers' pads, m.
        start_positions: of each rigid object, (3,) where the origin of its frame was put at the reset.
    """

    openness: Mapping[str, float]
    joint_speed: Mapping[str, float]
    keypoints: Mapping[str, Mapping[str, Array]]
    poses: Mapping[str, Array]
    speeds: Mapping[str, Array]
    gripper: Mapping[str, Array]
    finger_opening: float
    start_positions: Mapping[str, Array] = field(default_factory=dict)

    def point(self, name: str) -> Array:
        """(3,) the measured point of an object: its last keypoint, as in the original."""
        return list(self.keypoints[name].values())[-1]
