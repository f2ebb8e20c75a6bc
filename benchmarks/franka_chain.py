"""The Franka driver against a server that speaks the FCI at 1 kHz: no reflex, no refusal, no limit passed.

    python -m franky_sim.run_server -s mujoco            # pip install franky-sim mujoco, in an environment of its own
    python benchmarks/franka_chain.py --host 127.0.0.1 [--runs 100] [--speed 0.1]

The client is ``franky-control`` as it drives an arm, the commands go through the limits as in ``gensim2 robot run``.
Each run is one second towards a random pose near the start, the gripper closing and opening. The server has no limits
and no reflexes of its own: what is shown is that the protocol is spoken and the stream followed. Ends with 1 where a
run ended in another mode than it began, or a command passed a limit.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np

from gensim2.deploy.arm import Arm
from gensim2.deploy.arm_limits import CYCLE, ArmLimits
from gensim2.deploy.audit import limits_passed
from gensim2.deploy.drivers.franka import FrankaArm
from gensim2.robots import robot
from gensim2.seeding import rng

SPREAD = 0.05
"""Rad about the start within which poses are drawn."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--host", required=True)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--speed", type=float, default=0.1)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    profile = robot("panda")
    limits = ArmLimits.of(profile, speed=options.speed)
    limits.prepare()
    driver = FrankaArm(options.host, profile, enforce_realtime=False)
    arm = Arm(driver, limits)
    until = time.monotonic() + 10.0
    while not arm.poll() and time.monotonic() < until:
        time.sleep(CYCLE)
    state = arm.state()
    assert state is not None, "the arm says nothing"
    home = arm.joints(state.q)
    arm.begin(home)
    draw, commands, off, late, ended = rng(options.seed, "franka chain"), [], [], [], 0
    for number in range(options.runs):
        goal = home + draw.uniform(-SPREAD, SPREAD, len(home))
        due = time.monotonic()
        for _ in range(round(1.0 / CYCLE)):
            arm.poll()
            commands.append(arm.command(goal, 1.0 if number % 2 else -1.0, due).q)
            due += CYCLE
            late.append(max(0.0, time.monotonic() - due))
            time.sleep(max(0.0, due - time.monotonic()))
        state = arm.state()
        assert state is not None
        off.append(float(np.abs(arm.joints(state.q) - goal).max()))
        if state.mode != "ready":
            ended += 1
            print(f"run {number}: {state.mode}: {driver.trouble}")
            break
    driver.close()
    passed = limits_passed(commands, limits)
    print(f"{len(off)} runs, {len(commands)} commands, {ended} reflexes or refusals, {passed} commands passed a limit")
    print(f"off the pose at the end: median {np.median(off):.4f} rad, worst {max(off):.4f}")
    print(f"commands late by {1e3 * np.median(late):.1f} ms on median, {1e3 * max(late):.0f} at worst")
    return int(ended + passed > 0)


if __name__ == "__main__":
    sys.exit(main())
