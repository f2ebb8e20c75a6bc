"""Plan again at a fixed rate from a moving arm, and go over to each new motion.

    python benchmarks/replan_stream.py [--arms panda ur ...] [--worlds free boxes clouds] [--rates 2 5 10 20 50]
        [--problems 8] [--warm-start] [--deadline-ms 20] [--seed 0] [--json OUT]

Six arms move to random joint goals: without obstacles, past boxes that block the straight way, and past point clouds of
such boxes. Every tick plans anew from the state that the motion will have a deadline later, and splices the new motion
in there. With ``--warm-start`` each plan knows the present motion. A tick is missed if planning takes longer than the
deadline (CPU time of its thread); then the present motion goes on. Each goal counts as reached within three times the
duration of the motion that is planned once.

Prints a row for each arm, world and rate: arrivals, the duration divided by that of the motion planned once (median and
greatest), plans that failed or were late, the CPU time of a plan, and the greatest jump of position, velocity and
acceleration at a splice; then the arrivals of each rate. Ends with 1 if an arm does not arrive, if a duration exceeds
1.10 times that of the motion planned once, or if a splice jumps by more than 1e-6.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

sys.path += [str(Path(__file__).parents[1] / folder) for folder in (".", "tests/common")]

from random_plans import wheel_robots
from tests.kpam.random_problems import Solid, robot_of
from tests.kpam.six_arms import ARMS, six_arm

import gensim2_kpam as kpam
from gensim2.core.seeding import rng

Array = np.ndarray

WORLDS = ("free", "boxes", "clouds")
#: Largest duration of a replanned motion, as a multiple of the motion that is planned once.
MOST = 1.10
#: Multiple of the duration of the motion planned once after which a goal counts as missed.
PATIENCE = 3.0
#: Points of each cloud, and their radius in m.
POINTS, RADIUS = 3000, 0.005


@dataclass
class Problem:
    """A scene with a start and a goal, both (n,), and the motion that is planned once."""

    scene: kpam.Scene
    goal: Array
    once: kpam.Trajectory


@dataclass
class Row:
    """Figures of one arm in one world at one rate."""

    arm: str
    world: str
    rate: float
    problems: int = 0
    arrived: int = 0
    plans: int = 0
    failed: int = 0
    missed: int = 0
    ratios: list[float] = field(default_factory=list)
    cpu_ms: list[float] = field(default_factory=list)
    jump: float = 0.0

    def text(self) -> str:
        """Return the row as one line."""
        ratios, cpu = self.ratios or [np.inf], self.cpu_ms or [0.0]
        return (
            f"{self.arm:7} {self.world:6} {self.rate:4.0f} Hz: {self.arrived:3d} of {self.problems} arrive, "
            f"{np.median(ratios):.3f} (most {max(ratios):.3f}) times once; {self.plans} plans, {self.failed} failed, "
            f"{self.missed} late; {np.median(cpu):.2f} ms, 99 % {np.percentile(cpu, 99):.1f}; jump {self.jump:.0e}"
        )


def problems(arm: str, world: str, count: int, seed: int, robots: Path, folder: Path) -> Iterator[Problem]:
    """Yield problems that are solved once, among obstacles those whose straight way is blocked."""
    description, mechanism = six_arm(arm, robots)
    robot = robot_of(description, folder)
    draw = rng(seed, f"replan stream {arm} {world}")
    lower, upper = np.maximum(mechanism.lower, -2.5), np.minimum(mechanism.upper, 2.5)
    found = 0
    while found < count:
        start, goal = (mechanism.coupled(draw.uniform(lower, upper)) for _ in range(2))
        moved = sorted(mechanism.movers(mechanism.hand_link))
        still = [joint for joint in range(len(start)) if joint not in moved]
        goal[still] = start[still]
        bodies = []
        for index in range(0 if world == "free" else 3):
            solid = Solid("box", draw.uniform(0.02, 0.08, 3).tolist())
            pose = mechanism.hand_poses(start + draw.uniform(0.2, 0.8) * (goal - start))[0]
            pose[:3, 3] += draw.normal(0.0, 0.08, 3)
            if world == "clouds":
                shape = kpam.Shape.point_cloud(surface(solid.size, draw), RADIUS)
            else:
                shape = kpam.Shape.box(solid.size)
            bodies.append(kpam.Body(f"body{index}", "rigid", [shape], pose))
        scene = kpam.Scene(robot, bodies)
        motion = scene.plan_to(start, goal, samples=3000, **limits_of(arm, len(start)))
        if motion.trajectory is None or (bodies and motion.corners is not None and len(motion.corners) < 3):
            continue
        found += 1
        yield Problem(scene, goal, motion.trajectory)


def surface(size: list[float], draw: np.random.Generator) -> Array:
    """Return points (POINTS, 3) on the faces of a box of half extents ``size`` in m."""
    points = draw.uniform(-1.0, 1.0, (POINTS, 3))
    axis = draw.integers(0, 3, POINTS)
    rows = np.arange(POINTS)
    points[rows, axis] = np.sign(points[rows, axis])
    return points * np.array(size)


def limits_of(arm: str, joints: int) -> dict[str, Any]:
    """Return acceleration and jerk limits: the Panda's own, typical ones for the other arms."""
    if arm == "panda":
        return {}
    return {"acceleration_limits": [8.0] * joints, "jerk_limits": [300.0] * joints}


def stream(problem: Problem, row: Row, deadline: float, *, warm_start: bool) -> None:
    """Drive to one goal and add its figures to ``row``."""
    motion, once = problem.once, problem.once.duration
    row.problems += 1
    options = limits_of(row.arm, len(problem.goal))
    tick = 0
    while True:
        tick += 1
        seam = tick / row.rate
        if seam >= motion.times[-1]:
            row.arrived += 1
            row.ratios.append(float(motion.times[-1] / once))
            return
        if seam > PATIENCE * once:
            return
        state = motion.sample(seam)
        found = problem.scene.plan_to(
            state[0],
            problem.goal,
            start_velocity=state[1],
            start_acceleration=state[2],
            start_time=seam,
            warm_start=motion if warm_start else None,
            **options,
        )
        row.plans += 1
        row.cpu_ms.append(found.cpu_ms)
        if found.trajectory is None:
            row.failed += 1
        elif found.cpu_ms > 1e3 * deadline:
            row.missed += 1
        else:
            begins = found.trajectory.sample(seam)
            row.jump = max([row.jump, *(float(np.abs(a - b).max()) for a, b in zip(begins, state, strict=True))])
            motion = motion.splice(found.trajectory, seam).since(seam)


def main() -> int:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=ARMS)
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=WORLDS)
    parser.add_argument("--rates", nargs="+", type=float, default=[2, 5, 10, 20, 50])
    parser.add_argument("--problems", type=int, default=8)
    parser.add_argument("--warm-start", action="store_true")
    parser.add_argument("--deadline-ms", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    robots, rows = wheel_robots(), []
    with tempfile.TemporaryDirectory() as folder:
        for arm in arguments.arms:
            for world in arguments.worlds:
                of_rate = {rate: Row(arm, world, rate) for rate in arguments.rates}
                for problem in problems(arm, world, arguments.problems, arguments.seed, robots, Path(folder)):
                    for row in of_rate.values():
                        stream(problem, row, 1e-3 * arguments.deadline_ms, warm_start=arguments.warm_start)
                for row in of_rate.values():
                    print(row.text(), flush=True)
                    rows.append(row)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps([asdict(row) for row in rows], indent=2) + "\n")
    bad = any(row.arrived < row.problems or max(row.ratios) > MOST or row.jump > 1e-6 for row in rows)
    for rate in arguments.rates:
        same = [row for row in rows if row.rate == rate]
        arrived, count = sum(row.arrived for row in same), sum(row.problems for row in same)
        ratios = [ratio for row in same for ratio in row.ratios] or [np.inf]
        within = sum(ratio <= MOST for ratio in ratios)
        print(f"{rate:4.0f} Hz: {arrived} of {count} arrive, {within} within {MOST} times once; most {max(ratios):.3f}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
