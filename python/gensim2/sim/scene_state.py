"""From the simulator to values: :class:`~gensim2.planning.scene.Scene` and :class:`Measurement`, in float64."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from sapien import physx

from gensim2.planning.scene import Scene, SceneBody
from gensim2.robots import RobotProfile
from gensim2.sim.gripper import robot_joints
from gensim2.sim.lazy_mapping import LazyMapping
from gensim2.sim.objects import link_name
from gensim2.sim.parts import ArticulatedPart, Parts, RigidPart, as_matrix
from gensim2.sim.table import HALF_SIZE, corners
from gensim2.tasks.measurement import Measurement

Array = npt.NDArray[np.float64]

_TABLE_HULLS = (corners(),)


class RobotReader:
    """Reader of a robot's state in a scene.

    Args:
        profile: of the robot.
        articulation: as it was built; None where the scene was built without, and the robot counts as standing at its
            start.
        start: (n,) all active joints at the start of the episode; None takes the profile's.
    """

    def __init__(
        self,
        profile: RobotProfile,
        articulation: physx.PhysxArticulation | None,
        start: Sequence[float] | None = None,
    ) -> None:
        self.profile, self.articulation = profile, articulation
        self._start = profile.reset_qpos if start is None else start
        if articulation is not None:
            self._hand = next(link for link in articulation.links if link_name(link) == profile.hand_link)
            self._joints = robot_joints(articulation, profile)

    @property
    def q(self) -> Array:
        """(n,) joints, rad and m, in the profile's active joint order."""
        if self.articulation is None:
            return np.array(self._start)
        return np.asarray(self.articulation.qpos, dtype=np.float64)

    @property
    def qvel(self) -> Array:
        """(n,) their velocities."""
        if self.articulation is None:
            return np.zeros(len(self._start))
        return np.asarray(self.articulation.qvel, dtype=np.float64)

    def gripper(self) -> Mapping[str, Array]:
        """Tool keypoints in the world, (3,) m."""
        if self.articulation is None:
            return self.profile.gripper_with(self._start)
        pose = self._hand.entity.pose
        return LazyMapping(lambda: self.profile.gripper_at(as_matrix(pose)))

    @property
    def finger_friction(self) -> float:
        """Coefficient of the fingers' surface."""
        gripper = self.profile.gripper
        if self.articulation is None:
            return gripper.friction
        finger = next(link for link in self.articulation.links if link_name(link) == gripper.pads[0])
        return float(finger.collision_shapes[0].physical_material.dynamic_friction)

    @property
    def finger_stiffness(self) -> float:
        """Of the drives that press the pads together, N/m or N m/rad."""
        if self.articulation is None:
            return self.profile.finger_drive.stiffness
        return float(self._joints[self.profile.gripper.fingers[0]].stiffness)

    @property
    def finger_opening(self) -> float:
        """Distance between the fingers' pads, m."""
        if self.articulation is None:
            return self.profile.gripper.widest
        return self.profile.gripper.opening(self.q[self.profile.arm_size :])


def measure(robot: RobotReader, parts: Parts) -> Measurement:
    """Measure the present instant in the world frame, for criteria and verdicts."""
    articulated = {name: part for name, part in parts.items() if isinstance(part, ArticulatedPart)}
    rigid = {name: part for name, part in parts.items() if isinstance(part, RigidPart)}
    return Measurement(
        openness={name: part.openness for name, part in articulated.items()},
        joint_speed={name: part.joint_speed for name, part in articulated.items()},
        keypoints={name: part.keypoints() for name, part in parts.items()},
        poses={name: part.pose for name, part in rigid.items()},
        speeds={name: part.speeds for name, part in rigid.items()},
        gripper=robot.gripper(),
        finger_opening=robot.finger_opening,
        start_positions={name: part.thing.position for name, part in rigid.items()},
    )


def read_scene(robot: RobotReader, parts: Parts) -> Scene:
    """Return the poses of everything in the robot's base frame; what the hand holds is for the caller to know."""
    T_world_base = robot.profile.T_world_base  # exact: the simulator's own value is rounded to float32
    T_base_world = np.asarray(np.linalg.inv(T_world_base), dtype=np.float64)
    return Scene(
        q=robot.q,
        qvel=robot.qvel,
        T_world_base=T_world_base,
        objects={name: part.scene_object(T_base_world) for name, part in parts.items()},
        fixtures=(_table(T_base_world),),
        finger_friction=robot.finger_friction,
        finger_stiffness=robot.finger_stiffness,
    )


def _table(T_base_world: Array) -> SceneBody:
    T_world_table = np.eye(4)
    T_world_table[2, 3] = -HALF_SIZE[2]
    return SceneBody("table", _TABLE_HULLS, T_base_world @ T_world_table)
