"""Drive arms of Universal Robots with ``ur_rtde`` (extra ``ur``); not tested on an arm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gensim2.core.arrays import Array
from gensim2.core.errors import required
from gensim2.robots import RobotProfile
from gensim2_robot.devices import ArmMode
from gensim2_robot.drivers.streamed import DriverError, StreamedArm, finite

RATE = 500.0
"""Command rate of an e-Series, Hz; a CB3 has 125 Hz."""
LOOKAHEAD, GAIN = 0.05, 500.0
"""Parameters of the command ``servoJ``: lookahead time (s) and gain."""
DECELERATION = 4.0
"""Deceleration of the command ``servoStop``, m/s^2."""


class URArm(StreamedArm):
    """A UR arm in remote control.

    Args:
        host: address of the arm.
        grip: your function that moves the gripper to a command from -1 to 1, because RTDE cannot move it. None: no
            gripper.
        rate: command rate, Hz: 500 for an e-Series, 125 for a CB3.

    Raises:
        MissingExtraError: ``ur_rtde`` is not installed.
        DriverError: the connection fails.
    """

    def __init__(
        self, host: str, profile: RobotProfile, grip: Callable[[float], None] | None = None, rate: float = RATE
    ) -> None:
        rtde_control, rtde_receive = (
            required(f"rtde_{name}", "ur", "gensim2-robot", "ur_rtde") for name in ("control", "receive")
        )
        super().__init__(profile, rate)
        self._move_gripper = grip
        try:
            self._receive: Any = rtde_receive.RTDEReceiveInterface(host, rate)
            self._control: Any = rtde_control.RTDEControlInterface(host, rate)
        except RuntimeError as error:
            raise DriverError(f"{host}: {error}") from error
        self.start()

    def _read(self) -> tuple[Array, Array, float, ArmMode]:
        size = len(self.profile.arm_joints)
        q = finite(self._receive.getActualQ(), size, "where it stands")
        v = finite(self._receive.getActualQd(), size, "how it moves")
        force = float(np.linalg.norm(finite(self._receive.getActualTCPForce(), 3, "what presses on it")))
        stopped = self._receive.isProtectiveStopped() or self._receive.isEmergencyStopped()
        return q, v, force, "reflex" if stopped else "ready"

    def _write(self, q: Array, v: Array) -> None:
        if not self._control.servoJ(q.tolist(), 0.0, 0.0, self._period, LOOKAHEAD, GAIN):
            raise DriverError("the arm refused servoJ: check that it is in remote control and its program is running")

    def _halt(self) -> None:
        self._control.servoStop(DECELERATION)

    def _grip(self, command: float) -> None:
        if self._move_gripper is not None:
            self._move_gripper(command)

    def _disconnect(self) -> None:
        self._control.stopScript()
        self._control.disconnect()
        self._receive.disconnect()
