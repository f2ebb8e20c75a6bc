"""Test that commands never exceed a limit: random and hostile targets, checked with NumPy and coal.

    python benchmarks/limits.py [--actions 1000000] [--seed 0] [--speed 0.1] [--robot panda|fr3] [--json OUT]

Random targets are steps, ramps, noise, jumps between the joint limits, poses inside the table and inside the robot,
oscillations faster than the arm, NaN and infinity. The resulting commands are checked by independent code, from joint
positions only: the first, second and third differences, the tool speed by other kinematics, and coal's distances of the
link hulls to each other and to the table. The script prints the largest value of each quantity as a fraction of its
limit, and the number of commands beyond each limit. The exit code is 1 if a command exceeded a limit.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import coal
import numpy as np
from parts import Moved, least_distance, part
from peers import Arm

from gensim2.core.seeding import rng
from gensim2.robots import robot
from gensim2_robot.arm_limits import CYCLE, ArmLimits
from gensim2_robot.limits import RefusedError, begin, limit

Array = np.ndarray

SHARE = 1e-6
"""Relative tolerance of limits, because differences of positions have rounding errors."""
NEARER = 2e-4
"""Tolerance of coal's distances, m, as in the other checks."""
BLOCK = 20_000


@dataclass(frozen=True)
class Published:
    """Published limits of an arm, independent of the tested code.

    Attributes:
        velocity, acceleration, jerk: (7,) maximum velocity, acceleration and jerk, rad/s, rad/s^2 and rad/s^3.
        lower, upper: (7,) joint limits, rad.
        gain, offset, end_lower, end_upper: (7,) parameters of velocity limits that decrease near the ends of a joint's
            range: sqrt(gain * distance to the end) - offset. An infinite gain means a constant velocity limit.
    """

    velocity: Array
    acceleration: Array
    jerk: Array
    lower: Array
    upper: Array
    gain: Array = field(default_factory=lambda: np.full(7, np.inf))
    offset: Array = field(default_factory=lambda: np.zeros(7))
    end_lower: Array = field(default_factory=lambda: np.full(7, -10.0))
    end_upper: Array = field(default_factory=lambda: np.full(7, 10.0))

    def fastest(self, q: Array, sign: Array) -> Array:
        """Return the maximum speed (N, 7), rad/s, at joint positions (N, 7), in the direction of ``sign`` (N, 7)."""
        room = np.where(sign > 0.0, self.end_upper - q, q - self.end_lower)
        return np.minimum(self.velocity, np.maximum(0.0, np.sqrt(self.gain * np.maximum(room, 0.0)) - self.offset))


PUBLISHED = {
    "panda": Published(
        velocity=np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]),
        acceleration=np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
        jerk=500.0 * np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
        lower=np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]),
        upper=np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]),
    ),
    "fr3": Published(
        velocity=np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]),
        acceleration=np.full(7, 10.0),
        jerk=np.full(7, 5000.0),
        lower=np.array([-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159]),
        upper=np.array([2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159]),
        gain=np.array([12.0, 5.17, 7.0, 8.0, 34.0, 11.0, 34.0]),
        offset=np.array([0.3, 0.2, 0.2, 0.3, 0.35, 0.35, 0.35]),
        end_lower=np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196]),
        end_upper=np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196]),
    ),
}


def hostile(count: int, draw: np.random.Generator, start: Array, arm: Published) -> Iterator[Array]:
    """Yield hostile targets (7,); each kind lasts up to two seconds."""
    sent = 0
    here = start.copy()
    while sent < count:
        kind, length = draw.integers(9), int(draw.integers(1, 200))
        goal = draw.uniform(arm.lower - 0.5, arm.upper + 0.5)
        rate, phase = draw.uniform(0.0, 60.0), draw.uniform(0, 2 * np.pi, 7)
        for step in range(min(length, count - sent)):
            if kind == 0:
                target = goal
            elif kind == 1:
                target = here + (goal - here) * (step + 1) / length
            elif kind == 2:
                target = here + draw.normal(0.0, 0.05, 7)
            elif kind == 3:
                target = np.where(draw.random(7) < 0.5, arm.lower, arm.upper)
            elif kind == 4:
                target = np.array([goal[0], 1.7, 0.0, -1.0, 0.0, 2.5, 0.0])  # a pose inside the table
            elif kind == 5:
                target = np.array([goal[0], -1.7, 0.0, -3.0, goal[4], 0.2, 0.0])  # a pose inside the robot
            elif kind == 6:
                target = here + 0.4 * np.sin(rate * CYCLE * step + phase)
            elif kind == 7:
                target = goal * 10.0 ** draw.uniform(0, 300)
            else:
                target = goal.copy()
                target[draw.integers(7)] = draw.choice([np.nan, np.inf, -np.inf])
            yield target
        sent += length
        here = np.clip(goal, arm.lower, arm.upper)


def commands(count: int, seed: int, speed: float, name: str, margin: float) -> tuple[Array, Counter[str], float]:
    """Send hostile targets through the tested limits.

    Returns:
        The resulting commands, (N, 7) joint positions one cycle apart; the number of clipped and refused targets by
        limit; the CPU time per command, s.
    """
    limits = ArmLimits.of(robot(name), speed=speed, margin=margin)
    start = np.array(robot(name).reset_qpos[:7])
    sent, told = begin(start, limits), Counter[str]()
    found = [sent.q]
    begun = time.process_time()
    for target in hostile(count, rng(seed, "hostile targets"), start, PUBLISHED[name]):
        try:
            sent = limit(sent, target, limits)
            told.update(sent.clips)
        except RefusedError:
            sent = limit(sent, sent.q, limits)
            told["refused"] += 1
        found.append(sent.q)
    return np.array(found), told, (time.process_time() - begun) / count


def judge(
    q: Array, speed: float, margin: float, tool_speed: float, clearance: float, name: str = "panda"
) -> dict[str, Any]:
    """Return the maximum fraction of each limit that commands used, and the number of commands beyond each limit.

    Args:
        q: (N, 7) joint positions, one cycle apart; the arm is at rest at the first position before the start.
        speed, margin, tool_speed, clearance: configured limits.
        name: name of the arm; all arms have the same links.
    """
    arm, published = Arm(), PUBLISHED[name]
    rest = np.repeat(q[:1], 3, axis=0)
    velocity = np.diff(np.concatenate([rest, q]), axis=0) / CYCLE
    acceleration = np.diff(velocity, axis=0) / CYCLE
    jerk = np.diff(acceleration, axis=0) / CYCLE
    # Subtract 1e-8 rad/s: rounding causes such velocities when a joint must not move at all.
    pace, fastest = np.abs(velocity[2:]) - 1e-8, speed * published.fastest(q, velocity[2:])
    shares = {
        "velocity": np.abs(velocity) / (speed * published.velocity),
        "velocity by position": np.where(pace > 0.0, pace / np.maximum(fastest, 1e-12), 0.0),
        "acceleration": np.abs(acceleration) / published.acceleration,
        "jerk": np.abs(jerk) / published.jerk,
    }
    found = {name: (float(each.max()), int((each > 1 + SHARE).any(axis=1).sum())) for name, each in shares.items()}
    outside = np.maximum(published.lower + margin - q, q - (published.upper - margin))
    found["position"] = (float(outside.max()), int((outside > 1e-8).any(axis=1).sum()))
    table = [part(coal.Box(2.4, 2.4, 0.06), np.eye(4))]
    below = np.eye(4)
    below[2, 3] = -0.03
    nearest, near, tool = np.inf, 0, []
    for first in range(0, len(q), BLOCK):
        rows = np.concatenate([q[first : first + BLOCK], np.full((len(q[first : first + BLOCK]), 2), 0.04)], axis=1)
        poses = {name: np.broadcast_to(pose, (len(rows), 4, 4)) for name, pose in arm.place(rows).items()}
        hand = poses["panda_hand"]
        tool.append((hand @ np.array([0.0, 0.0, 0.1034, 1.0]))[:, :3])
        every = np.arange(len(rows))
        bodies = {name: Moved(name, arm.parts[name], poses[name]) for name in arm.parts}
        pairs = [(bodies[link], Moved("table", table, below[None])) for link in arm.moving_links]
        pairs += [(bodies[a], bodies[b]) for a, b in arm.self_pairs]
        for one, two in pairs:
            closest = least_distance(one, two, every, clearance)
            if closest is not None:
                nearest = min(nearest, closest[0])
                near += closest[0] < clearance - NEARER
    path = np.concatenate(tool)
    pace = np.linalg.norm(np.diff(path, axis=0), axis=1) / CYCLE / tool_speed
    found["tool speed"] = (float(pace.max()), int((pace > 1 + SHARE).sum()))
    found["clearance"] = (float(nearest), near)
    found["workspace"] = (
        float(path[:, 2].min()),
        int(((path < [-0.3, -0.9, 0.0]) | (path > [0.95, 0.9, 1.25])).any(axis=1).sum()),
    )
    return {name: {"most": most, "passed": passed} for name, (most, passed) in found.items()}


def run(actions: int, seed: int, speed: float, name: str = "panda", margin: float = 0.1) -> dict[str, Any]:
    """Return the results of ``actions`` hostile targets."""
    q, told, cost = commands(actions, seed, speed, name, margin)
    found = judge(q, speed, margin, speed * 1.7, 0.005, name)
    return {
        "robot": name,
        "actions": actions,
        "speed": speed,
        "limits": found,
        "passed": sum(each["passed"] for each in found.values()),
        "clips": dict(told),
        "moved_rad": float(np.abs(np.diff(q, axis=0)).sum()),
        "cpu_us_a_command": 1e6 * cost,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--actions", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--speed", type=float, default=0.1)
    parser.add_argument("--robot", choices=sorted(PUBLISHED), default="panda")
    parser.add_argument("--margin", type=float, default=0.1)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    figures = run(arguments.actions, arguments.seed, arguments.speed, arguments.robot, arguments.margin)
    for name, each in figures["limits"].items():
        print(f"{name:20} most {each['most']:.6g}, passed {each['passed']}")
    print(f"{figures['actions']} actions, {figures['cpu_us_a_command']:.0f} us of CPU each; {figures['clips']}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")
    return int(figures["passed"] > 0)


if __name__ == "__main__":
    sys.exit(main())
