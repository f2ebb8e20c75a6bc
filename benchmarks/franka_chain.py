"""Does the stream raise an arm's reflexes? The Franka driver and ``franky-control`` against an FCI over SAPIEN.

    fci/bin/python benchmarks/franka_chain.py [--runs 100] [--speed 0.1 0.5] [--pace 1] [--json OUT]

in an environment of its own, with ``franky-sim`` and ``franky-control`` beside the clone's packages;
docs/results/robot.md has the commands.

The whole chain as it drives an arm, but for the arm: commands 100 a second through the limits, our driver, the maker's
client with its 1 kHz loop, UDP and TCP, and in a process of its own a server that speaks the FCI and moves an arm in
SAPIEN by the torques that come (``franka_server.py``). Its checker raises a reflex where a torque, its change within a
millisecond, a velocity or a position passes what the maker publishes for the Panda (``franka_arm.py``): the motion is
aborted and the state says so, as the arm does.

The server's cycle waits for the client (``--patience``) and takes ``--pace`` milliseconds by the wall at least, and all
times on this side are those of the arm's states: on a machine that is busy the arm is slow, and both go on together;
the client's two threads in Python have no more time than a real arm leaves them, unless it is paced slower.

Each run is one second of the arm's time towards a random pose, as hostile as the limits let it be, the hand closing and
opening. Last, the same step of 0.3 rad around the limits, and also around the client's own limit of a torque's change,
must raise reflexes that the driver tells: else the chain is blind. Ends with 1 where a run raised a reflex or was
refused, a command passed a limit, or such a step was not told.
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
"""Rad about the start within which poses are drawn."""
WILD = 0.2
"""Rad, standard deviation of what is added to every target for a fifth of a second."""
MADE_UP = 0.1
"""Seconds of commands that are late which are sent all at once, as the loop does."""
LEAP = 0.3
"""Rad, a step around the limits."""


class Clock:
    """The arm's time in the place of the machine's: that of the newest state which the client has.

    Attributes:
        library: the client; None: none is connected yet.
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
    """Ours, by the arm's time.

    Attributes:
        cycles: seconds of the arm at which its own cycles began.
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
    """A driver, the arm's time, and what the server says at the end."""

    driver: Driver
    clock: Clock
    found: dict[str, Any] = field(default_factory=dict)


@contextmanager
def chain(options: argparse.Namespace) -> Iterator[Chain]:
    """A server in a process of its own, and a driver that is connected to it."""
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
    """(m,) joints where it stands."""
    until = clock.monotonic() + 1.0
    while not arm.poll() and clock.monotonic() < until:
        clock.sleep(CYCLE)
    state = arm.state()
    assert state is not None, "the arm says nothing"
    return arm.joints(state.q)


def drive(runs: int, speed: float, options: argparse.Namespace) -> dict[str, Any]:
    """Runs through the limits, until a reflex or a refusal ends them."""
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
    """Median, 99th percentile and worst, ms."""
    return [1e3 * float(each) for each in np.quantile(seconds, (0.5, 0.99, 1.0))]


def leap(options: argparse.Namespace, unlimited: bool) -> dict[str, Any]:
    """Return the report of the driver after a step that bypasses the limits.

    Args:
        options: options of the command line.
        unlimited: whether the client's limit of a torque's change is gone, too.
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
    """Print the figures of a speed."""
    server = found["server"]
    shares = ", ".join(f"{name} {share:.2f}" for name, share in server["largest"].items())
    said = f"{found['mode']}, reflex: {server['reflex']}, trouble: {found['trouble']}"
    print(f"speed {found['speed']}: {found['runs']} runs, {said}")
    print(f"    at most {shares} of the limits; {1e3 * (found['off_rad'] or 0.0):.1f} mrad off at most")
    print(f"    {found['passed']} commands passed a limit; a second of the arm took {found['slower']:.1f} by the wall")
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
    parser.add_argument("--patience", type=float, default=1.0, help="seconds that a state waits for its answer")
    parser.add_argument(
        "--pace", type=float, default=1.0, help="ms by the wall that a cycle of a motion takes at least"
    )
    parser.add_argument(
        "--cores", action="store_true", help="the server keeps to the last core, the client to the others"
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
