"""Drive Franka arms with franky-control or panda-python."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from gensim2.core.arrays import Array
from gensim2.core.errors import MissingExtraError, required
from gensim2.robots import RobotProfile
from gensim2_robot.devices import ArmMode
from gensim2_robot.drivers.streamed import DriverError, StreamedArm, finite

RATE = 200.0
"""Number of commanded positions per second; the arm's 1 kHz loop keeps each position until the next arrives."""
STIFFNESS = np.array([600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0])
"""Joint stiffness, N m/rad."""
CUTOFF = 100.0
"""Cut-off frequency of libfranka's low-pass filter of the torques, Hz."""
DELTA = 2.4
"""Maximum change of the requested torque in a cycle, N m. The low-pass filter passes 0.386 of each change. So the
torque changes by at most 0.93 N m in a cycle; at 1 N m the arm's reflex would stop the arm. With the library's default
of 1 N m only 0.39 N m would remain, and the arm would lag behind its commands and then overshoot.
"""
TORQUES, FORCES = 20.0, 30.0
"""Torques (N m) and forces (N) at which the arm's own reflex stops the arm."""
GRIP_SPEED, GRIP_FORCE = 0.05, 30.0
"""Speed (m/s) and force (N) with which the hand closes and opens."""


class _FrankaHand(StreamedArm):
    """Base class of the Franka drivers. The class drives the hand, whose interface is the same in both libraries.

    Attributes:
        hand: gripper object of the library; None without a hand.
        width: maximum distance between the fingers, m.
    """

    hand: Any = None
    width = 0.0

    def _grip(self, command: float) -> None:
        if self.hand is None:
            return
        if command < 0.0:
            self.hand.grasp(0.0, GRIP_SPEED, GRIP_FORCE, epsilon_outer=1.0)
        else:
            self.hand.move(0.5 * (command + 1.0) * self.width, GRIP_SPEED)

    def _measured(self, state: Any, ended: Exception | None, stopped: bool) -> tuple[Array, Array, float, ArmMode]:
        """Return positions and velocities (7,), the external force (N) and the mode from a state of libfranka.

        Args:
            state: libfranka state.
            ended: exception with which the motion has ended; None if the motion continues.
            stopped: whether the arm's own safety has stopped it. An exception is then expected, and the mode says so.

        Raises:
            DriverError: the motion has ended with an exception, and ``stopped`` is False.
        """
        if ended is not None and not stopped:
            raise DriverError(f"the arm stopped the motion with an error: {ended}") from ended
        force = float(np.linalg.norm(finite(state.O_F_ext_hat_K, 3, "what presses on it")))
        q, v = finite(state.q, 7, "where it stands"), finite(state.dq, 7, "how it moves")
        return q, v, force, "reflex" if stopped else "ready"


class FrankaArm(_FrankaHand):
    """Driver for a Panda or FR3 with ``franky``. Its joint impedance controller follows the streamed positions.

    Each wheel of ``franky-control`` supports one version of the arm's server. The wheel on PyPI is for an FR3 with
    system 5.9 or newer. A Panda needs the wheel for server version 5 from the releases page of ``franky``.

    Args:
        host: address of the arm.
        gripper: whether the arm has Franka's hand.
        enforce_realtime: whether to require a kernel with real-time scheduling.

    Raises:
        MissingExtraError: ``franky-control`` is not installed.
        DriverError: the connection fails, or the arm's server has a different version.
    """

    def __init__(self, host: str, profile: RobotProfile, gripper: bool = True, enforce_realtime: bool = True) -> None:
        franky = required("franky", "franka", "gensim2-robot", "franky-control")
        super().__init__(profile, RATE)
        self._franky: Any = franky
        config = franky.RealtimeConfig.Enforce if enforce_realtime else franky.RealtimeConfig.Ignore
        try:
            self._robot: Any = franky.Robot(
                host, default_torque_threshold=TORQUES, default_force_threshold=FORCES, realtime_config=config
            )
            if gripper:
                self.hand = franky.Gripper(host)
                self.width = self.hand.max_width
        except (franky.NetworkException, franky.IncompatibleVersionException, franky.RealtimeException) as error:
            raise DriverError(f"{host}: {error}") from error
        self._motion: Any = None
        self.start()

    def _read(self) -> tuple[Array, Array, float, ArmMode]:
        ended: Exception | None = None
        if self._motion is not None:
            try:
                self._robot.poll_motion()  # If the motion has failed, the next call of poll_motion raises the error.
            except self._franky.ControlException as error:
                ended = error
        # Read the state after the error, so that it shows a stop by the arm's safety function.
        state = self._robot.state
        stopped = state.robot_mode in (self._franky.RobotMode.Reflex, self._franky.RobotMode.UserStopped)
        return self._measured(state, ended, stopped)

    def _write(self, q: Array, v: Array) -> None:
        if self._motion is None:
            motion = self._franky.JointImpedanceTrackingMotion(
                stiffness=STIFFNESS, damping=2.0 * np.sqrt(STIFFNESS), max_delta_tau=DELTA
            )
            motion.set_reference(self._franky.JointReference(q, v))
            self._robot.move(motion, asynchronous=True, cutoff_frequency=CUTOFF)
            self._motion = motion
        else:
            self._motion.set_reference(self._franky.JointReference(q, v))

    def _halt(self) -> None:
        if self._motion is not None:
            self._motion = None
            # The stop motion replaces the running motion; stop() would end the running motion with an exception.
            self._robot.move(self._franky.TorqueStopMotion(), asynchronous=True)

    def _disconnect(self) -> None:
        self._motion = None


class PandaPyArm(_FrankaHand):
    """Driver for a Panda or FR3 with ``panda-python``. Its impedance controller follows the streamed positions.

    A wheel of ``panda-python`` supports only one server version, and the wheel on PyPI supports the newest. An error
    names other wheels.

    Args:
        host: address of the arm.
        gripper: whether the arm has Franka's hand.
        enforce_realtime: whether to require a kernel with real-time scheduling.

    Raises:
        MissingExtraError: ``panda-python`` is not installed.
        DriverError: the connection fails, or the arm's server has a different version.
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
        try:
            self._panda: Any = panda_py.Panda(host, realtime_config=config)
            torques, forces = [TORQUES] * 7, [FORCES] * 6
            self._panda.get_robot().set_collision_behavior(torques, torques, forces, forces)
            if gripper:
                self.hand = libfranka.Gripper(host)
                self.width = self.hand.read_once().max_width
        except RuntimeError as error:  # any libfranka error
            raise DriverError(f"{host}: {error}") from error
        self._controller: Any = None
        # A thread of the library reads the state between motions. The lock keeps ``_halt`` from interfering.
        self._reading = threading.Lock()
        self.start()

    def _read(self) -> tuple[Array, Array, float, ArmMode]:
        ended: Exception | None = None
        with self._reading:
            try:
                self._panda.raise_error()  # raise_error raises the error of a failed motion only once.
            except RuntimeError as error:
                ended = error
                # While a controller runs, get_state only repeats the last state, so the controller is stopped first.
                self._panda.stop_controller()
            # Read the state after the stop, so that it shows a stop by the arm's safety function.
            state = self._panda.get_state()
        stopped = state.robot_mode in self._stopped
        return self._measured(state, ended, stopped)

    def _write(self, q: Array, v: Array) -> None:
        if self._controller is None:
            if self._panda.get_state().robot_mode in self._stopped:
                # Refuse, because the library would recover the arm by itself, which only a person may do.
                raise DriverError("the arm's own safety function has stopped the arm; a person must recover the arm")
            controller = self._controllers.JointPosition(stiffness=STIFFNESS, damping=2.0 * np.sqrt(STIFFNESS))
            self._panda.start_controller(controller)  # the controller starts from the arm's current position
            self._controller = controller
        self._controller.set_control(q, v)

    def _halt(self) -> None:
        if self._controller is not None:
            self._controller = None
            with self._reading:
                self._panda.stop_controller()

    def _disconnect(self) -> None:
        self._controller = None
