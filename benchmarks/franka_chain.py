"""Test that the commands of the Franka driver never raise a safety reflex of the arm, on a simulated arm.

    fci/bin/python benchmarks/franka_chain.py [--runs 100] [--speed 0.1 0.5] [--pace 1] [--json OUT]

The script needs a virtual environment with ``franky-sim``, ``franky-control`` and the packages of this repository;
docs/results/robot.md has the commands.

The test contains all software that drives a real arm: 100 commands per second, the motion limits, our driver, and the
manufacturer's client with its 1 kHz loop, UDP and TCP. A server in another process replaces the arm
(``franka_server.py``). The server speaks the FCI, Franka's control interface, and moves an arm in SAPIEN by the torques
of the client. A torque, a change of a torque within a millisecond, a velocity or a position beyond the manufacturer's
limits for the Panda raises a reflex (``franka_arm.py``). The server then aborts the motion and reports the reflex in
its state, as a real arm does.

In each cycle the server waits for the client, at most ``--patience`` seconds. A cycle takes at least ``--pace``
milliseconds of wall time. The client uses the time of the arm's states as its clock, so that on a busy machine the arm
and the client slow down together. With the default pace, the two Python threads of the client have no more time than
with a real arm.

Each run drives the arm for one second of simulated time towards a random pose, with noise and full speed within the
motion limits, while the hand closes or opens. Finally, the script sends two steps of 0.3 rad to check that violations
are detected: one step bypasses the motion limits, and the other step also bypasses the client's limit on the change of
a torque. The driver must report both reflexes. The exit code is 1 if a run raised a reflex or was refused, if a command
exceeded a limit, or if such a step was not reported.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
import types
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import numpy.typing as npt

from gensim2.core.seeding import rng
from gensim2.robots import robot
from gensim2_robot.arm import LimitedArm
from gensim2_robot.arm_limits import CYCLE, ArmLimits
from gensim2_robot.audit import limits_passed
from gensim2_robot.drivers import franka, streamed
from gensim2_robot.drivers.franka import FrankaArm

SPREAD = 1.0
"""Maximum distance of the random poses from the start pose in each joint, rad."""
WILD = 0.2
"""Standard deviation (rad) of the noise added to the targets; the noise changes every fifth of a second."""
MADE_UP = 0.1
"""Maximum delay (s) that late commands catch up by being sent without a pause, as in the control loop."""
LEAP = 0.3
"""Size of the step that bypasses the limits, rad."""


class Clock:
    """Clock that shows the arm's time, from the newest state of the client, instead of the machine's time.

    Attributes:
        library: the client; None before it is connected.
    """

    def __init__(self) -> None:
        self.library: Any = None

    def monotonic(self) -> float:
        return float(self.library.state.time.to_sec())

    def sleep(self, seconds: float) -> None:
        until = self.monotonic() + seconds
        while (left := until - self.monotonic()) > 0.0:
            time.sleep(max(3e-4, 0.8 * left))


class Driver(FrankaArm):
    """Our driver, which also records the start of each of its cycles.

    Attributes:
        cycles: start times of the driver's cycles in the arm's time, s.
    """

    def __init__(self, host: str, clock: Clock) -> None:
        self._clock, self.cycles = clock, list[float]()
        super().__init__(host, robot("panda"), enforce_realtime=False)

    def _cycle(self) -> None:
        self.cycles.append(self._clock.monotonic())
        super()._cycle()

    def start(self) -> None:
        self._clock.library = self._robot
        super().start()


@dataclass
class Chain:
    """A connected driver, the clock with the arm's time, and the server's final report."""

    driver: Driver
    clock: Clock
    found: dict[str, Any] = field(default_factory=dict)


@contextmanager
def chain(options: argparse.Namespace) -> Iterator[Chain]:
    """Start the server in another process, and connect a driver to it."""
    from franka_server import serve

    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    how = (there, options.patience, 1e-3 * options.pace, options.server_core)
    process = context.Process(target=serve, args=how, daemon=True)
    process.start()
    there.close()
    clock = Clock()
    with mock.patch.object(streamed, "time", types.SimpleNamespace(monotonic=clock.monotonic, sleep=clock.sleep)):
        driver = Driver(here.recv(), clock)
        made = Chain(driver, clock)
        try:
            yield made
        finally:
            driver.close()
            here.send("over")
            made.found.update(here.recv())
            process.join()


def standing(arm: LimitedArm, clock: Clock) -> np.ndarray:
    """Wait for a state of the arm, and return the current joint positions (m,)."""
    until = clock.monotonic() + 1.0
    while not arm.poll() and clock.monotonic() < until:
        clock.sleep(CYCLE)
    state = arm.state()
    assert state is not None, "the arm says nothing"
    return arm.joints(state.q)


def drive(runs: int, speed: float, options: argparse.Namespace) -> dict[str, Any]:
    """Drive the arm through the motion limits for ``runs`` seconds; stop at a reflex or a refused command."""
    limits = ArmLimits.of(robot("panda"), speed=speed)
    limits.prepare()
    draw, done, off, late, mode = rng(options.seed, "franka chain"), 0, [], [], "ready"
    with chain(options) as ours:
        clock, driver = ours.clock, ours.driver
        began = time.monotonic() - clock.monotonic()
        arm = LimitedArm(driver, limits)
        home = standing(arm, clock)
        arm.begin(home)
        commands = [home]
        due = clock.monotonic()
        for number in range(runs):
            goal = home + draw.uniform(-SPREAD, SPREAD, len(home))
            for cycle in range(round(1.0 / CYCLE)):
                if cycle % 20 == 0:
                    wild = draw.normal(0.0, WILD, len(home))
                arm.poll()
                commands.append(arm.command(goal + wild, 1.0 if number % 2 else -1.0, due).q)
                now = clock.monotonic()
                late.append(max(0.0, now - due - CYCLE))
                due = max(due + CYCLE, now - MADE_UP)
                clock.sleep(due - now)
            state = arm.state()
            assert state is not None
            mode = state.mode
            if mode != "ready":
                break
            done += 1
            off.append(float(np.abs(arm.joints(state.q) - commands[-1]).max()))
        trouble, slower = driver.trouble, (time.monotonic() - began) / clock.monotonic()
    return {
        "speed": speed,
        "runs": done,
        "mode": mode,
        "trouble": trouble,
        "passed": limits_passed(commands, limits),
        "off_rad": max(off, default=None),
        "late_ms": spread(late),
        "driver_ms": spread(np.diff(driver.cycles)),
        "slower": slower,
        "clips": dict(arm.clips),
        "server": ours.found,
    }


def spread(seconds: list[float] | npt.NDArray[np.float64]) -> list[float]:
    """Return the median, 99th percentile and maximum, ms."""
    return [1e3 * float(each) for each in np.quantile(seconds, (0.5, 0.99, 1.0))]


def leap(options: argparse.Namespace, unlimited: bool) -> dict[str, Any]:
    """Return the report of the driver after a step that bypasses the limits.

    Args:
        options: options of the command line.
        unlimited: whether the step also bypasses the client's limit on the change of a torque.
    """
    with chain(options) as ours:
        clock, driver = ours.clock, ours.driver
        with mock.patch.object(franka, "DELTA", 1e6 if unlimited else franka.DELTA):
            arm = LimitedArm(driver, ArmLimits.of(robot("panda"), speed=1.0))
            home, told = standing(arm, clock), None
            for cycle in range(100):
                driver.send(home if cycle < 20 else home + LEAP, 1.0, clock.monotonic())
                clock.sleep(CYCLE)
                told = next((each.mode for each in driver.poll() if each.mode != "ready"), None)
                if told is not None:
                    break
        errors, trouble = driver._robot.state.current_errors, driver.trouble
        names = [name for name in dir(type(errors)) if not name.startswith("_") and getattr(errors, name) is True]
    return {"mode": told, "errors": names, "trouble": trouble, "reflex": ours.found["reflex"]}


def tell(found: dict[str, Any]) -> None:
    """Print the results for one speed."""
    server = found["server"]
    shares = ", ".join(f"{name} {share:.2f}" for name, share in server["largest"].items())
    said = f"{found['mode']}, reflex: {server['reflex']}, trouble: {found['trouble']}"
    print(f"speed {found['speed']}: {found['runs']} runs, {said}")
    print(f"    at most {shares} of the limits; {1e3 * (found['off_rad'] or 0.0):.1f} mrad off at most")
    print(f"    {found['passed']} commands passed a limit; one simulated second took {found['slower']:.1f} s")
    print(f"    {server['cycles']} cycles, {server['lost']} packets lost")
    for name, milliseconds in (
        ("a command late", found["late_ms"]),
        ("from one of the driver's cycles to the next", found["driver_ms"]),
        ("the server's cycle, by the wall", server["cycle_ms"]),
    ):
        median, nearly_all, worst = milliseconds
        print(f"    {name}: {median:.1f} ms on median, {nearly_all:.1f} at 99 %, {worst:.1f} at worst", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--speed", type=float, nargs="*", default=[0.1, 0.5])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--patience", type=float, default=1.0, help="maximum wait for the client in a cycle, s")
    parser.add_argument("--pace", type=float, default=1.0, help="minimum wall time of a cycle during a motion, ms")
    parser.add_argument(
        "--cores", action="store_true", help="bind the server to the last CPU core and the client to the others"
    )
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    cores = sorted(os.sched_getaffinity(0))
    options.server_core = None
    if options.cores and len(cores) > 1:
        options.server_core = cores[-1]
        os.sched_setaffinity(0, cores[:-1])
    figures = []
    for speed in options.speed:
        figures.append(drive(options.runs, speed, options))
        tell(figures[-1])
    leaps = [leap(options, unlimited) for unlimited in (False, True)]
    for said, each in zip(("the limits", "the limits and the client's own"), leaps, strict=True):
        print(f"a step around {said}: {each['mode']}, {each['errors']}; {each['reflex']}; {each['trouble']}")
    if options.json is not None:
        options.json.write_text(json.dumps({"runs": figures, "leaps": leaps}, indent=2) + "\n")
    blind = any(each["mode"] != "reflex" or each["reflex"] is None for each in leaps)
    fallen = any(each["runs"] < options.runs or each["passed"] or each["server"]["reflex"] for each in figures)
    return int(blind or fallen)


if __name__ == "__main__":
    sys.exit(main())
