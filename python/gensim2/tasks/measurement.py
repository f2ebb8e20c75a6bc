"""Define the state of a scene at one instant, for any simulator. Criteria and verdicts are computed from this state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gensim2.core.arrays import Array


@dataclass(frozen=True)
class Measurement:
    """State of a scene at one instant, in the world frame.

    Attributes:
        openness: how far the joint of each articulated object is open: (q - lower) / (upper - lower), where q is the
            joint position and lower and upper are the joint limits. The value may lie slightly outside 0..1.
        joint_speed: change of ``openness`` per second, as the simulator reports it. The simulator may report a wrong
            value while a part is pressed against its joint limit.
        keypoints: position (3,) of each keypoint, m, by object name and keypoint name. The keypoints of an object are
            in the order in which the object defines them.
        poses: (7,) pose of each rigid object: x, y, z (m), qw, qx, qy, qz.
        speeds: (2,) linear (m/s) and angular (rad/s) speed of each rigid object, as the simulator reports them.
        gripper: position (3,) of each keypoint of the robot's tool, m.
        finger_opening: distance between the finger pads, m.
        start_positions: position (3,) of each rigid object at the start of the episode, m.
        bounds: lowest and highest corner (2, 3) of each object's bounding box, m. For an articulated object the box
            contains only the link with the measured keypoint. The mapping is empty if the shapes are unknown; success
            criteria then check only distances.
        contents: names of the rigid objects inside each container. The mapping is empty if the shapes are unknown.
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
