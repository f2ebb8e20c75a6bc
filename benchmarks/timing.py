"""Durations of motions relative to time-optimal ones on the same paths.

    python benchmarks/timing.py [--problems FILE [--assets DIR] [--every 4]] [--paths 60] [--seed 0]

The yardstick is toppra, on the same geometric path with the same stops and the same velocity and acceleration limits;
it knows no limit on jerk. Two kinds of paths: splines through random waypoints with random limits, and the motions of
recorded problems as planned, read off the trajectory between the places where it rests. Each with the jerk limits
lifted tenfold, and with the limits as they are (Franka's published ones). Times are CPU time, taken in turn.

Then, for acceleration and jerk limits from Franka's down to 2 rad/s² and 10 rad/s³: straight motions from rest to rest
beside Ruckig at the same limits, and the random paths beside toppra without a limit on jerk.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import ruckig
import toppra
import toppra.algorithm
import toppra.constraint

import gensim2_kpam as kpam
from gensim2 import robots
from gensim2.bench.problems import read_problems
from gensim2.bench.scene import check_assets, problem_scene
from gensim2.bench.solver import keypoint_problem
from gensim2.core.seeding import rng

Array = np.ndarray

#: Franka's published limits, and the Panda's joint velocities.
VELOCITY = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
ACCELERATION = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])
JERK = np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10_000.0, 10_000.0])

#: Acceleration and jerk limits (rad/s², rad/s³) of the table beside Ruckig and toppra; Franka's first.
GENTLE: list[tuple[Array, Array]] = [(ACCELERATION, JERK)] + [
    (np.full(7, a), np.full(7, j)) for a, j in ((10.0, 300.0), (5.0, 50.0), (2.0, 10.0))
]

#: Chord (rad) between the points at which a planned path is read off.
CHORD = 0.01


def toppra_seconds(waypoints: Array, velocity: Array, acceleration: Array) -> float:
    """Duration of toppra's motion along the natural spline through (N, n) waypoints over their chord length."""
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(waypoints, axis=0), axis=1))])
    path = toppra.SplineInterpolator(chord, waypoints, bc_type="natural")
    limits = [
        toppra.constraint.JointVelocityConstraint(np.column_stack([-velocity, velocity])),
        toppra.constraint.JointAccelerationConstraint(np.column_stack([-acceleration, acceleration])),
    ]
    grid = np.linspace(0.0, chord[-1], max(200, 2 * len(waypoints)))
    found = toppra.algorithm.TOPPRA(limits, path, gridpoints=grid, solver_wrapper="seidel").compute_trajectory()
    return float("nan") if found is None else float(found.duration)


def spent(call: Callable[[], Any]) -> tuple[float, Any]:
    """CPU time (ms) of a call, and what it returned."""
    begin = time.process_time()
    out = call()
    return 1e3 * (time.process_time() - begin), out


def random_paths(count: int, seed: int) -> list[tuple[Array, int, Array]]:
    """Waypoints, one stop, and factors of the limits."""
    out = []
    for index in range(count):
        draw = rng(seed, "timing", index)
        waypoints = np.cumsum(draw.normal(0.0, 0.5, (int(draw.integers(3, 9)), 7)), axis=0)
        out.append((waypoints, int(draw.integers(1, len(waypoints))), draw.uniform(0.2, 1.0, 7)))
    return out


def on_random_paths(paths: list[tuple[Array, int, Array]], jerk_factor: float) -> None:
    """Print durations of random paths as multiples of toppra's, and the CPU times."""
    ratios: list[float] = []
    cpu: dict[str, list[float]] = {"retime": [], "toppra": []}
    for waypoints, stop, factors in paths:
        velocity, acceleration = factors * VELOCITY, factors * ACCELERATION
        pieces = [part for part in (waypoints[: stop + 1], waypoints[stop:]) if len(part) > 1]

        def reference(pieces: list[Array] = pieces, v: Array = velocity, a: Array = acceleration) -> float:
            return sum(toppra_seconds(piece, v, a) for piece in pieces)

        milliseconds, best = spent(reference)
        cpu["toppra"].append(milliseconds)

        def ours(w: Array = waypoints, s: int = stop, f: Array = factors) -> kpam.Trajectory:
            return kpam.retime(w, f * VELOCITY, f * ACCELERATION, jerk_factor * f * JERK, stops=[s])[0]

        milliseconds, motion = spent(ours)
        cpu["retime"].append(milliseconds)
        ratios.append(motion.duration / best)
    show("random paths", ratios)
    costs = ", ".join(f"{name} {np.median(values):.2f}" for name, values in cpu.items())
    print(f"    CPU ms a path, medians: {costs}")


def pieces_of(trajectory: kpam.Trajectory) -> list[Array]:
    """Paths of a motion between the places where it rests, read off at even chords."""
    times = trajectory.times
    fine = np.unique(np.concatenate([times, np.arange(times[0], times[-1], 0.002)]))
    positions, velocities, _ = trajectory.sample(fine)
    resting = np.flatnonzero(np.abs(velocities).max(axis=1) < 1e-9)
    out = []
    for begin, end in pairwise(resting):
        points = positions[begin : end + 1, :7]
        chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        if chord[-1] > 1e-4:
            even = np.linspace(0.0, chord[-1], max(3, int(np.ceil(chord[-1] / CHORD)) + 1))
            out.append(np.column_stack([np.interp(even, chord, column) for column in points.T]))
    return out


def on_problems(problems: Path, assets: Path | None, every: int, jerk_factor: float) -> None:
    """Print durations of recorded problems' whole motions over toppra's on their paths."""
    robot = robots.robot("panda").model
    folder = None if assets is None else check_assets(assets)
    limits = {"velocity_limits": VELOCITY, "acceleration_limits": ACCELERATION, "jerk_limits": jerk_factor * JERK}
    options: Any = {name: np.append(row, [1.0, 1.0]) for name, row in limits.items()} | {"timing": "limits"}
    ratios, seconds, stops = [], [], []
    for problem in read_problems(problems)[::every]:
        scene = problem_scene(problem, folder, robot.forward_kinematics(np.asarray(problem.q_current)))
        plan = kpam.plan(keypoint_problem(problem, scene, robot, options=options))
        if plan.status != "solved" or plan.trajectory is None:
            continue
        pieces = pieces_of(plan.trajectory)
        best = sum(toppra_seconds(piece, VELOCITY, ACCELERATION) for piece in pieces)
        ratios.append(plan.trajectory.duration / best)
        seconds.append(plan.trajectory.duration)
        stops.append(len(pieces))
    show("planned motions", ratios)
    print(f"    duration {np.median(seconds):.2f} s (median), in {np.mean(stops):.2f} pieces from rest to rest")


def ruckig_seconds(
    begin: Array, end: Array, acceleration: Array, jerk: Array, rates: tuple[Array, Array] | None = None
) -> float:
    """Return the duration of Ruckig's motion to rest at ``end``.

    From rest all joints move in phase where their limits allow it. ``rates`` are the start's velocity and acceleration.
    """
    question = ruckig.InputParameter(len(begin))
    question.current_position, question.target_position = begin.tolist(), end.tolist()
    if rates is not None:
        question.current_velocity, question.current_acceleration = rates[0].tolist(), rates[1].tolist()
    question.max_velocity = VELOCITY.tolist()
    question.max_acceleration, question.max_jerk = acceleration.tolist(), jerk.tolist()
    question.synchronization = ruckig.Synchronization.Phase
    found = ruckig.Trajectory(len(begin))
    if ruckig.Ruckig(len(begin)).calculate(question, found) not in (ruckig.Result.Working, ruckig.Result.Finished):
        return float("nan")
    return float(found.duration)


def from_moving_states(count: int, seed: int) -> None:
    """Print the durations of motions from random moving states to rest over Ruckig's, limit by limit."""
    print("duration from random moving states over Ruckig's:")
    for acceleration, jerk in GENTLE:
        label = "Franka's" if acceleration is ACCELERATION else f"({acceleration[0]:g}, {jerk[0]:g})"
        ratios = []
        for index in range(count):
            draw = rng(seed, "moving states", index)
            ends = draw.uniform(-2.0, 2.0, (2, 7))
            gain = draw.uniform(-1.0, 1.0, 7) * np.minimum(acceleration, 0.9 * np.sqrt(jerk * VELOCITY))
            velocity = draw.uniform(-1.0, 1.0, 7) * (VELOCITY - 0.5 * gain**2 / jerk)
            motion, _ = kpam.retime(
                ends, VELOCITY, acceleration, jerk, start_velocity=velocity, start_acceleration=gain
            )
            ratios.append(motion.duration / ruckig_seconds(ends[0], ends[1], acceleration, jerk, (velocity, gain)))
        show(label, ratios)


def worst_share(motion: kpam.Trajectory, acceleration: Array, jerk: Array) -> float:
    """Greatest share of a limit that a motion takes, by differences of its samples."""
    times = np.linspace(0.0, motion.duration, 4001)
    _, v, a = motion.sample(times)
    rates = np.abs(np.diff(a, axis=0)) / times[1]
    return float(max((np.abs(v) / VELOCITY).max(), (np.abs(a) / acceleration).max(), (rates / jerk).max()))


def at_gentle_limits(count: int, seed: int) -> None:
    """Print durations over Ruckig's on straight motions and over toppra's on curved ones, limit by limit."""
    print(
        "duration by acceleration and jerk limits: straight over Ruckig's, curved over toppra's (which knows no jerk):"
    )
    paths = random_paths(count, seed)
    for acceleration, jerk in GENTLE:
        label = "Franka's" if acceleration is ACCELERATION else f"({acceleration[0]:g}, {jerk[0]:g})"
        straight, curved, cpu, share = [], [], [], 0.0
        for index, (waypoints, stop, _) in enumerate(paths):
            draw = rng(seed, "straight", index)
            ends = np.stack([np.zeros(7), draw.normal(0.0, 1.0, 7) * 10.0 ** draw.uniform(-1.5, 0.3)])
            motion, _ = kpam.retime(ends, VELOCITY, acceleration, jerk)
            straight.append(motion.duration / ruckig_seconds(ends[0], ends[1], acceleration, jerk))
            share = max(share, worst_share(motion, acceleration, jerk))
            milliseconds, (motion, _) = spent(
                partial(kpam.retime, waypoints, VELOCITY, acceleration, jerk, stops=[stop])
            )
            pieces = [part for part in (waypoints[: stop + 1], waypoints[stop:]) if len(part) > 1]
            best = sum(toppra_seconds(piece, VELOCITY, acceleration) for piece in pieces)
            curved.append(motion.duration / best)
            cpu.append(milliseconds)
            share = max(share, worst_share(motion, acceleration, jerk))
        show(f"{label} straight", straight)
        show(f"{label} curved", curved)
        print(f"    CPU ms a curved path, median: {np.median(cpu):.2f}; greatest share of a limit: {share:.7f}")


def show(label: str, ratios: list[float]) -> None:
    """Print a row of the table."""
    middle, high = np.percentile(ratios, [50, 95])
    print(f"  {label}: {len(ratios)} x, median {middle:.3f}, 95th percentile {high:.3f}, most {max(ratios):.3f}")


def main(arguments: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=Path)
    parser.add_argument("--assets", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--paths", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    toppra.setup_logging("ERROR")
    paths = random_paths(options.paths, options.seed)
    for jerk_factor in (10.0, 1.0):
        print(f"duration over toppra's, jerk limits {jerk_factor:g} times Franka's:")
        on_random_paths(paths, jerk_factor)
        if options.problems is not None:
            on_problems(options.problems, options.assets, options.every, jerk_factor)
    at_gentle_limits(options.paths, options.seed)
    from_moving_states(10 * options.paths, options.seed)
    return 0


if __name__ == "__main__":
    sys.exit(main())
