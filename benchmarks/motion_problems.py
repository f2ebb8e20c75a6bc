"""Generate motion planning problems for the Panda, for tuning the planner. They resemble MotionBenchMaker's problems.

    python benchmarks/motion_problems.py --out FILE.jsonl [--each 20] [--seed 0]

The problems are not part of MotionBenchMaker, so that its problems remain a test set. There are seven kinds of scenes:
three kinds of shelves with cylinders on their boards, an open box, a barred cage, and a cluttered table, with the start
above or below the table. Sizes are realistic; positions and yaws are random. The motion begins at the rest pose, or
below the table, and ends at a random grasp pose of an object, which is computed by inverse kinematics from random start
values. Start and goal keep a distance of 6 mm from all obstacles. The file has the format of ``gensim2 bench motion``
(docs/reference/benchmarks.md). The same seed gives the same file.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import gensim2_kpam as kpam
from gensim2 import robots
from gensim2.bench.motion import FINGERS_OPEN, obstacle_body
from gensim2.core.seeding import rng

Array = np.ndarray
Obstacle = dict[str, Any]

#: Rest pose of the arm (rad), and minimum distance of start and goal from obstacles (m).
READY = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
CLEARANCE = 0.006
#: Distance from the hand's origin to the point between the fingertips, m.
REACH = 0.1034
#: Maximum number of hand poses that are tried for one grasp position, and of scenes that are tried for one problem.
POSES = 60
SCENES = 200


def turned(angle: float, axis: int = 2) -> Array:
    """Return the rotation (3, 3) by ``angle`` (rad) about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i], out[j, j], out[i, j], out[j, i] = c, c, -s, s
    return out


class Furniture:
    """A group of obstacles. They are given in the frame of the group, and stored in the base frame."""

    def __init__(self, place: Array, yaw: float) -> None:
        self.place, self.turn = np.asarray(place, dtype=float), turned(yaw)
        self.obstacles: list[Obstacle] = []

    def at(self, point: Array) -> Array:
        """Transform a point (3,) from the frame of the group to the base frame."""
        return self.turn @ np.asarray(point, dtype=float) + self.place

    def _add(self, kind: str, point: Array, turn: Array, **size: Any) -> None:
        # The conversion needs w > 0, or a rotation by 180° about z; all rotations in this module fulfil this.
        m = self.turn @ turn
        w = np.sqrt(max(0.0, 1 + np.trace(m))) / 2
        x, y, z = (m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1])
        q = [w, x / (4 * w), y / (4 * w), z / (4 * w)] if w > 1e-6 else [0.0, 0.0, 0.0, 1.0]
        position = [float(v) for v in self.at(point)]
        self.obstacles.append({"type": kind, **size, "position": position, "quaternion_wxyz": [float(v) for v in q]})

    def box(self, half: tuple[float, float, float], point: Array, turn: Array | None = None) -> None:
        """Add a box with half extents ``half`` (m) at ``point`` (3,), in the frame of the group."""
        self._add("box", point, np.eye(3) if turn is None else turn, half_extents=[float(h) for h in half])

    def cylinder(self, radius: float, length: float, point: Array) -> None:
        """Add an upright cylinder at ``point`` (3,), in the frame of the group; lengths in m."""
        self._add("cylinder", point, np.eye(3), radius=radius, length=length)


#: Obstacles; position (3,) to be grasped; function that samples the hand's rotation at the grasp; start position (3,)
#: of the hand, or None for the rest pose. Positions are in the base frame, m.
Scene = tuple[list[Obstacle], Array, Callable[[np.random.Generator], Array], Array | None]


def pointing(yaw: float, aside: float, down: tuple[float, float]) -> Callable[[np.random.Generator], Array]:
    """Return a function that samples hand rotations (3, 3).

    The hand points in the direction ``yaw``, with a deviation of at most ``aside``, and ``down`` (minimum, maximum)
    below the horizontal plane. All angles are in rad.
    """

    def draw(random: np.random.Generator) -> Array:
        azimuth, dip = yaw + random.uniform(-aside, aside), random.uniform(*down)
        z = np.array([np.cos(dip) * np.cos(azimuth), np.cos(dip) * np.sin(azimuth), -np.sin(dip)])
        across = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        y = across if random.random() < 0.5 else -across
        return np.column_stack([np.cross(y, z), y, z])

    return draw


def _around(random: np.random.Generator, distance: tuple[float, float]) -> tuple[Array, float]:
    """Return a random point (2,) with a distance from the base in the range ``distance`` (m), and its yaw (rad)."""
    yaw = random.uniform(-2.0, 2.0) if random.random() < 0.8 else random.uniform(-2.8, 2.8)
    return random.uniform(*distance) * np.array([np.cos(yaw), np.sin(yaw)]), yaw


def shelf(kind: str) -> Callable[[np.random.Generator], Scene]:
    """Return a function that samples scenes with a shelf: two boards (small), four (tall), or six and a wall (thin)."""

    def draw(random: np.random.Generator) -> Scene:
        deep, wide = (0.31, 0.5) if kind == "thin" else (0.6, 0.5)
        middle, yaw = _around(random, (deep + 0.45, deep + 0.62))
        low = random.uniform(*{"small": (0.1, 0.35), "tall": (-0.1, 0.1), "thin": (-0.4, -0.3)}[kind])
        yaw += random.uniform(-0.25, 0.25)
        out = Furniture(np.array([*middle, low]), yaw)
        boards, step = {"small": (2, 0.3), "tall": (4, 0.3), "thin": (6, 0.25)}[kind]
        for k in range(boards):
            out.box((deep, wide, 0.02), np.array([0, 0, k * step]))
        if kind == "thin":
            for x in (-deep, deep):
                for y in (-wide, wide):
                    out.box((0.02, 0.02, 0.82), np.array([x, y, 0.47]))
            out.box((deep, 0.02, 0.7), np.array([0, 0, 0.55]))
        else:
            half = 0.17 if kind == "small" else 0.82
            for y in (-wide, wide):
                out.box((deep, 0.02, half), np.array([0, y, 0.5 * step if kind == "small" else 0.12]))
        things: list[Array] = []
        for k in range(boards - 1):
            for _ in range(3 if kind != "thin" else 2):
                at = np.array([random.uniform(-0.9 * deep, 0.0), random.uniform(-0.85, 0.85) * wide, k * step + 0.08])
                if kind == "thin" and abs(at[1]) < 0.1:
                    at[1] += 0.2
                if all(np.linalg.norm(at - other) > 0.14 for other in things):
                    things.append(at)
                    out.cylinder(0.03, 0.12, at)
        target = things[random.integers(len(things))]
        return out.obstacles, out.at(target), pointing(yaw, 0.6, (-0.3, 0.5)), None

    return draw


def box(random: np.random.Generator) -> Scene:
    """Sample a scene with an open box that contains an object; the lid is tilted up."""
    middle, yaw = _around(random, (0.5, 0.7))
    out = Furniture(np.array([*middle, random.uniform(-0.55, -0.4)]), yaw + random.uniform(-0.2, 0.2))
    out.box((0.35, 0.35, 0.02), np.zeros(3))
    # The front is lower than the other sides.
    out.box((0.02, 0.35, 0.27), np.array([-0.35, 0, 0.27]))
    out.box((0.02, 0.35, 0.33), np.array([0.35, 0, 0.33]))
    for sign in (-1, 1):
        out.box((0.35, 0.02, 0.33), np.array([0, 0.35 * sign, 0.33]))
    tilt = random.uniform(0.5, 1.2)
    hinge = np.array([0.37, 0, 0.7])
    lid = turned(tilt - np.pi, 1)
    out.box((0.35, 0.35, 0.02), hinge + lid @ np.array([0.35, 0, 0]), lid)
    target = np.array([random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2), 0.09])
    out.cylinder(0.03, 0.14, target)
    return out.obstacles, out.at(target + np.array([0, 0, 0.05])), pointing(yaw, 1.2, (0.7, 1.57)), None


def cage(random: np.random.Generator) -> Scene:
    """Sample a scene with a cage that contains a cube and has bars across its front."""
    middle, yaw = _around(random, (0.72, 0.85))
    yaw += random.uniform(-0.2, 0.2)
    out = Furniture(np.array([*middle, random.uniform(0.15, 0.35)]), yaw)
    out.box((0.35, 0.35, 0.02), np.zeros(3))
    out.box((0.325, 0.325, 0.02), np.array([0, 0, 0.71]))
    out.box((0.02, 0.35, 0.35), np.array([0.35, 0, 0.36]))
    for sign in (-1, 1):
        out.box((0.35, 0.02, 0.35), np.array([0, 0.35 * sign, 0.36]))
    for height in (0.16, 0.46):
        out.box((0.02, 0.35, 0.02), np.array([-0.35, 0, height]))
    target = np.array([random.uniform(-0.15, 0.1), random.uniform(-0.15, 0.15), 0.055])
    out.box((0.03, 0.03, 0.035), target)
    return out.obstacles, out.at(target + np.array([0, 0, 0.03])), pointing(yaw, 1.0, (0.7, 1.57)), None


def table(below: bool) -> Callable[[np.random.Generator], Scene]:
    """Return a function that samples scenes with a cluttered table; with ``below`` the motion begins below it."""

    def draw(random: np.random.Generator) -> Scene:
        middle, yaw = _around(random, (0.95, 1.15))
        top = random.uniform(0.15, 0.3) if below else random.uniform(0.0, 0.25)
        yaw += random.uniform(-0.25, 0.25)
        out = Furniture(np.array([*middle, top]), yaw)
        out.box((0.6, 1.0, 0.02), np.zeros(3))
        for x in (-0.55, 0.55):
            for y in (-0.95, 0.95):
                out.box((0.025, 0.025, 0.35), np.array([x, y, -0.37]))

        def place(height: float) -> Array:
            return np.array([random.uniform(-0.5, 0.1), random.uniform(-0.55, 0.55), height])

        out.box((0.125, 0.125, 0.125), place(0.145), turned(random.uniform(-1, 1)))
        out.cylinder(0.05, 0.35, place(0.195))
        for half in ((0.1, 0.01, 0.2), (0.01, 0.1, 0.2), (0.1, 0.025, 0.175), (0.1, 0.025, 0.175)):
            out.box(half, place(half[2] + 0.02), turned(random.uniform(-1.5, 1.5)))
        target = place(0.1)
        out.cylinder(0.03, 0.12, target)
        under = np.array([random.uniform(-0.5, -0.25), random.uniform(-0.3, 0.3), -random.uniform(0.12, 0.3)])
        goal = out.at(target)
        return out.obstacles, goal, pointing(yaw, 0.9, (0.0, 0.9)), out.at(under) if below else None

    return draw


KINDS: dict[str, Callable[[np.random.Generator], Scene]] = {
    "shelf_small": shelf("small"),
    "shelf_tall": shelf("tall"),
    "shelf_thin": shelf("thin"),
    "box": box,
    "cage": cage,
    "table": table(below=False),
    "under_table": table(below=True),
}


def joints_at(
    scene: kpam.Scene, place: Array, rotations: Callable[[np.random.Generator], Array], random: np.random.Generator
) -> Array | None:
    """Return joint positions with ``place`` between the fingertips and ``CLEARANCE``; None if none are found."""
    robot = scene.robot
    for _ in range(POSES):
        pose = np.eye(4)
        pose[:3, :3] = rotations(random)
        pose[:3, 3] = place - (REACH + random.uniform(-0.015, 0.02)) * pose[:3, 2]
        q_from = random.uniform(np.maximum(robot.lower, -3.2), np.minimum(robot.upper, 3.2))
        q_from[7:] = FINGERS_OPEN
        found = scene.ik(pose, q_from, max_solutions=4, seed=int(random.integers(1000)))
        if len(found):
            clear = np.asarray(scene.distance(found, CLEARANCE)) >= CLEARANCE
            if clear.any():
                return np.asarray(found)[clear][0]
    return None


def problem(kind: str, number: int, seed: int) -> dict[str, Any]:
    """Return a problem of a kind: the first sampled scene with a valid start and a valid goal."""
    model = robots.robot("panda").model
    ready = np.array([*READY, FINGERS_OPEN, FINGERS_OPEN])
    for attempt in range(SCENES):
        random = rng(seed, f"motion_problems/{kind}", number * SCENES + attempt)
        obstacles, place, rotations, under = KINDS[kind](random)
        scene = kpam.Scene(model, [obstacle_body(o, f"obstacle_{k}") for k, o in enumerate(obstacles)])
        if scene.distance(ready, CLEARANCE) < CLEARANCE:
            continue
        goal = joints_at(scene, place, rotations, random)
        if goal is None:
            continue
        start = ready
        if under is not None:
            found = joints_at(scene, under, pointing(float(np.arctan2(under[1], under[0])), 0.6, (-0.2, 0.4)), random)
            if found is None:
                continue
            start = found
        return {
            "id": f"{kind}/{number:04d}",
            "set": kind,
            "start": [float(v) for v in start[:7]],
            "goals": [[float(v) for v in goal[:7]]],
            "obstacles": obstacles,
        }
    raise SystemExit(f"{kind} number {number}: no scene of {SCENES} has a start and a goal")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--each", type=int, default=20, help="number of problems of each kind")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    problems = [problem(kind, k, arguments.seed) for kind in KINDS for k in range(arguments.each)]
    arguments.out.write_text("".join(json.dumps(entry) + "\n" for entry in problems))
    print(f"{len(problems)} problems")
    return 0


if __name__ == "__main__":
    sys.exit(main())
