"""Fakes of the arm makers' libraries: only the calls that the drivers make, and an arm that reaches every target at
once.

They do not imitate any other behaviour of the real libraries.
"""

from __future__ import annotations

import types
from typing import Any

import numpy as np


class FakeBody:
    """An arm that is always at its last target."""

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
    """Return fakes of ``rtde_control`` and ``rtde_receive``."""

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
    """Return a fake of ``xarm.wrapper``."""

    class XArmAPI:
        def __init__(self, host: str, is_radian: bool) -> None:
            if host == "nowhere":
                raise Exception("connect socket failed")

        def _fine(self, *_: Any, **__: Any) -> int:
            return 0

        motion_enable = set_mode = set_gripper_enable = _fine
        state = 4

        def set_state(self, state: int) -> int:
            self.state = state
            return body.halt() if state == 4 else 0

        def get_joint_states(self, is_radian: bool) -> tuple[int, list[list[float]]]:
            return 0, [body.q.tolist(), [0.0] * 7, [0.0] * 7]

        def set_servo_angle_j(self, q: list[float], is_radian: bool) -> int:
            return 0 if self.state != 4 and body.take(q) else 9

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
    """Return a fake of ``franky``."""
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
            if body.falls:  # the real one raises a motion's error once
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


def panda(body: FakeBody) -> dict[str, types.ModuleType]:
    """Return a fake of ``panda_py`` with its controllers and libfranka."""
    module: Any = types.ModuleType("panda_py")
    controllers: Any = types.ModuleType("panda_py.controllers")
    libfranka: Any = types.ModuleType("panda_py.libfranka")
    module.controllers, module.libfranka = controllers, libfranka
    libfranka.RealtimeConfig = types.SimpleNamespace(kEnforce=0, kIgnore=1)
    libfranka.RobotMode = types.SimpleNamespace(kOther=0, kIdle=1, kReflex=4, kUserStopped=5)

    class JointPosition:
        runs = rejected = False

        def __init__(self, stiffness: np.ndarray, damping: np.ndarray) -> None: ...

        def set_control(self, position: np.ndarray, velocity: np.ndarray) -> None:
            if self.runs:  # the real one ignores targets before the start
                self.rejected |= not body.take(position)

    class Panda:
        controller: Any = None

        def __init__(self, hostname: str, name: str = "panda", realtime_config: int = 1) -> None:
            if hostname == "nowhere":
                raise RuntimeError("libfranka: Connection error: Host not found")

        def get_robot(self) -> Any:
            def set_collision_behavior(*thresholds: list[float]) -> None:
                assert [len(each) for each in thresholds] == [7, 7, 6, 6]

            return types.SimpleNamespace(set_collision_behavior=set_collision_behavior)

        def get_state(self) -> Any:
            runs = self.controller is not None and self.controller.runs
            mode = 2 if runs else 4 if body.stopped else 1  # a failed controller counts as running until stopped
            force = [0.0, 0.0, body.force, 0.0, 0.0, 0.0]
            return types.SimpleNamespace(q=body.q.tolist(), dq=[0.0] * 7, O_F_ext_hat_K=force, robot_mode=mode)

        def start_controller(self, controller: Any) -> None:
            body.stopped = False  # recovers from any error
            self.controller, controller.runs = controller, True

        def stop_controller(self) -> None:
            body.halt()
            self.controller.runs = False

        def raise_error(self) -> None:  # raises a motion's error, once
            if body.falls:
                body.falls, body.stopped = False, True
                raise RuntimeError("libfranka: Move command aborted: motion aborted by reflex!")
            if self.controller is not None and self.controller.rejected:
                self.controller.rejected = False
                raise RuntimeError("libfranka: Move command rejected")

    class Gripper:
        def __init__(self, franka_address: str) -> None: ...

        def read_once(self) -> Any:
            return types.SimpleNamespace(max_width=0.08)

        def move(self, width: float, speed: float) -> bool:
            body.grips.append(2 * width / 0.08 - 1)
            return True

        def grasp(self, width: float, speed: float, force: float, epsilon_outer: float) -> bool:
            body.grips.append(-1.0)
            return True

    controllers.JointPosition, module.Panda, libfranka.Gripper = JointPosition, Panda, Gripper
    return {"panda_py": module, "panda_py.controllers": controllers, "panda_py.libfranka": libfranka}
