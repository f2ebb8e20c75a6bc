"""Serve the FCI, Franka's control interface, at 1 kHz for an arm in SAPIEN, with the safety reflexes of a real arm.

The implementation of the protocol is ``franky-sim``. The server accepts only torque commands. A cycle is one
millisecond of simulated time and takes at least as much wall time. The next cycle begins when the client has answered
the last state, or after a timeout, so the simulated time stands still while the machine is busy. A state without an
answer counts as a lost packet, as on a real arm.
"""

from __future__ import annotations

import os
import time
from collections import deque
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import numpy.typing as npt
from franka_arm import STEP, Reflex, TorqueArm
from franky_sim import BaseRobot, FrankaRobotServer, LocalHostnames
from franky_sim.base_simulator import InnerRobotState
from franky_sim.franka_robot_protocol import (
    MoveCommandControllerMode,
    MoveCommandMotionGeneratorMode,
    MoveStatus,
    RobotCommand,
    RobotMode,
)
from franky_sim.franka_robot_state import FrankaRobotState
from franky_sim.franka_server import BaseCommand

ERRORS = {
    "joint_position_limits_violation": 0,
    "joint_velocity_violation": 3,
    "communication_constraints_violation": 25,
    "controller_torque_discontinuity": 32,
    "tau_j_range_violation": 34,
}
"""Index of each checked error among the flags of the FCI's state."""
LOST = 20
"""Number of consecutive lost packets after which the arm stops."""
BEGINNING = 0.005
"""Maximum wait (s) for an answer before the first answer of a motion, because a starting client does not answer."""


class Robot(BaseRobot):  # type: ignore[misc]
    """Adapter that connects the simulated arm to ``franky-sim``."""

    def __init__(self, arm: TorqueArm) -> None:
        super().__init__()
        self.arm = arm
        self.asked: npt.NDArray[np.float64] | None = None

    def _get_state(self) -> InnerRobotState:
        q, v, torque = (tuple(each.tolist()) for each in (self.arm.q, self.arm.v, self.arm.torque))
        return InnerRobotState(q=q, dq=v, tau_j=torque)

    @property
    def state(self) -> FrankaRobotState:
        inner = self._get_state()
        pose = self.to_franka_pose(self.kinematics(self.arm.q))
        elbow = (inner.q[2], float(np.sign(inner.q[3])))
        return FrankaRobotState(
            q=inner.q,
            q_d=inner.q,
            dq=inner.dq,
            dq_d=inner.dq,
            theta=inner.q,
            dtheta=inner.dq,
            tau_J=inner.tau_j,
            tau_J_d=inner.tau_j,
            O_T_EE=pose,
            O_T_EE_d=pose,
            O_T_EE_c=pose,
            elbow=elbow,
            elbow_d=elbow,
            elbow_c=elbow,
        )

    def torque_control(self, torques: npt.ArrayLike, has_new_command: bool = True) -> None:
        self.asked = np.array(torques, dtype=np.float64)

    def joint_position_control(self, target_q: npt.ArrayLike, has_new_command: bool = True) -> None:
        self.asked = None  # position commands are not supported: the brakes hold the arm

    def _torque_control(self, torques: npt.NDArray[np.float64]) -> None:
        raise AssertionError("the base's own controllers are not used")

    def set_hand_goal(self, width: float, max_velocity: float, max_force: float) -> None:
        self.arm.width, self.arm.speed = width, max_velocity

    def _get_hand_width(self) -> float:
        return self.arm.opening


class Server(FrankaRobotServer):  # type: ignore[misc]
    """FCI server of one arm.

    Args:
        arm: simulated arm to move.
        patience: maximum wait for the client's answer to a state, s of wall time.

    Attributes:
        lost: number of lost packets.
        cycles: number of control cycles in motions.
    """

    def __init__(self, arm: TorqueArm, patience: float) -> None:
        self._arm, self._patience = arm, patience
        self._sent = -1
        self._answered = self._began = False
        self._answers: deque[bool] = deque(maxlen=100)
        self._in_a_row = self.lost = self.cycles = 0
        self._stopped = False
        super().__init__(Robot(arm), LocalHostnames())

    def cycle(self) -> None:
        """Run one control cycle: read commands, simulate a step, send the state, and wait for the answer."""
        self.process_commands()
        self._arm.step(self.robot.asked)
        if self._arm.reflex is not None and not self._stopped:
            self._stop()
        self._answered = False
        self.send_state()
        if not self.current_motion_id:
            return
        until = time.monotonic() + (self._patience if self._began else min(self._patience, BEGINNING))
        while not self._answered and time.monotonic() < until:
            time.sleep(2e-5)
            self._process_udp_commands()
        if self._began and self.current_motion_id:
            self.cycles += 1
            self._answers.append(self._answered)
            self._in_a_row = 0 if self._answered else self._in_a_row + 1
            self.lost += not self._answered
            if self._in_a_row == LOST:
                self._arm.reflex = Reflex("communication_constraints_violation", f"{LOST} packets lost in a row")

    def start_motion(
        self,
        controller_mode: MoveCommandControllerMode,
        motion_generator_mode: MoveCommandMotionGeneratorMode,
        motion_id: int,
    ) -> None:
        if self._arm.reflex is not None:
            raise ValueError(f"the arm has stopped: {self._arm.reflex.said}")
        if controller_mode != MoveCommandControllerMode.kExternalController:
            raise ValueError("this arm accepts only torque commands")
        self._began, self._in_a_row = False, 0
        super().start_motion(controller_mode, motion_generator_mode, motion_id)

    @property
    def robot_state(self) -> FrankaRobotState:
        state = super().robot_state.replace(
            control_command_success_rate=sum(self._answers) / max(1, len(self._answers))
        )
        if self._arm.reflex is None:
            return state
        flags = tuple(number == ERRORS[self._arm.reflex.error] for number in range(41))
        return state.replace(robot_mode=RobotMode.kReflex, errors=flags, reflex_reason=flags)

    def _stop(self) -> None:
        """Abort the motion as a real arm does: the state contains the reason, and the client gets an abort message."""
        self._stopped = True
        motion = self.current_motion_id
        self.stop_motion(send_preemption_signal=False)
        if motion:
            BaseCommand.send_response(self._tcp_socket, RobotCommand.kMove, motion, MoveStatus.kReflexAborted)
        self.reset_current_motion_id()

    def _reset_state(self) -> None:
        super()._reset_state()
        self._sent = -1

    def _get_state_bytes(self) -> bytes:
        self._sent += 1
        return super()._get_state_bytes()

    def _handle_udp_command(self, command_data: bytes) -> None:
        super()._handle_udp_command(command_data)
        if int.from_bytes(command_data[:8], "little") == self._sent:
            self._answered = self._began = True


def serve(pipe: Connection, patience: float, pace: float, core: int | None) -> None:
    """Run a server until a message arrives on the pipe. Send the server's address first, and a final report at the end.

    Args:
        pipe: connection to the parent process.
        patience: maximum wait for the client's answer to a state, s of wall time.
        pace: minimum duration of a cycle during a motion, s of wall time.
        core: CPU core to which this process is bound; None: any.
    """
    if core is not None:
        os.sched_setaffinity(0, {core})
    arm = TorqueArm()
    server = Server(arm, patience)
    server.init()
    took: list[float] = []
    try:
        pipe.send(server.hostname)
        while not pipe.poll():
            for _ in range(20):
                begun = time.monotonic()
                server.cycle()
                if server.current_motion_id:
                    took.append(time.monotonic() - begun)
                time.sleep(max(0.0, begun + (pace if server.current_motion_id else STEP) - time.monotonic()))
        found: dict[str, Any] = {
            "reflex": None if arm.reflex is None else [arm.reflex.error, arm.reflex.said],
            "largest": arm.checker.largest,
            "cycles": server.cycles,
            "lost": server.lost,
            "cycle_ms": [1e3 * float(each) for each in np.quantile(took, (0.5, 0.99, 1.0))] if took else None,
            "above_1_ms": sum(each > STEP for each in took),
        }
        pipe.send(found)
    finally:
        server.cleanup()
