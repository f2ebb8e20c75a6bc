"""State of a scene at one instant, as input of criteria and verdicts, without types of a simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Measurement:
    """State of a scene at one instant, in the world frame.

    Attributes:
        openness: (q - lower) / (upper - lower) of each articulated object; may slightly exceed 0..1.
        joint_speed: openness per second of each articulated object, as the simulator reports it; for a part pressed
            against a stop it may differ from the real motion.
        keypoints: (3,) m by object and keypoint, in the object's own order.
        poses: (7,) of each rigid object: x, y, z, qw, qx, qy, qz.
        speeds: (2,) of each rigid object: m/s and rad/s, as the simulator reports them.
        gripper: tool keypoints of the robot, (3,) m.
        finger_opening: distance between the finger pads, m.
        start_positions: (3,) frame origin of each rigid object at the reset.
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
        """Return the measured keypoint (3,) of an object: its last keypoint, as in the original."""
        return list(self.keypoints[name].values())[-1]
