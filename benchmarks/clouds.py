"""Compare the CPU time of collision checks and plans for point cloud obstacles and for box obstacles.

    python benchmarks/clouds.py [--points 500 2000 10000 20000 50000] [--queries 20] [--stray METRES]

The scene is a shelf and a table made of boxes. The point cloud consists of points with a radius of 5 mm, which are
sampled evenly on the faces of the same boxes. The same joint-to-joint motions are planned in both scenes, alternately.
The script prints the CPU time for building the scene (ms), for a collision check (microseconds, in a batch of 4,000
configurations) and for a plan (median, ms), and the planning time relative to the boxes.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np

import gensim2_kpam as kpam
from gensim2 import robots
from gensim2.core.seeding import rng

Array = np.ndarray

#: Centre and half extents (m) of each box in the base frame.
BOXES = [
    ([0.6, 0.0, -0.03], [0.5, 0.8, 0.02]),
    ([0.75, 0.0, 0.35], [0.2, 0.5, 0.01]),
    ([0.75, 0.0, 0.75], [0.2, 0.5, 0.01]),
    ([0.75, 0.5, 0.37], [0.2, 0.01, 0.38]),
    ([0.75, -0.5, 0.37], [0.2, 0.01, 0.38]),
]
START = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785, 0.04, 0.04])
RADIUS = 0.005


def _at(place: list[float]) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = place
    return pose


def strewn(count: int, draw: np.random.Generator) -> Array:
    """Return points (count, 3) sampled evenly on the faces of the boxes."""
    half = np.array([h for _, h in BOXES])
    faces = np.stack([half[:, 1] * half[:, 2], half[:, 0] * half[:, 2], half[:, 0] * half[:, 1]], axis=1)
    pick = draw.choice(faces.size, size=count, p=faces.ravel() / faces.sum())
    box, axis = pick // 3, pick % 3
    local = draw.uniform(-1, 1, (count, 3))
    local[np.arange(count), axis] = np.sign(local[np.arange(count), axis])
    return np.array([m for m, _ in BOXES])[box] + local * half[box]


def spent(work: Callable[[], object]) -> float:
    """Return the CPU time of ``work``, s."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def built(robot: kpam.Robot, body: kpam.Body) -> None:
    """Build a scene with an obstacle, and run one check so that the data for collision checks are computed."""
    kpam.Scene(robot, [body]).in_collision(START)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, nargs="+", default=[500, 2000, 10_000, 20_000, 50_000])
    parser.add_argument("--queries", type=int, default=20)
    parser.add_argument("--stray", type=float, help="add one point at this distance (m) from the base")
    options = parser.parse_args(arguments)
    robot = robots.robot("panda").model
    draw = rng(0, "clouds", 0)
    rigid = [kpam.Body(f"box {k}", "rigid", [kpam.Shape.box(h)], _at(m)) for k, (m, h) in enumerate(BOXES)]
    boxes = kpam.Scene(robot, rigid)
    goals: list[Array] = []
    while len(goals) < options.queries:
        q = np.concatenate([draw.uniform(robot.lower[:7], robot.upper[:7]), [0.04, 0.04]])
        if boxes.distance(q, 0.1) > 0.03:
            goals.append(q)
    rows = np.concatenate([draw.uniform(robot.lower[:7], robot.upper[:7], (4000, 7)), np.full((4000, 2), 0.04)], axis=1)

    def figures(scene: kpam.Scene) -> tuple[float, float, int]:
        check = statistics.median(spent(lambda: scene.in_collision(rows)) for _ in range(3)) / len(rows)
        plans = [scene.plan_to(START, goal) for goal in goals]
        return 1e6 * check, statistics.median(p.cpu_ms for p in plans), sum(p.status == "solved" for p in plans)

    check, plan, solved = figures(boxes)
    print(f"{'boxes':>8}: check {check:6.2f} us, plan {plan:7.2f} ms, {solved} of {len(goals)}")
    for count in options.points:
        points = strewn(count, draw)
        if options.stray is not None:
            points = np.concatenate([points, [[options.stray, 0.0, 0.0]]])
        body = kpam.Body("cloud", "rigid", [kpam.Shape.point_cloud(points, RADIUS)], np.eye(4))
        build = statistics.median(spent(partial(built, robot, body)) for _ in range(5))
        check, among, solved = figures(kpam.Scene(robot, [body]))
        print(
            f"{count:8d}: built in {1e3 * build:6.2f} ms, check {check:6.2f} us, plan {among:7.2f} ms "
            f"({among / plan:.2f} times boxes), {solved} of {len(goals)}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
