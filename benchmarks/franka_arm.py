"""A Panda in SAPIEN that takes torques at 1 kHz, and the reflexes that stop it, by a checker of their own."""

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
"""Seconds of a cycle."""
#: The Panda's, as its maker publishes them; nothing is asked of the code that is judged.
VELOCITY = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
TORQUE = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])
TORQUE_RATE = 1000.0
"""N m/s."""
SINGLE = 1e-5
"""Share of a limit that rounding may add: the arm tells its client the last torque as single floats."""
BRAKES = 50.0
"""N m s/rad that hold an arm which is sent no torque."""
ROTOR = 0.1
"""kg m^2 of a motor's rotor behind its gear, as public models of the arm have it; the URDF says none."""


@dataclass(frozen=True)
class Reflex:
    """The reason of an arm that has stopped by itself.

    Attributes:
        error: as the FCI names it.
        said: the joint and its share of the limit.
    """

    error: str
    said: str


@dataclass
class Checker:
    """The checks of the arm's controller in each cycle.

    Attributes:
        largest: greatest share of each limit that was used.
    """

    largest: dict[str, float] = field(default_factory=lambda: dict.fromkeys(("torque", "torque rate", "velocity"), 0.0))

    def reflex(self, torque: Array, last: Array, q: Array, v: Array) -> Reflex | None:
        """The reflex that a torque raises after the last one, (7,) N m each, at (7,) rad and rad/s; None: none."""
        shares = {
            "torque": ("tau_j_range_violation", np.abs(torque) / TORQUE),
            "torque rate": ("controller_torque_discontinuity", np.abs(torque - last) / (TORQUE_RATE * STEP)),
            "velocity": ("joint_velocity_violation", np.abs(v) / VELOCITY),
        }
        found = None
        for name, (error, share) in shares.items():
            self.largest[name] = max(self.largest[name], float(share.max()))
            if not (share <= 1.0 + SINGLE).all():  # nor what is no number
                found = Reflex(error, f"{name} of joint {int(share.argmax()) + 1}: {share.max():.2f} of its limit")
        if not ((q >= LOWER) & (q <= UPPER)).all():
            found = Reflex("joint_position_limits_violation", "a joint is at the end of its range")
        return found


class TorqueArm:
    """The arm: balanced against its weight, as a Franka's controller does, and not against what its own motion asks.

    Attributes:
        now: s.
        reflex: why it has stopped by itself; None: it has not.
        torque: (7,) N m that its client asked for in the last cycle; 0 where none did.
        width: m between the fingers that the hand goes to.
        speed: m/s at which it goes there.
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
        """(7,) rad."""
        return np.array(self._arm.qpos[:7], dtype=np.float64)

    @property
    def v(self) -> Array:
        """(7,) rad/s."""
        return np.array(self._arm.qvel[:7], dtype=np.float64)

    @property
    def opening(self) -> float:
        """Metres between the fingers."""
        return float(self._arm.qpos[7:].sum())

    def step(self, torque: Array | None) -> None:
        """One millisecond with (7,) N m; None: its brakes hold it."""
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
