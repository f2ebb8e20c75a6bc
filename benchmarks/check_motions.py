"""Check the motions of ``gensim2 bench motion`` independently, with Pinocchio's kinematics and coal's distances.

    python benchmarks/check_motions.py --problems FILE.jsonl --motions OUT.jsonl [--margin 0.005] [--every 1]

Each motion must begin at the start, end at a goal, and keep the joint limits. The distance between a link and an
obstacle, or between two links, must be at least the margin at every sample. If two bodies are closer than the margin at
the start or end of a motion, they must keep the smaller distance. All distances have a tolerance of 0.2 mm. Samples are
5 ms apart. The script prints errors, and the path lengths relative to the reference paths of the problem file. The exit
code is 1 if a motion is invalid.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import coal
import numpy as np
from parts import Moved, least_distance, part
from peers import Arm, pose_from

Array = np.ndarray

#: Tolerance of distances between bodies, m.
SLACK = 2e-4
#: Tolerance of joint positions, for the start, the goal and the joint limits, rad.
AT = 1e-5
SAMPLE_DT = 0.005


def obstacle_part(obstacle: dict[str, Any]) -> Any:
    """Convert an obstacle to a coal shape with a pose."""
    pose = pose_from(obstacle["position"], obstacle.get("quaternion_wxyz", [1, 0, 0, 0]))
    match obstacle["type"]:
        case "box":
            shape = coal.Box(*(2 * h for h in obstacle["half_extents"]))
        case "cylinder":
            shape = coal.Cylinder(obstacle["radius"], obstacle["length"])
        case _:
            shape = coal.Sphere(obstacle["radius"])
    return part(shape, pose)


def placed(arm: Arm, samples: Array) -> dict[str, Array]:
    """Return the poses (N, 4, 4) of every link at all samples, by name."""
    poses = arm.place(samples)
    return {name: np.broadcast_to(pose, (len(samples), 4, 4)) for name, pose in poses.items()}


def breaches(arm: Arm, problem: dict[str, Any], samples: Array, margin: float) -> list[str]:
    """Return a message for each pair that comes too close."""
    poses = placed(arm, samples)
    still = np.eye(4)[None]
    every = np.arange(len(samples))
    ends = np.array([0, len(samples) - 1])
    pairs = [
        (link, f"obstacle {k}", arm.parts[link], poses[link], [obstacle_part(o)], still)
        for link in arm.moving_links
        for k, o in enumerate(problem["obstacles"])
    ]
    pairs += [(a, b, arm.parts[a], poses[a], arm.parts[b], poses[b]) for a, b in arm.self_pairs]
    out = []
    for first, second, ones, at_one, twos, at_two in pairs:
        found = least_distance(Moved(first, ones, at_one), Moved(second, twos, at_two), every, margin)
        if found is None or found[0] >= margin - SLACK:
            continue
        near = least_distance(Moved(first, ones, at_one), Moved(second, twos, at_two), ends, margin)
        allowed = margin if near is None else min(margin, near[0])
        if found[0] < allowed - SLACK:
            out.append(
                f"{first} and {second}: {1e3 * found[0]:.2f} mm at sample {found[1]}, {1e3 * allowed:.2f} needed"
            )
    return out


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return 1 if a motion is invalid."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=Path, required=True)
    parser.add_argument("--motions", type=Path, required=True)
    parser.add_argument("--margin", type=float, default=0.005)
    parser.add_argument("--every", type=int, default=1, help="check only every Nth motion")
    options = parser.parse_args(arguments)
    problems = {entry["id"]: entry for entry in map(json.loads, options.problems.read_text().splitlines())}
    motions = [json.loads(line) for line in options.motions.read_text().splitlines()]
    arm = Arm()
    false, checked, ratios = 0, 0, []
    for record in motions[:: options.every]:
        problem = problems[record["id"]]
        if record["status"] != "solved":
            print(f"{record['id']}: {record['status']}")
            continue
        samples = np.asarray(record["samples"])
        checked += 1
        wrong = []
        if np.abs(samples[0, :7] - problem["start"]).max() > AT:
            wrong.append("does not begin at the start")
        if min(np.abs(samples[-1, :7] - goal).max() for goal in problem["goals"]) > AT:
            wrong.append("does not end at a goal")
        if (samples < arm.lower - AT).any() or (samples > arm.upper + AT).any():
            wrong.append("leaves the joint limits")
        speed = np.abs(np.diff(samples, axis=0))[:-1] / SAMPLE_DT
        if (speed > arm.velocity * (1 + 1e-6)).any():
            wrong.append("is faster than the joints")
        wrong += breaches(arm, problem, samples, options.margin)
        false += bool(wrong)
        for sentence in wrong:
            print(f"{record['id']}: {sentence}")
        if "vamp" in problem:
            ratios.append(np.linalg.norm(np.diff(samples[:, :7], axis=0), axis=1).sum() / problem["vamp"]["length"])
    print(f"{checked} motions checked, {false} invalid")
    if ratios:
        print(f"path length relative to the reference: median {np.median(ratios):.3f}, mean {np.mean(ratios):.3f}")
    return int(false > 0)


if __name__ == "__main__":
    sys.exit(main())
