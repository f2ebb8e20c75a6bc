"""Access the robot and the objects of a MuJoCo scene."""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.objects.types import ArticulatedObject
from gensim2.robots import RobotProfile
from gensim2.scenes.initial_state import PlacedObject
from gensim2.scenes.randomize import placed
from gensim2.sim.mujoco.model import mixed_name, surface_friction
from gensim2.sim.parts import ArticulatedPart, Frame, RigidPart, Row
from gensim2.sim.scene_state import RobotReader


class Simulation:
    """A compiled MuJoCo model and its state.

    After ``mj_step`` the joints are new, but the bodies still have the poses of the step before. Reading :attr:`data`
    updates them.

    Args:
        model: compiled model.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.raw = mujoco.MjData(model)
        self._is_stale = True

    def step(self, count: int) -> None:
        mujoco.mj_step(self.model, self.raw, count)
        self._is_stale = True

    def changed(self) -> None:
        """Mark the joint state as changed, so that the next access to :attr:`data` computes the poses again."""
        self._is_stale = True

    @property
    def data(self) -> mujoco.MjData:
        """The state, with up-to-date poses and velocities of all bodies."""
        if self._is_stale:
            mujoco.mj_kinematics(self.model, self.raw)
            mujoco.mj_comPos(self.model, self.raw)
            mujoco.mj_comVel(self.model, self.raw)
            self._is_stale = False
        return self.raw

    def joint(self, name: str) -> tuple[int, int]:
        """Return the index of the first value of a joint in MuJoCo's ``qpos``, and its index in the velocities."""
        number = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, name)
        return int(self.model.jnt_qposadr[number]), int(self.model.jnt_dofadr[number])

    def body(self, name: str) -> int:
        return int(mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name))

    def frame(self, body: int) -> MujocoFrame:
        """Return the pose of a body at this instant."""
        return MujocoFrame(self.data, body)


class MujocoFrame:
    """Copy of a body's pose at one instant; the copy does not change when the simulation continues."""

    def __init__(self, data: mujoco.MjData, body: int) -> None:
        self._position, self._quaternion = data.xpos[body].copy(), data.xquat[body].copy()
        self._rotation = data.xmat[body].reshape(3, 3).copy()

    def row(self) -> Row:
        return np.concatenate([self._position, self._quaternion]).astype(np.float32)

    def matrix(self) -> Array:
        found = np.eye(4)
        found[:3, :3], found[:3, 3] = self._rotation, self._position
        return found


class MujocoArticulatedPart(ArticulatedPart):
    """An articulated object in a MuJoCo scene.

    The object's root link is a mocap body of MuJoCo. Forces do not move such a body, but a program can set its pose.

    Args:
        name, thing: as for :class:`ArticulatedPart`.
        simulation: simulation that contains the object.
        parents: mapping from the name of each link to the name of its parent link, which is None for the root link.
    """

    def __init__(self, name: str, thing: PlacedObject, simulation: Simulation, parents: dict[str, str | None]) -> None:
        super().__init__(name, thing, parents)
        assert isinstance(thing.model, ArticulatedObject)
        self._simulation = simulation
        self._bodies = {link: simulation.body(mixed_name(name, link)) for link in parents}
        self._q, self._v = simulation.joint(mixed_name(name, thing.model.joint.name))
        self._mocap = int(simulation.model.body_mocapid[self._bodies[self._root]])

    def put(self) -> None:
        self._simulation.raw.qpos[self._q] = self.thing.joint_value
        self._simulation.changed()

    def nudge(self, dx: float, dy: float, dyaw: float) -> None:
        data, which = self._simulation.raw, self._mocap
        data.mocap_pos[which], data.mocap_quat[which] = placed(
            data.mocap_pos[which].copy(), data.mocap_quat[which].copy(), dx, dy, dyaw
        )
        self._simulation.changed()

    @property
    def qpos(self) -> Row:
        return np.asarray(self._simulation.raw.qpos[self._q : self._q + 1], dtype=np.float32)

    @property
    def qvel(self) -> Row:
        return np.asarray(self._simulation.raw.qvel[self._v : self._v + 1], dtype=np.float32)

    def frame(self, link: str) -> Frame:
        return self._simulation.frame(self._bodies[link])

    def state(self) -> Row:
        return np.concatenate([self.frame(self._root).row(), np.zeros(6), self.qpos, self.qvel]).astype(np.float32)


class MujocoRigidPart(RigidPart):
    """A rigid object in a MuJoCo scene.

    Args:
        name, thing: as for :class:`RigidPart`.
        simulation: simulation that contains the object.
    """

    def __init__(self, name: str, thing: PlacedObject, simulation: Simulation) -> None:
        super().__init__(name, thing)
        self._simulation = simulation
        self._body = simulation.body(name)
        self._q, self._v = simulation.joint(name)

    def put(self) -> None:
        self._stand(self.thing.position, self.thing.quaternion)

    def nudge(self, dx: float, dy: float, dyaw: float) -> None:
        pose = self._simulation.raw.qpos[self._q : self._q + 7].copy()
        self._stand(*placed(pose[:3], pose[3:], dx, dy, dyaw))

    def _stand(self, position: Array, quaternion: Array) -> None:
        """Set the pose of the body, and set its velocity to zero."""
        data = self._simulation.raw
        data.qpos[self._q : self._q + 3], data.qpos[self._q + 3 : self._q + 7] = position, quaternion
        data.qvel[self._v : self._v + 6] = 0.0
        self._simulation.changed()

    def frame(self) -> Frame:
        return self._simulation.frame(self._body)

    def velocities(self) -> tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]]:
        # mj_objectVelocity fills this array with the angular velocity (3,) and the velocity (3,) of the centre of mass.
        found = np.zeros(6)
        simulation = self._simulation
        mujoco.mj_objectVelocity(simulation.model, simulation.data, mujoco.mjtObj.mjOBJ_BODY, self._body, found, 0)
        return found[3:], found[:3]

    @property
    def mass(self) -> float:
        return float(self._simulation.model.body_mass[self._body])

    @property
    def friction(self) -> float:
        return surface_friction(self.thing)


class MujocoRobot(RobotReader):
    """Reader of a robot's state in a MuJoCo scene.

    Args:
        simulation: simulation that contains the robot.
    """

    def __init__(self, profile: RobotProfile, simulation: Simulation) -> None:
        super().__init__(profile)
        self._simulation = simulation
        names = (*profile.arm_joints, *profile.gripper.joints)
        places = [simulation.joint(mixed_name(profile.agent, name)) for name in names]
        self._q, self._v = (np.array(column) for column in zip(*places, strict=True))
        self._hand = simulation.body(mixed_name(profile.agent, profile.hand_link))

    def put(self, start: npt.ArrayLike) -> None:
        self._simulation.raw.qpos[self._q] = start
        self._simulation.changed()

    @property
    def q(self) -> Array:
        return np.asarray(self._simulation.raw.qpos[self._q])

    @property
    def qvel(self) -> Array:
        return np.asarray(self._simulation.raw.qvel[self._v])

    def hand(self) -> Frame:
        return self._simulation.frame(self._hand)

    @property
    def finger_friction(self) -> float:
        return self.profile.gripper.friction

    @property
    def finger_stiffness(self) -> float:
        return self.profile.finger_drive.stiffness
