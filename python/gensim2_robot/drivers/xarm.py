"""Drive arms of UFACTORY with ``xarm-python-sdk`` (extra ``xarm``); not tested on an arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from gensim2.core.arrays import Array
from gensim2.core.errors import required
from gensim2.robots import RobotProfile
from gensim2_robot.devices import ArmMode
from gensim2_robot.drivers.streamed import DriverError, StreamedArm, finite

RATE = 100.0
"""Command rate, Hz; the SDK's servo mode accepts up to 250."""
SERVO, READY, STOP = 1, 0, 4
"""Number of the SDK's mode for streamed joint positions, and numbers of its states "ready" and "stop"."""
WIDEST = 850
"""Gripper position that is fully open, in the SDK's unit."""


class XArm(StreamedArm):
    """An xArm of UFACTORY.

    Args:
        host: address of the arm.
        gripper: whether the arm has the manufacturer's gripper.
        sensor: whether the arm has a force sensor. Without one the force is 0, and only the arm's own detection stops
            it.

    Raises:
        MissingExtraError: ``xarm-python-sdk`` is not installed.
        DriverError: the connection fails, or the arm reports an error.
    """

    def __init__(self, host: str, profile: RobotProfile, gripper: bool = True, sensor: bool = False) -> None:
        wrapper = required("xarm.wrapper", "xarm", "gensim2-robot", "xarm-python-sdk")
        super().__init__(profile, RATE)
        self._has_gripper, self._has_sensor, self._halted = gripper, sensor, False
        try:
            self._arm: Any = wrapper.XArmAPI(host, is_radian=True)
        except Exception as error:  # the SDK raises bare Exceptions
            raise DriverError(f"{host}: {error}") from error
        self._require(self._arm.motion_enable(True), "motion_enable")
        self._require(self._arm.set_mode(SERVO), "set_mode")
        self._require(self._arm.set_state(READY), "set_state")
        if gripper:
            self._require(self._arm.set_gripper_enable(True), "set_gripper_enable")
        self.start()

    def _read(self) -> tuple[Array, Array, float, ArmMode]:
        size = len(self.profile.arm_joints)
        code, values = self._arm.get_joint_states(is_radian=True)
        self._require(code, "get_joint_states")
        force = 0.0
        if self._has_sensor:
            force = float(np.linalg.norm(finite(self._arm.ft_ext_force, 3, "what presses on it")))
        mode: ArmMode = "reflex" if self._arm.has_error else "ready"
        return finite(values[0], size, "where it stands"), finite(values[1], size, "how it moves"), force, mode

    def _write(self, q: Array, v: Array) -> None:
        if self._halted:  # the SDK accepts no targets while halted
            self._require(self._arm.set_mode(SERVO), "set_mode")
            self._require(self._arm.set_state(READY), "set_state")
            self._halted = False
        self._require(self._arm.set_servo_angle_j(q.tolist(), is_radian=True), "set_servo_angle_j")

    def _halt(self) -> None:
        self._halted = True
        self._require(self._arm.set_state(STOP), "set_state")

    def _grip(self, command: float) -> None:
        if self._has_gripper:
            position = round(0.5 * (command + 1.0) * WIDEST)
            self._require(self._arm.set_gripper_position(position, wait=True), "set_gripper_position")

    def _disconnect(self) -> None:
        self._arm.disconnect()

    def _require(self, code: Any, what: str) -> None:
        if code != 0:
            raise DriverError(f"{what}: the arm reported error {code}")
