"""Arms of Franka, by ``panda-python`` (extra ``panda``), whose thread speaks the FCI at 1 kHz.

Never tried on an arm.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from gensim2.core.errors import MissingExtraError
from gensim2.robots import RobotProfile
from gensim2_robot.arm_limits import Array
from gensim2_robot.devices import ArmMode
from gensim2_robot.drivers.franka import FORCES, GRIP_FORCE, GRIP_SPEED, RATE, STIFFNESS, TORQUES
from gensim2_robot.drivers.streamed import DriverError, StreamedArm, finite


class PandaPyArm(StreamedArm):
    """A Panda or an FR3 with its hand: the library's joint impedance about the streamed positions.

    A wheel of ``panda-python`` speaks one version of the arm's server: the one on PyPI the newest; those of others come
    from the project's releases, and the error of a wrong one names the right one.

    Args:
        host: its address.
        profile: of the robot.
        gripper: whether it has the hand.
        enforce_realtime: whether to refuse a kernel without real time.

    Raises:
        MissingExtraError: ``panda-python`` is not installed.
        DriverError: the arm cannot be connected to, or its server speaks another version.
    """

    def __init__(self, host: str, profile: RobotProfile, gripper: bool = True, enforce_realtime: bool = True) -> None:
        try:
            import panda_py
            from panda_py import controllers, libfranka
        except ImportError as error:
            raise MissingExtraError("panda-python", "panda", "gensim2-robot") from error
        super().__init__(profile, RATE)
        self._controllers: Any = controllers
        self._stopped = (libfranka.RobotMode.kReflex, libfranka.RobotMode.kUserStopped)
        config = libfranka.RealtimeConfig.kEnforce if enforce_realtime else libfranka.RealtimeConfig.kIgnore
        self._hand: Any = None
        try:
            self._panda: Any = panda_py.Panda(host, realtime_config=config)
            torques, forces = [TORQUES] * 7, [FORCES] * 6
            self._panda.get_robot().set_collision_behavior(torques, torques, forces, forces)
            if gripper:
                self._hand = libfranka.Gripper(host)
                self._width: float = self._hand.read_once().max_width
        except RuntimeError as error:  # whatever libfranka has to say
            raise DriverError(f"{host}: {error}") from error
        self._controller: Any = None
        # Between two motions the library reads a state itself, which must not be while one comes to its end.
        self._reading = threading.Lock()
        self.start()

    def _read(self) -> tuple[Array, Array, float, ArmMode]:
        ended: Exception | None = None
        with self._reading:
            try:
                self._panda.raise_error()  # what ended the motion, once
            except RuntimeError as error:
                ended = error
                self._panda.stop_controller()  # which it takes for running yet: it would give the last state for ever
            state = self._panda.get_state()  # afterwards, so that it knows of the reflex that ended the motion
        stopped = state.robot_mode in self._stopped
        if ended is not None and not stopped:
            raise DriverError(f"the motion has ended: {ended}") from ended
        force = float(np.linalg.norm(finite(state.O_F_ext_hat_K, 3, "what presses on it")))
        q, v = finite(state.q, 7, "where it stands"), finite(state.dq, 7, "how it moves")
        return q, v, force, "reflex" if stopped else "ready"

    def _write(self, q: Array, v: Array) -> None:
        if self._controller is None:
            if self._panda.get_state().robot_mode in self._stopped:
                # The library would recover by itself, which is for a person to do.
                raise DriverError("it has stopped by itself: recover it by hand")
            controller = self._controllers.JointPosition(stiffness=STIFFNESS, damping=2.0 * np.sqrt(STIFFNESS))
            self._panda.start_controller(controller)  # which begins where the arm stands
            self._controller = controller
        self._controller.set_control(q, v)

    def _halt(self) -> None:
        if self._controller is not None:
            self._controller = None
            with self._reading:
                self._panda.stop_controller()

    def _grip(self, command: float) -> None:
        if self._hand is None:
            return
        if command < 0.0:
            self._hand.grasp(0.0, GRIP_SPEED, GRIP_FORCE, epsilon_outer=1.0)
        else:
            self._hand.move(0.5 * (command + 1.0) * self._width, GRIP_SPEED)

    def _disconnect(self) -> None:
        self._controller = None
