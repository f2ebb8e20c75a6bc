"""Does the stream raise an arm's reflexes? The Franka driver over SAPIEN at 1 kHz, judged by a checker of its own.

    python benchmarks/franka_reflexes.py [--runs 100] [--speed 0.1 0.5] [--seed 0] [--json OUT]

In simulated time, in one process: commands 100 a second through the limits, the driver's own interpolation 200 times a
second, and, 1000 times a second, joint impedance about its references on an arm in SAPIEN whose drives are off. What
``franky-control`` does (its documented law: the last reference is kept, a torque changes by ``max_delta_tau`` a
millisecond at most) is written here anew; its real client is tried by ``franka_chain.py``. The checker raises a reflex
where a torque or its change within a millisecond, a velocity or a position passes what the maker publishes for the
Panda, and stops the arm as the arm does. Each run is one second towards a random pose, as hostile as the limits let it
be. Last, the same step of 0.3 rad around the limits and around ``max_delta_tau`` must raise one: else the checker is
blind. Ends with 1 where a run raised a reflex, or that step did not.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import types
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import sapien

from gensim2.deploy.arm import Arm
from gensim2.deploy.arm_limits import CYCLE, ArmLimits
from gensim2.deploy.drivers import streamed
from gensim2.deploy.drivers.franka import RATE, FrankaArm
from gensim2.robots import robot
from gensim2.seeding import rng
from gensim2.sim.arm import Arm as Body
from gensim2.sim.physics import named_physics

Array = np.ndarray

STEP = 1e-3
#: The Panda's, as its maker publishes them; nothing is asked of the code that is judged.
VELOCITY = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
TORQUE = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])
TORQUE_RATE = 1000.0
"""N m/s."""
ROTOR = 0.1
"""kg m^2 of a motor's rotor behind its gear, as public models of the arm have it; the URDF says none."""
SPREAD = 1.0
"""Rad about the start within which poses are drawn."""


class Franka:
    """An arm in SAPIEN with a controller of joint impedance, and its reflexes.

    Attributes:
        now: s.
        reflex: why it has stopped by itself; None: it has not.
        most: largest share of each limit that was used.
    """

    def __init__(self) -> None:
        self._profile = robot("panda")
        physics = named_physics("default")
        system = physics.new_system(self._profile)
        system.timestep = STEP
        self._scene = sapien.Scene([system])
        body = Body(self._scene, self._profile, physics)
        body.put(self._profile.reset_qpos)
        self._arm = body.articulation
        for joint in self._arm.active_joints[:7]:
            joint.set_drive_properties(0.0, 0.0)
            joint.set_armature(np.array([ROTOR], dtype=np.float32))
        self.now = 0.0
        self.reflex: str | None = None
        self.motion: Any = None
        self.most = dict.fromkeys(("torque", "torque rate", "velocity"), 0.0)
        self._torque = np.zeros(7)

    @property
    def q(self) -> Array:
        return np.array(self._arm.qpos[:7], dtype=np.float64)

    @property
    def v(self) -> Array:
        return np.array(self._arm.qvel[:7], dtype=np.float64)

    def step(self) -> None:
        """One millisecond."""
        q, v = self.q, self.v
        torque = np.zeros(7) if self.motion is None else self.motion.torque(q, v, self._torque)
        if self.reflex is None:
            self._check(torque, q, v)
        if self.reflex is not None or self.motion is None:
            torque = -50.0 * v  # brakes
        self._torque = torque
        force = self._arm.compute_passive_force(gravity=False, coriolis_and_centrifugal=True)
        force[:7] += torque
        self._arm.set_qf(force)
        self._scene.step()
        self.now += STEP

    def _check(self, torque: Array, q: Array, v: Array) -> None:
        shares = {
            "torque": np.abs(torque) / TORQUE,
            "torque rate": np.abs(torque - self._torque) / (TORQUE_RATE * STEP),
            "velocity": np.abs(v) / VELOCITY,
        }
        for name, share in shares.items():
            self.most[name] = max(self.most[name], float(share.max()))
            if (share > 1.0 + 1e-9).any():
                self.reflex = f"{name} of joint {int(share.argmax()) + 1}: {share.max():.2f} of its limit"
        if ((q < LOWER) | (q > UPPER)).any():
            self.reflex = "a joint is at the end of its range"


def library(arm: Franka) -> types.ModuleType:
    """A module in the place of ``franky``: its calls that the driver makes, on the arm in SAPIEN."""
    module: Any = types.ModuleType("franky")
    for name in ("NetworkException", "IncompatibleVersionException", "RealtimeException", "ControlException"):
        setattr(module, name, type(name, (Exception,), {}))
    module.RealtimeConfig = types.SimpleNamespace(Enforce=1, Ignore=0)
    module.RobotMode = types.SimpleNamespace(Idle=0, Reflex=4, UserStopped=5)
    module.TorqueStopMotion = lambda: None
    module.JointReference = lambda q, v: (np.array(q), np.array(v))

    class JointImpedanceTrackingMotion:
        """Impedance about the last reference."""

        def __init__(self, stiffness: Array, damping: Array, max_delta_tau: float = 1.0) -> None:
            self._stiffness, self._damping, self._most = stiffness, damping, max_delta_tau
            self.steps = self.held_back = 0

        def set_reference(self, reference: tuple[Array, Array]) -> None:
            self._q, self._v = reference

        def torque(self, q: Array, v: Array, last: Array) -> Array:
            wanted = self._stiffness * (self._q - q) + self._damping * (self._v - v) - last
            self.steps += 1
            self.held_back += int((np.abs(wanted) > self._most).any())
            return last + np.clip(wanted, -self._most, self._most)

    class Robot:
        def __init__(self, host: str, **_: Any) -> None:
            arm.motion = None

        @property
        def state(self) -> Any:
            mode = 4 if arm.reflex is not None else 0
            return types.SimpleNamespace(q=arm.q, dq=arm.v, O_F_ext_hat_K=np.zeros(6), robot_mode=mode)

        def move(self, motion: Any, asynchronous: bool) -> None:
            arm.motion = motion

        def poll_motion(self) -> bool:
            return True

    module.JointImpedanceTrackingMotion, module.Robot = JointImpedanceTrackingMotion, Robot
    return module


def drive(runs: int, speed: float, seed: int) -> dict[str, Any]:
    """Runs through the limits, until a reflex ends them."""
    profile, body = robot("panda"), Franka()
    limits = ArmLimits.of(profile, speed=speed)
    clock = types.SimpleNamespace(monotonic=lambda: body.now, sleep=lambda seconds: None)
    draw, done, off = rng(seed, "franka reflexes"), 0, []
    with (
        mock.patch.dict(sys.modules, {"franky": library(body)}),
        mock.patch.object(streamed, "time", clock),
        mock.patch.object(FrankaArm, "start"),  # no thread: simulated time
    ):
        driver = FrankaArm("simulated", profile, gripper=False)
        arm = Arm(driver, limits)
        driver._cycle()
        arm.poll()
        home = arm.joints(arm.state().q)  # type: ignore[union-attr]
        arm.begin(home)
        for _ in range(runs):
            goal = np.clip(home + draw.uniform(-SPREAD, SPREAD, 7), LOWER, UPPER)
            for cycle in range(round(1.0 / CYCLE)):
                wild = draw.normal(0.0, 0.2, 7) if cycle % 20 == 0 else 0.0
                arm.poll()
                arm.command(goal + wild, 1.0, body.now)
                for step in range(round(CYCLE / STEP)):
                    if step % round(1.0 / RATE / STEP) == 0:
                        driver._cycle()
                    body.step()
            if body.reflex is not None or driver.trouble is not None:
                break
            done += 1
            sent = arm.sent
            assert sent is not None
            off.append(float(np.abs(sent.q - body.q).max()))
    return {
        "speed": speed,
        "runs": done,
        "reflex": body.reflex,
        "trouble": driver.trouble,
        "most": body.most,
        "held_back": 0.0 if body.motion is None else body.motion.held_back / body.motion.steps,
        "off_rad": max(off, default=None),
        "clips": dict(arm.clips),
    }


def around_the_limits() -> str | None:
    """The reflex of a step of 0.3 rad that no limit has seen."""
    body = Franka()
    module: Any = library(body)
    motion = module.JointImpedanceTrackingMotion(np.full(7, 600.0), np.full(7, 49.0), np.inf)
    motion.set_reference((body.q, np.zeros(7)))
    body.motion = motion
    for _ in range(10):
        body.step()
    motion.set_reference((body.q + 0.3, np.zeros(7)))
    body.step()
    return body.reflex


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--speed", type=float, nargs="*", default=[0.1, 0.5])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    begun, figures = time.process_time(), []
    for speed in options.speed:
        found = drive(options.runs, speed, options.seed)
        figures.append(found)
        most = ", ".join(f"{name} {share:.2f}" for name, share in found["most"].items())
        said = f"{found['runs']} runs, reflex: {found['reflex']}; at most {most} of the limits"
        print(f"speed {speed}: {said}", flush=True)
        off, held = 1e3 * (found["off_rad"] or 0.0), 100 * found["held_back"]
        print(f"    {off:.1f} mrad off at most; {held:.1f} % of the time a torque was held back", flush=True)
    seen = around_the_limits()
    print(f"a step around the limits: {seen}; {time.process_time() - begun:.0f} s of CPU")
    if options.json is not None:
        options.json.write_text(json.dumps({"runs": figures, "around_the_limits": seen}, indent=2) + "\n")
    return int(seen is None or any(each["runs"] < options.runs for each in figures))


if __name__ == "__main__":
    sys.exit(main())
