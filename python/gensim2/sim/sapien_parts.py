"""Give access to the robot and the objects of a SAPIEN scene that ManiSkill or the headless environment has built."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import sapien
from sapien import physx

from gensim2.core.arrays import Array
from gensim2.robots import RobotProfile
from gensim2.scenes.initial_state import PlacedObject
from gensim2.scenes.randomize import placed
from gensim2.sim.gripper import robot_joints
from gensim2.sim.objects import link_name
from gensim2.sim.parts import ArticulatedPart, Frame, RigidPart, Row
from gensim2.sim.physics import JointResistance
from gensim2.sim.scene_state import RobotReader


class SapienFrame:
    """Copy of an entity's pose at the instant at which it was read."""

    def __init__(self, pose: sapien.Pose) -> None:
        self._pose = pose

    def row(self) -> Row:
        return np.concatenate([self._pose.p, self._pose.q])

    def matrix(self) -> Array:
        return np.asarray(self._pose.to_transformation_matrix(), dtype=np.float64)


class SapienArticulatedPart(ArticulatedPart):
    """An articulated object in a SAPIEN scene.

    Args:
        name, thing, warnings: as for :class:`ArticulatedPart`.
        articulation: built articulation.
        resistance: resistance of the object's joint.
    """

    def __init__(
        self,
        name: str,
        thing: PlacedObject,
        articulation: physx.PhysxArticulation,
        resistance: JointResistance,
        warnings: tuple[str, ...] = (),
    ) -> None:
        parents = {
            link_name(link): None if link.parent is None else link_name(link.parent) for link in articulation.links
        }
        super().__init__(name, thing, parents, warnings)
        self.articulation = articulation
        self.before_substep = resistance.update
        self._links = {link_name(link): link for link in articulation.links}

    def put(self) -> None:
        self.articulation.qpos = np.array([self.thing.joint_value], dtype=np.float32)

    def nudge(self, dx: float, dy: float, dyaw: float) -> None:
        self.articulation.pose = _shifted(self.articulation.pose, dx, dy, dyaw)

    @property
    def qpos(self) -> Row:
        return np.asarray(self.articulation.qpos)

    @property
    def qvel(self) -> Row:
        return np.asarray(self.articulation.qvel)

    def frame(self, link: str) -> Frame:
        return SapienFrame(self._links[link].entity.pose)

    def state(self) -> Row:
        return articulation_state(self.articulation)

    @property
    def entities(self) -> list[sapien.Entity]:
        return [link.entity for link in self._links.values()]


class SapienRigidPart(RigidPart):
    """A rigid object in a SAPIEN scene.

    Args:
        name, thing: as for :class:`RigidPart`.
        entity: built entity.
    """

    def __init__(self, name: str, thing: PlacedObject, entity: sapien.Entity) -> None:
        super().__init__(name, thing)
        self.entity = entity
        self.body: physx.PhysxRigidDynamicComponent = entity.find_component_by_type(physx.PhysxRigidDynamicComponent)

    def put(self) -> None:
        """Do nothing, because the object was built at its initial pose."""

    def before_substep(self) -> None:
        """Do nothing, because only contacts and gravity act on a rigid object."""

    def nudge(self, dx: float, dy: float, dyaw: float) -> None:
        self.entity.pose = _shifted(self.entity.pose, dx, dy, dyaw)
        self.body.linear_velocity = self.body.angular_velocity = np.zeros(3, dtype=np.float32)
        self.body.wake_up()

    def frame(self) -> Frame:
        return SapienFrame(self.entity.pose)

    def velocities(self) -> tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]]:
        return self.body.linear_velocity, self.body.angular_velocity

    @property
    def mass(self) -> float:
        return float(self.body.mass)

    @property
    def friction(self) -> float:
        return float(self.body.collision_shapes[0].physical_material.dynamic_friction)

    @property
    def entities(self) -> list[sapien.Entity]:
        return [self.entity]


SapienPart = SapienArticulatedPart | SapienRigidPart


class SapienRobot(RobotReader):
    """Reader of a robot's state in a SAPIEN scene.

    Args:
        articulation: built articulation.
    """

    def __init__(self, profile: RobotProfile, articulation: physx.PhysxArticulation) -> None:
        super().__init__(profile)
        self.articulation = articulation
        self._hand = next(link for link in articulation.links if link_name(link) == profile.hand_link)
        self._joints = robot_joints(articulation, profile)

    @property
    def q(self) -> Array:
        return np.asarray(self.articulation.qpos, dtype=np.float64)

    @property
    def qvel(self) -> Array:
        return np.asarray(self.articulation.qvel, dtype=np.float64)

    def hand(self) -> Frame:
        return SapienFrame(self._hand.entity.pose)

    @property
    def finger_friction(self) -> float:
        finger = next(link for link in self.articulation.links if link_name(link) == self.profile.gripper.pads[0])
        return float(finger.collision_shapes[0].physical_material.dynamic_friction)

    @property
    def finger_stiffness(self) -> float:
        return float(self._joints[self.profile.gripper.fingers[0]].stiffness)


def articulation_state(articulation: physx.PhysxArticulation) -> Row:
    """Return ManiSkill's state (13 + 2 n,): root pose, root velocities, qpos, qvel."""
    root = articulation.root
    velocity = [root.linear_velocity, root.angular_velocity]
    pose = SapienFrame(root.entity.pose).row()
    return np.concatenate([pose, *velocity, articulation.qpos, articulation.qvel]).astype(np.float32)


def touched(
    system: physx.PhysxCpuSystem, robot: physx.PhysxArticulation, parts: Sequence[SapienPart]
) -> frozenset[str]:
    """Return the names of the objects that press on a link of the robot; contacts without a force do not count."""
    links = {link.entity for link in robot.links}
    owners = {entity: part.name for part in parts for entity in part.entities}
    found = set()
    for contact in system.get_contacts():
        first, second = (body.entity for body in contact.bodies)
        other = second if first in links else first if second in links else None
        if other in owners and any(np.any(point.impulse) for point in contact.points):
            found.add(owners[other])
    return frozenset(found)


def _shifted(pose: sapien.Pose, dx: float, dy: float, dyaw: float) -> sapien.Pose:
    return sapien.Pose(*placed(np.asarray(pose.p, np.float64), np.asarray(pose.q, np.float64), dx, dy, dyaw))
