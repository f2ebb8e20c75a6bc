"""Simulate a scene of the headless environment in MuJoCo."""

from __future__ import annotations

import hashlib
from functools import cached_property

import mujoco
import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.core.errors import GenSim2Error, InputError
from gensim2.objects import RigidObject
from gensim2.robots import OPEN, RobotProfile
from gensim2.scenes.initial_state import InitialState
from gensim2.sim.engines import checked_command
from gensim2.sim.mujoco.description import links_of, never_touching
from gensim2.sim.mujoco.model import build_model, mixed_name, steps_of
from gensim2.sim.mujoco.parts import MujocoArticulatedPart, MujocoRigidPart, MujocoRobot, Simulation
from gensim2.sim.parts import Row

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class MujocoScene:
    """A scene in MuJoCo; see :class:`~gensim2.sim.engines.EngineScene`."""

    def __init__(self, profile: RobotProfile, physics: str, setup: InitialState, robot: bool) -> None:
        self._profile, self._steps = profile, steps_of(profile)
        self.simulation = simulation = Simulation(build_model(profile, setup, robot))
        self.parts: dict[str, MujocoArticulatedPart | MujocoRigidPart] = {}
        for name, thing in setup.objects.items():
            if isinstance(thing.model, RigidObject):
                self.parts[name] = MujocoRigidPart(name, thing, simulation)
            else:
                parents = {link.name: link.parent for link in links_of(thing.model.urdf, thing.model.content_hash)}
                self.parts[name] = MujocoArticulatedPart(name, thing, simulation, parents)
        self.robot = MujocoRobot(profile, simulation) if robot else None
        for part in self.parts.values():
            part.put()
        self._owners = self._geom_owners()
        if self.robot is not None:
            self.robot.put(setup.start)
            self._take_drives()
            self.drive(np.array([*setup.start[: profile.arm_size], OPEN]))
        self._first = self._state()

    @staticmethod
    def prepare(profile: RobotProfile, physics: str) -> None:
        links_of(profile.urdf)
        never_touching(profile.srdf)

    def _take_drives(self) -> None:
        """Find the actuators for the arm joints, for the gripper's motors, and for the joints that follow a motor."""
        profile, model = self._profile, self.simulation.model

        def drive(joint: str) -> int:
            name = mixed_name(profile.agent, joint)
            return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name))

        self._arm = [drive(name) for name in profile.arm_joints]
        self._motors = [drive(name) for name in profile.gripper.driven]
        self._follow = [
            (drive(name), self.simulation.joint(mixed_name(profile.agent, mimic.joint))[0], mimic)
            for name, mimic in profile.gripper.mimics.items()
        ]

    def _geom_owners(self) -> npt.NDArray[np.int64]:
        """Return the owner of each geom (G,): an index in ``parts``, -1 for the robot, or -2 for the table."""
        model, numbers = self.simulation.model, {name: number for number, name in enumerate(self.parts)}
        numbers[self._profile.agent], numbers["table"] = -1, -2
        names = (mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, int(body)) for body in model.geom_bodyid)
        return np.array([numbers[name.partition("/")[0]] for name in names], dtype=np.int64)

    def drive(self, action: npt.ArrayLike) -> None:
        self._require_robot()
        command, size = checked_command(action, self._profile.action_size), self._profile.arm_size
        targets = self.simulation.raw.ctrl
        targets[self._arm] = command[:size]
        targets[self._motors] = self._profile.gripper.target(command[size:])

    def _require_robot(self) -> None:
        if self.robot is None:
            raise GenSim2Error("the scene was built without the robot")

    def step(self) -> None:
        if self.robot is None or not self._follow:
            self.simulation.step(self._steps)
            return
        data = self.simulation.raw
        for _ in range(self._steps):
            for drive, leader, mimic in self._follow:
                data.ctrl[drive] = mimic.multiplier * data.qpos[leader] + mimic.offset
            self.simulation.step(1)

    def touched(self) -> frozenset[str]:
        names = list(self.parts)
        return frozenset(names[other] for _, one, other in self._robot_contacts() if other >= 0)

    def pressing_force(self) -> float:
        data, total, wrench = self.simulation.raw, np.zeros(3), np.zeros(6)
        for number, sign, _ in self._robot_contacts():
            mujoco.mj_contactForce(self.simulation.model, data, number, wrench)
            total += sign * data.contact.frame[number].reshape(3, 3).T @ wrench[:3]
        return float(np.linalg.norm(total))

    def _robot_contacts(self) -> list[tuple[int, float, int]]:
        """Return index, sign of the force on the robot (1 if it is the second shape, else -1) and other owner."""
        self._require_robot()
        data = self.simulation.raw
        contacts, owners = data.contact, self._owners
        found = []
        for number in range(data.ncon):
            address = int(contacts.efc_address[number])
            first, second = (int(owners[geom]) for geom in contacts.geom[number])
            if (first == -1) == (second == -1) or address < 0 or data.efc_force[address] <= 0.0:
                continue
            found.append((number, 1.0, first) if second == -1 else (number, -1.0, second))
        return found

    def robot_state(self) -> Row:
        self._require_robot()
        assert self.robot is not None
        profile = self._profile
        root = [*profile.base_position, *profile.base_quaternion, *[0.0] * 6]
        return np.concatenate([root, self.robot.q, self.robot.qvel]).astype(np.float32)

    def _state(self) -> Array:
        """Return the full state. A simulation that continues from it has bit-identical results."""
        model = self.simulation.model
        state = np.empty(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, self.simulation.raw, state, _STATE)
        return state

    @cached_property
    def _digest(self) -> str:
        """Return a hash of the MuJoCo model and of the simulation state right after the scene was built."""
        model = self.simulation.model
        content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, content)
        return hashlib.sha256(content.tobytes() + self._first.tobytes()).hexdigest()

    def snapshot(self) -> tuple[Array, str]:
        return self._state(), self._digest

    def restore(self, state: Array, scene: str) -> None:
        """Set the simulation to a state that :meth:`snapshot` returned.

        Args:
            state: simulation state from :meth:`snapshot`.
            scene: hash of the scene from the same call.

        Raises:
            InputError: the state has the wrong shape, or belongs to another scene.
        """
        size = mujoco.mj_stateSize(self.simulation.model, _STATE)
        if np.shape(state) != (size,):
            raise InputError(f"has the shape {np.shape(state)}, not ({size},)", field="snapshot.physics")
        if scene != self._digest:
            remedy = "reset the environment with the task, objects, options and seed of the snapshot"
            raise InputError("the snapshot belongs to another scene", field="snapshot.scene", remedy=remedy)
        mujoco.mj_setState(self.simulation.model, self.simulation.raw, np.asarray(state, dtype=np.float64), _STATE)
        self.simulation.changed()
