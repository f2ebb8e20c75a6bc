"""Arms of Franka, by ``franky-control`` (extra ``franka``), whose thread speaks the FCI at 1 kHz.

Never tried on an arm.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gensim2.core.errors import MissingExtraError
from gensim2.robots import RobotProfile
from gensim2_robot.arm_limits import Array
from gensim2_robot.devices import ArmMode
from gensim2_robot.drivers.streamed import DriverError, StreamedArm, finite

RATE = 200.0
"""References a second; between them the 1 kHz loop keeps the last."""
STIFFNESS = np.array([600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0])
"""N m/rad."""
CUTOFF = 100.0
"""Hz, libfranka's own low-pass of the torques."""
DELTA = 2.4
"""N m by which the torque that is asked for may differ from the last one that went out, before the low-pass, which lets
0.386 of it through in a cycle: 0.93 N m go out, and the arm's reflex stops it at 1. The library's own 1 N m would leave
0.39, at which the arm trails its references and then overshoots them."""
TORQUES, FORCES = 20.0, 30.0
"""N m and N from which on the arm's own reflex stops it."""
GRIP_SPEED, GRIP_FORCE = 0.05, 30.0
"""m/s and N of the hand."""


class FrankaArm(StreamedArm):
    """A Panda or an FR3 with its hand: joint impedance about the streamed positions.

    A wheel of ``franky-control`` speaks one version of the arm's server: the one on PyPI that of an FR3 with system 5.9
    and newer; a Panda takes the wheel for server version 5, from the project's releases.

    Args:
        host: its address.
        profile: of the robot.
        gripper: whether it has the hand.
        enforce_realtime: whether to refuse a kernel without real time.

    Raises:
        MissingExtraError: ``franky-control`` is not installed.
        DriverError: the arm cannot be connected to, or its server speaks another version.
    """

    def __init__(self, host: str, profile: RobotProfile, gripper: bool = True, enforce_realtime: bool = True) -> None:
        try:
            import franky
        except ImportError as error:
            raise MissingExtraError("franky-control", "franka", "gensim2-robot") from error
        super().__init__(profile, RATE)
        self._franky: Any = franky
        config = franky.RealtimeConfig.Enforce if enforce_realtime else franky.RealtimeConfig.Ignore
        try:
            self._robot: Any = franky.Robot(
                host, default_torque_threshold=TORQUES, default_force_threshold=FORCES, realtime_config=config
            )
            self._hand: Any = franky.Gripper(host) if gripper else None
        except (franky.NetworkException, franky.IncompatibleVersionException, franky.RealtimeException) as error:
            raise DriverError(f"{host}: {error}") from error
        self._motion: Any = None
        self.start()

    def _read(self) -> tuple[Array, Array, float, ArmMode]:
        ended: Exception | None = None
        if self._motion is not None:
            try:
                self._robot.poll_motion()  # raises what ended the motion, once
            except self._franky.ControlException as error:
                ended = error
        state = self._robot.state  # afterwards, so that it knows of the reflex that ended the motion
        stopped = state.robot_mode in (self._franky.RobotMode.Reflex, self._franky.RobotMode.UserStopped)
        if ended is not None and not stopped:
            raise DriverError(f"the motion has ended: {ended}") from ended
        force = float(np.linalg.norm(finite(state.O_F_ext_hat_K, 3, "what presses on it")))
        q, v = finite(state.q, 7, "where it stands"), finite(state.dq, 7, "how it moves")
        return q, v, force, "reflex" if stopped else "ready"

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
            # Takes the place of what runs, where stop() would end it with an exception.
            self._robot.move(self._franky.TorqueStopMotion(), asynchronous=True)

    def _grip(self, command: float) -> None:
        if self._hand is None:
            return
        if command < 0.0:
            self._hand.grasp(0.0, GRIP_SPEED, GRIP_FORCE, epsilon_outer=1.0)
        else:
            self._hand.move(0.5 * (command + 1.0) * self._hand.max_width, GRIP_SPEED)

    def _disconnect(self) -> None:
        self._motion = None
