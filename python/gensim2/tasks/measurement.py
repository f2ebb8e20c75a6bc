"""Define the state of a scene at one instant, from which criteria and verdicts are computed, for any simulator."""

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
        openness: (q - lower) / (upper - lower) of each articulated object; may lie slightly outside 0..1.
        joint_speed: openness per second of each articulated object, as the simulator reports it; for a part pressed
            against a stop it may differ from the real motion.
        keypoints: position (3,) of each keypoint, m, by object and keypoint, in the order of the object's definition.
        poses: (7,) pose of each rigid object: x, y, z (m), qw, qx, qy, qz.
        speeds: (2,) linear (m/s) and angular (rad/s) speed of each rigid object, as the simulator reports them.
        gripper: tool keypoints of the robot, (3,) m.
        finger_opening: distance between the finger pads, m.
        start_positions: (3,) position (m) of each rigid object at the reset.
        bounds: lowest and highest corner (2, 3), m, of each rigid object, and of the link with the measured keypoint of
            each articulated object; empty if the shapes are unknown, so that criteria check distances only.
        contents: names of the rigid objects inside each container; empty if the shapes are unknown.
    """

    openness: Mapping[str, float]
    joint_speed: Mapping[str, float]
    keypoints: Mapping[str, Mapping[str, Array]]
    poses: Mapping[str, Array]
    speeds: Mapping[str, Array]
    gripper: Mapping[str, Array]
    finger_opening: float
    start_positions: Mapping[str, Array] = field(default_factory=dict)
    bounds: Mapping[str, Array] = field(default_factory=dict)
    contents: Mapping[str, frozenset[str]] = field(default_factory=dict)

    def point(self, name: str) -> Array:
        """Return the measured keypoint (3,) of an object: its last keypoint, as in the original GenSim2."""
        return list(self.keypoints[name].values())[-1]
