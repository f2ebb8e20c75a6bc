"""Servo arms at 1 kHz toward targets that move among obstacles, and check every state.

    python benchmarks/servo.py [--arms panda ur xarm7 scara gantry mobile] [--minutes 10] [--seed 0] [--json OUT]
                               [--record FOLDER]

Every few seconds the target changes its kind: a pose on a smooth path with its velocity, a pose inside an obstacle, a
pose out of reach, a pose at a random place, joint values beyond the limits, a velocity, or none (rest). The obstacles
are a table, a box, a capsule and a point cloud of a box.

The limits of position, velocity, acceleration and jerk are checked by finite differences of all positions. Collisions
are checked every 50 ms by coal with kinematics of its own (mechanism.py), which do not use the solver.

Prints for each arm the CPU time of a step (median, 99 %, greatest), how often each status occurred, the largest used
fraction of each limit, and the smallest distance from an obstacle and between links. Ends with 1 if a limit is
exceeded, if bodies come closer than the margin, or if the median step takes more than 50 us.

``--record FOLDER`` writes ``ARM.jsonl`` with the scene and all targets. The Rust example ``servo_steps`` replays it,
for example under callgrind to count instructions.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

sys.path += [str(Path(__file__).parents[1] / folder) for folder in (".", "tests/common")]

from parts import Moved, least_distance
from random_plans import wheel_robots
from tests.kpam.random_problems import Solid, robot_of
from tests.kpam.six_arms import ARMS, six_arm

import gensim2_kpam as kpam
from gensim2.core.seeding import rng

Array = np.ndarray

#: Length of a step in s, and number of steps between two states that are checked for collisions.
DT, STRIDE = 0.001, 50
#: Distance in m that all bodies must keep, and tolerance of the checker, which approximates curved shapes.
MARGIN, TOLERANCE = 0.005, 4e-4
#: Relative tolerance of limits, and rounding error of finite differences of each order.
RELATIVE, ROUNDING = 1e-6, (1e-9, 1e-9, 1e-7, 1e-3)
#: Greatest median CPU time of a step in us.
MOST_US = 50.0
KINDS = ("path", "path", "path", "blocked", "unreachable", "jump", "joints", "twist", "rest")


@dataclass
class Row:
    """Figures of one arm."""

    arm: str
    steps: int = 0
    median_us: float = 0.0
    p99_us: float = 0.0
    max_us: float = 0.0
    status: dict[str, int] = field(default_factory=dict)
    #: Largest used fraction of the range, velocity, acceleration and jerk limits.
    used: list[float] = field(default_factory=lambda: [0.0] * 4)
    exceeded: int = 0
    judged: int = 0
    obstacle_mm: float = np.inf
    self_mm: float = np.inf
    #: Median distance (mm) from targets that move on a path.
    tracking_mm: float = 0.0

    def text(self) -> str:
        """Return the row as one line."""
        total = max(sum(self.status.values()), 1)
        shares = ", ".join(f"{name} {count / total:.1%}" for name, count in sorted(self.status.items()))
        used = " ".join(f"{value:.4f}" for value in self.used)
        return (
            f"{self.arm:7} {self.steps} steps: {self.median_us:.1f} us, 99 % {self.p99_us:.1f}, most {self.max_us:.0f}"
            f"; {shares}; used {used}; {self.exceeded} exceeded; {self.judged} states judged, "
            f"{self.obstacle_mm:.2f} mm from obstacles, {self.self_mm:.2f} mm between links; "
            f"path followed within {self.tracking_mm:.1f} mm"
        )


class World:
    """An arm among obstacles, for the solver and for the checker."""

    def __init__(self, arm: str, robots: Path, folder: Path, seed: int) -> None:
        self.description, self.mechanism = six_arm(arm, robots)
        self.robot = robot_of(self.description, folder)
        self.draw = rng(seed, f"servo {arm}")
        self.start = self._resting()
        hand = self.mechanism.hand_poses(self.start)[0]
        self.obstacles: list[tuple[str, Solid, Array]] = []
        count = 0
        while count < 3:
            kind = ("box", "capsule", "cloud")[count]
            size = self.draw.uniform(0.04, 0.1, 3)
            solid = Solid("box", size.tolist()) if kind != "capsule" else Solid("capsule", [0.04, 0.3])
            if kind == "cloud":
                solid = Solid("cloud", [0.012], surface(size, self.draw))
            pose = np.eye(4)
            pose[:3, 3] = hand[:3, 3] + self.draw.normal(0.0, 0.25, 3)
            # The distance of a scene includes the links among themselves, which are closer in some arms.
            if self._is_free(solid, pose):
                self.obstacles.append((kind, solid, pose))
                count += 1
        floor = np.eye(4)
        floor[2, 3] = -0.5 if self.mechanism.hand_poses(self.start)[0][2, 3] < 0.1 else -0.03
        self.obstacles.append(("table", Solid("box", [1.5, 1.5, 0.02]), floor))
        self.scene = kpam.Scene(self.robot, [kpam.Body(n, "rigid", s.ours(), p) for n, s, p in self.obstacles])

    def _is_free(self, solid: Solid, pose: Array) -> bool:
        """Return whether every moving link keeps 30 mm from a solid at the start."""
        placed, other = self.mechanism.place(self.start[None]), Moved("obstacle", solid.theirs(), pose[None])
        for name in self.mechanism.moving_links:
            link = Moved(name, self.mechanism.parts[name], placed[name])
            found = least_distance(link, other, np.arange(1), 0.04)
            if found is not None and found[0] < 0.03:
                return False
        return True

    def _resting(self) -> Array:
        """Return a start whose links keep 30 mm from each other and from the table."""
        floor = np.eye(4)
        floor[2, 3] = -0.03
        scene = kpam.Scene(self.robot, [kpam.Body("table", "rigid", [kpam.Shape.box([1.5, 1.5, 0.02])], floor)])
        lower, upper = np.maximum(self.mechanism.lower, -2.0), np.minimum(self.mechanism.upper, 2.0)
        best, most = None, -np.inf
        for _ in range(300):
            q = self.mechanism.coupled(self.draw.uniform(lower, upper))
            distance = float(scene.distance(q))
            if distance > most and self.mechanism.hand_poses(q)[0][2, 3] > 0.15:
                best, most = q, distance
        assert best is not None
        return best

    def reach(self) -> float:
        """Return about how far the hand gets from the base."""
        lower, upper = np.maximum(self.mechanism.lower, -3.0), np.minimum(self.mechanism.upper, 3.0)
        q = self.mechanism.coupled(self.draw.uniform(lower, upper, (500, len(lower))))
        return float(np.linalg.norm(self.mechanism.hand_poses(q)[:, :3, 3], axis=1).max())


def surface(half: Array, draw: np.random.Generator, count: int = 250) -> Array:
    """Return points (count, 3) on the faces of a box."""
    points = draw.uniform(-1.0, 1.0, (count, 3))
    points[np.arange(count), draw.integers(0, 3, count)] = draw.choice([-1.0, 1.0], count)
    return points * half


class Targets:
    """A target that changes its kind every few seconds."""

    def __init__(self, world: World) -> None:
        self.world, self.draw, self.reach = world, world.draw, world.reach()
        self.left, self.kind = 0, "rest"

    def next(self, q: Array) -> dict[str, Any]:
        """Return the arguments of the next step."""
        if self.left == 0:
            self.left = int(self.draw.uniform(0.5, 6.0) / DT)
            self.kind = str(self.draw.choice(KINDS))
            self._begin(q)
        self.left -= 1
        if self.kind == "rest":
            return {}
        if self.kind == "joints":
            return {"target": self.joints}
        if self.kind == "twist":
            return {"twist": self.twist}
        if self.kind == "path":
            self.time += DT
            pose, twist = self.pose.copy(), np.zeros(6)
            phase = self.rates * self.time
            pose[:3, 3] += self.widths * np.sin(phase)
            twist[:3] = self.widths * self.rates * np.cos(phase)
            self.now = pose
            return {"target": pose, "twist": twist}
        return {"target": self.pose}

    def _begin(self, q: Array) -> None:
        draw, mechanism = self.draw, self.world.mechanism
        lower, upper = np.maximum(mechanism.lower, -3.0), np.minimum(mechanism.upper, 3.0)
        random = mechanism.hand_poses(mechanism.coupled(draw.uniform(lower, upper)))[0].copy()
        self.pose, self.time = random, 0.0
        self.twist = draw.normal(0.0, 1.0, 6)
        moved = sorted(mechanism.movers(mechanism.hand_link))
        self.joints = q.copy()
        self.joints[moved] = draw.uniform(lower[moved] - 0.5, upper[moved] + 0.5)
        self.joints = mechanism.coupled(self.joints)
        if self.kind == "path":
            # The path begins at the hand.
            self.pose = mechanism.hand_poses(q)[0].copy()
            self.widths, self.rates = draw.uniform(-0.25, 0.25, 3), draw.uniform(0.5, 4.0, 3)
        elif self.kind == "blocked":
            _, solid, pose = self.world.obstacles[int(draw.integers(0, len(self.world.obstacles)))]
            inside = np.array(solid.size) * 0.3 if solid.kind == "box" else np.full(3, 0.03)
            self.pose[:3, 3] = pose[:3, 3] + draw.uniform(-inside, inside)
        elif self.kind == "unreachable":
            away = draw.normal(0.0, 1.0, 3)
            self.pose[:3, 3] = away / np.linalg.norm(away) * draw.uniform(1.1, 2.0) * self.reach


def limits_of(arm: str, joints: int) -> dict[str, Any]:
    """Return acceleration and jerk limits: the Panda's own, typical ones for the other arms."""
    if arm == "panda":
        return {"limits": "plain"}
    return {"acceleration_limits": [8.0] * joints, "jerk_limits": [300.0] * joints}


def check_limits(row: Row, world: World, moved: list[int], path: Array, most: tuple[float, float]) -> None:
    """Compare finite differences of positions (M, n) with the limits of the moving joints."""
    mechanism = world.mechanism
    q = path[:, moved]
    bounded = np.isfinite(mechanism.upper[moved] - mechanism.lower[moved])
    lower, upper = mechanism.lower[moved][bounded], mechanism.upper[moved][bounded]
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    if bounded.any():
        used = np.abs(q[:, bounded] - middle) / half
        row.used[0] = max(row.used[0], float(used.max()))
        row.exceeded += int((np.abs(q[:, bounded] - middle) > half + 1e-6).sum())
    limits = [mechanism.velocity[moved], *(np.full(len(moved), value) for value in most)]
    for order, limit in enumerate(limits, start=1):
        rates = np.abs(np.diff(q, order, axis=0)) / DT**order
        row.used[order] = max(row.used[order], float((rates / limit).max()))
        row.exceeded += int((rates > limit * (1.0 + RELATIVE) + ROUNDING[order]).sum())


def check_collisions(row: Row, world: World, path: Array) -> None:
    """Measure the distances of all pairs at joint vectors (M, n) with coal."""
    mechanism = world.mechanism
    placed = mechanism.place(path)
    samples = np.arange(len(path))
    row.judged += len(path)
    links = {name: Moved(name, mechanism.parts[name], placed[name]) for name in mechanism.parts}
    for name in mechanism.moving_links:
        for body, solid, pose in world.obstacles:
            found = least_distance(links[name], Moved(body, solid.theirs(), pose[None]), samples, 0.02)
            row.obstacle_mm = min(row.obstacle_mm, np.inf if found is None else 1e3 * found[0])
    for one, two in mechanism.self_pairs:
        found = least_distance(links[one], links[two], samples, 0.02)
        row.self_mm = min(row.self_mm, np.inf if found is None else 1e3 * found[0])


class Recording:
    """A file with a scene, the servo's options and all targets, for ``crates/kpam/examples/servo_steps.rs``."""

    def __init__(self, path: Path, world: World, options: dict[str, Any]) -> None:
        description = world.description
        file = description.file or Path("arm.urdf")
        header = {
            "urdf": description.urdf,
            "file": str(file),
            "srdf": None if description.srdf is None else description.srdf.read_text(),
            "hand": description.hand,
            "bodies": [
                {
                    "name": name,
                    "kind": solid.kind,
                    "size": [float(value) for value in solid.size],
                    "points": None if solid.points is None else solid.points.tolist(),
                    "pose": pose.tolist(),
                }
                for name, solid, pose in world.obstacles
            ],
            "start": world.start.tolist(),
            "margin": MARGIN,
            "dt": DT,
            "options": options,
        }
        self._file = path.open("w")
        self._file.write(json.dumps(header) + "\n")

    def add(self, arguments: dict[str, Any]) -> None:
        """Write the target of one step."""
        self._file.write(json.dumps({name: np.asarray(value).tolist() for name, value in arguments.items()}) + "\n")

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def run(arm: str, minutes: float, seed: int, robots: Path, folder: Path, record: Path | None = None) -> Row:
    """Servo one arm; write its scene and targets to ``record``."""
    world = World(arm, robots, folder, seed)
    row, targets = Row(arm), Targets(world)
    joints = len(world.start)
    options = limits_of(arm, joints)
    moved = sorted(world.mechanism.movers(world.mechanism.hand_link))
    most = (10.0, 5000.0) if arm == "panda" else (8.0, 300.0)
    servo = kpam.Servo(world.scene, world.start, margin=MARGIN, dt=DT, **options)
    total, block = round(60.0 * minutes / DT), 10_000
    times = np.zeros(total)
    recording = None if record is None else Recording(record, world, options)
    q, last = world.start, np.tile(world.start, (3, 1))
    status: Counter[str] = Counter()
    errors: list[float] = []
    for begin in range(0, total, block):
        count = min(block, total - begin)
        path = np.zeros((count, joints))
        for step in range(count):
            arguments = targets.next(q)
            if recording is not None:
                recording.add(arguments)
            clock = time.thread_time_ns()
            done = servo.step(**arguments)
            times[begin + step] = 1e-3 * (time.thread_time_ns() - clock)
            q = done.position
            path[step] = q
            status[str(done.status)] += 1
            if targets.kind == "path" and step % STRIDE == 0:
                hand = world.mechanism.hand_poses(q)[0]
                errors.append(float(np.linalg.norm(hand[:3, 3] - targets.now[:3, 3])))
        path = np.concatenate([last, path])
        check_limits(row, world, moved, path, most)
        check_collisions(row, world, path[3::STRIDE])
        last = path[-3:]
    if recording is not None:
        recording.close()
    row.steps, row.status = total, dict(status)
    row.median_us, row.p99_us, row.max_us = (float(f) for f in np.percentile(times, [50, 99, 100]))
    row.tracking_mm = 1e3 * float(np.median(errors)) if errors else 0.0
    return row


def main() -> int:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=ARMS)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--record", type=Path, metavar="FOLDER")
    arguments = parser.parse_args()
    if arguments.record is not None:
        arguments.record.mkdir(parents=True, exist_ok=True)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for arm in arguments.arms:
            record = None if arguments.record is None else arguments.record / f"{arm}.jsonl"
            rows.append(run(arm, arguments.minutes, arguments.seed, wheel_robots(), Path(folder), record))
            print(rows[-1].text(), flush=True)
            if arguments.json is not None:
                arguments.json.write_text(json.dumps([asdict(row) for row in rows], indent=2) + "\n")
    least = 1e3 * (MARGIN - TOLERANCE)
    bad = any(row.exceeded or row.obstacle_mm < least or row.self_mm < 0.0 for row in rows)
    return 1 if bad or any(row.median_us > MOST_US for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
