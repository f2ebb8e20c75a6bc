"""Fakes of makers' libraries: the calls that the drivers make, an arm that goes where it is sent, and no more.

What a real library does beside that, nothing here knows.
"""

from __future__ import annotations

import types
from typing import Any

import numpy as np


class FakeBody:
    """An arm that is where it was sent last."""

    def __init__(self, size: int) -> None:
        self.q = np.linspace(0.1, 0.2, size)
        self.sent: list[np.ndarray] = []
        self.grips: list[float] = []
        self.halts = 0
        self.force = 5.0
        self.stopped = self.refuses = self.falls = self.closed = False

    def take(self, q: Any) -> bool:
        if self.refuses:
            return False
        self.q = np.asarray(q, dtype=float)
        self.sent.append(self.q)
        return True

    def halt(self, *_: Any) -> int:
        self.halts += 1
        return 0


def ur(body: FakeBody) -> dict[str, types.ModuleType]:
    """``rtde_control`` and ``rtde_receive``."""

    class RTDEControlInterface:
        def __init__(self, host: str, rate: float) -> None:
            if host == "nowhere":
                raise RuntimeError("Failed to connect")

        def servoJ(self, q: list[float], speed: float, a: float, t: float, lookahead: float, gain: float) -> bool:
            return body.take(q)

        def servoStop(self, a: float) -> bool:
            return not body.halt()

        def stopScript(self) -> None:
            body.closed = True

        def disconnect(self) -> None: ...

    class RTDEReceiveInterface:
        def __init__(self, host: str, rate: float) -> None: ...

        def getActualQ(self) -> list[float]:
            return body.q.tolist()

        def getActualQd(self) -> list[float]:
            return [0.0] * len(body.q)

        def getActualTCPForce(self) -> list[float]:
            return [0.0, 0.0, body.force, 9.0, 9.0, 9.0]

        def isProtectiveStopped(self) -> bool:
            return body.stopped

        def isEmergencyStopped(self) -> bool:
            return False

        def disconnect(self) -> None: ...

    control, receive = types.ModuleType("rtde_control"), types.ModuleType("rtde_receive")
    control.RTDEControlInterface = RTDEControlInterface  # type: ignore[attr-defined]
    receive.RTDEReceiveInterface = RTDEReceiveInterface  # type: ignore[attr-defined]
    return {"rtde_control": control, "rtde_receive": receive}


def xarm(body: FakeBody) -> dict[str, types.ModuleType]:
    """``xarm.wrapper``."""

    class XArmAPI:
        def __init__(self, host: str, is_radian: bool) -> None:
            if host == "nowhere":
                raise Exception("connect socket failed")

        def _fine(self, *_: Any, **__: Any) -> int:
            return 0

        motion_enable = set_mode = set_gripper_enable = _fine

        def set_state(self, state: int) -> int:
            return body.halt() if state == 4 else 0

        def get_joint_states(self, is_radian: bool) -> tuple[int, list[list[float]]]:
            return 0, [body.q.tolist(), [0.0] * 7, [0.0] * 7]

        def set_servo_angle_j(self, q: list[float], is_radian: bool) -> int:
            return 0 if body.take(q) else 9

        def set_gripper_position(self, position: int, wait: bool) -> int:
            body.grips.append(2 * position / 850 - 1)
            return 0

        @property
        def has_error(self) -> bool:
            return body.stopped

        @property
        def ft_ext_force(self) -> list[float]:
            return [0.0, 0.0, body.force, 0.0, 0.0, 0.0]

        def disconnect(self) -> None:
            body.closed = True

    package, wrapper = types.ModuleType("xarm"), types.ModuleType("xarm.wrapper")
    wrapper.XArmAPI = XArmAPI  # type: ignore[attr-defined]
    return {"xarm": package, "xarm.wrapper": wrapper}


def franka(body: FakeBody) -> dict[str, types.ModuleType]:
    """``franky``."""
    module: Any = types.ModuleType("franky")
    for name in ("NetworkException", "IncompatibleVersionException", "RealtimeException", "ControlException"):
        setattr(module, name, type(name, (Exception,), {}))
    module.RealtimeConfig = types.SimpleNamespace(Enforce=1, Ignore=0)
    module.RobotMode = types.SimpleNamespace(Idle=0, Reflex=4, UserStopped=5)
    module.TorqueStopMotion = lambda: "stop"
    module.JointReference = lambda q, v: np.asarray(q)

    class JointImpedanceTrackingMotion:
        def __init__(self, stiffness: np.ndarray, damping: np.ndarray, max_delta_tau: float) -> None: ...

        def set_reference(self, reference: np.ndarray) -> None:
            self.reference = reference
            if not body.take(reference):
                raise module.ControlException("Move command rejected")

    class Robot:
        def __init__(self, host: str, **_: Any) -> None:
            if host == "nowhere":
                raise module.NetworkException("connection refused")

        @property
        def state(self) -> Any:
            mode = 4 if body.stopped else 0
            force = [0.0, 0.0, body.force, 0.0, 0.0, 0.0]
            return types.SimpleNamespace(q=body.q, dq=np.zeros(7), O_F_ext_hat_K=force, robot_mode=mode)

        def move(self, motion: Any, asynchronous: bool, cutoff_frequency: float = 100.0) -> None:
            if motion == "stop":
                body.halt()

        def poll_motion(self) -> bool:
            if body.falls:  # the real one raises once what ended a motion; False: it goes on
                body.falls, body.stopped = False, True
                raise module.ControlException("motion aborted by reflex!")
            return False

    class Gripper:
        max_width = 0.08

        def __init__(self, host: str) -> None: ...

        def move(self, width: float, speed: float) -> bool:
            body.grips.append(2 * width / self.max_width - 1)
            return True

        def grasp(self, width: float, speed: float, force: float, epsilon_outer: float) -> bool:
            body.grips.append(-1.0)
            return True

    module.JointImpedanceTrackingMotion, module.Robot, module.Gripper = JointImpedanceTrackingMotion, Robot, Gripper
    return {"franky": module}
