"""Simulate a torque-controlled Panda at 1 kHz in SAPIEN, with the safety reflexes of a real arm.

A reflex stops the arm when a command or the motion violates a limit. The checks do not use the tested code.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import sapien

from gensim2.robots import robot
from gensim2.sim.arm import Arm
from gensim2.sim.physics import named_physics

Array = npt.NDArray[np.float64]

STEP = 1e-3
"""Duration of a control cycle, s."""
#: Limits of the Panda as published by its manufacturer: rad/s, rad and N m. They are not taken from the tested code.
VELOCITY = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
TORQUE = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])
TORQUE_RATE = 1000.0
"""Maximum rate of change of a torque, N m/s."""
SINGLE = 1e-5
"""Relative tolerance of limits: the arm reports the last torque to its client in single precision."""
BRAKES = 50.0
"""Damping (N m s/rad) of each joint while the brakes hold the arm, because it gets no torque command."""
ROTOR = 0.1
"""Inertia of a motor's rotor at the joint side of the gear, kg m^2, as in public models; the URDF has no value."""


@dataclass(frozen=True)
class Reflex:
    """The reason why the arm has stopped by itself.

    Attributes:
        error: name of the error in the FCI, Franka's control interface.
        said: the joint, and the value as a fraction of the limit, as text.
    """

    error: str
    said: str


@dataclass
class Checker:
    """Checks the limits in each control cycle, as the arm's controller does.

    Attributes:
        largest: largest value of each quantity so far, as a fraction of its limit.
    """

    largest: dict[str, float] = field(default_factory=lambda: dict.fromkeys(("torque", "torque rate", "velocity"), 0.0))

    def reflex(self, torque: Array, last: Array, q: Array, v: Array) -> Reflex | None:
        """Return the reflex that a torque command raises; None if all limits are kept.

        Args:
            torque, last: (7,) torques of this cycle and of the last cycle, N m.
            q, v: (7,) joint positions and velocities, rad and rad/s.
        """
        shares = {
            "torque": ("tau_j_range_violation", np.abs(torque) / TORQUE),
            "torque rate": ("controller_torque_discontinuity", np.abs(torque - last) / (TORQUE_RATE * STEP)),
            "velocity": ("joint_velocity_violation", np.abs(v) / VELOCITY),
        }
        found = None
        for name, (error, share) in shares.items():
            self.largest[name] = max(self.largest[name], float(share.max()))
            if not (share <= 1.0 + SINGLE).all():  # the negation also catches NaN
                found = Reflex(error, f"{name} of joint {int(share.argmax()) + 1}: {share.max():.2f} of its limit")
        if not ((q >= LOWER) & (q <= UPPER)).all():
            found = Reflex("joint_position_limits_violation", "a joint is at the end of its range")
        return found


class TorqueArm:
    """The simulated arm. It compensates its weight, as a Franka's controller does, but not its inertial forces.

    Attributes:
        now: simulated time, s.
        reflex: reason why the arm has stopped by itself; None: the arm has not stopped.
        torque: (7,) torques that the client commanded in the last cycle, N m; 0 without a command.
        width: target distance between the fingers, m.
        speed: speed at which the distance between the fingers changes, m/s.
    """

    def __init__(self) -> None:
        profile = robot("panda")
        physics = named_physics("default")
        system = physics.new_system(profile)
        system.timestep = STEP
        self._scene = sapien.Scene([system])
        body = Arm(self._scene, profile, physics)
        body.put(profile.reset_qpos)
        self._arm = body.articulation
        arm, self._fingers = self._arm.active_joints[:7], self._arm.active_joints[7:]
        for joint in arm:
            joint.set_drive_properties(0.0, 0.0)
            joint.set_armature(np.array([ROTOR], dtype=np.float32))
        self.checker = Checker()
        self.now = 0.0
        self.reflex: Reflex | None = None
        self.torque = np.zeros(7)
        self.width = self._target = self.opening
        self.speed = 0.0

    @property
    def q(self) -> Array:
        """(7,) joint positions, rad."""
        return np.array(self._arm.qpos[:7], dtype=np.float64)

    @property
    def v(self) -> Array:
        """(7,) joint velocities, rad/s."""
        return np.array(self._arm.qvel[:7], dtype=np.float64)

    @property
    def opening(self) -> float:
        """Distance between the fingers, m."""
        return float(self._arm.qpos[7:].sum())

    def step(self, torque: Array | None) -> None:
        """Simulate one millisecond with (7,) torques in N m; None: the brakes hold the arm."""
        q, v = self.q, self.v
        if torque is not None and self.reflex is None:
            self.reflex = self.checker.reflex(torque, self.torque, q, v)
        braked = torque is None or self.reflex is not None
        self.torque = np.zeros(7) if torque is None or braked else torque
        force = np.zeros(9, dtype=np.float32)
        force[:7] = -BRAKES * v if braked else self.torque
        self._arm.set_qf(force)
        self._target += float(np.clip(self.width - self._target, -self.speed * STEP, self.speed * STEP))
        for joint in self._fingers:
            joint.drive_target = np.array([0.5 * self._target], dtype=np.float32)
        self._scene.step()
        self.now += STEP
