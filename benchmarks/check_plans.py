"""Check the plans of ``gensim2 bench solver`` independently, with Pinocchio's kinematics and coal's distances.

    python benchmarks/check_plans.py --problems plans.jsonl --plans out.jsonl --assets DIR [--frames original|object]

The script recomputes all values of a plan from the problem file: constraints, cost, keyframes, joint limits, the path
of the hand, and the distances between bodies that must not touch. The distance between samples is so small that no
point of a link moves more than 1 mm from one sample to the next. The script prints a table and, with ``--json``, writes
JSON. The exit code is 1 if a check fails.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from contacts import Clock, Obstacle, checked_pairs
from judge import CUTOFF, judge, refine
from peers import Arm, scene_obstacles
from rules import (
    BOX,
    NUMERICAL,
    Keyframe,
    angle_between,
    between,
    constraint_errors,
    expected_keyframes,
    limit_errors,
    off_path,
    pose_cost,
)

Array = np.ndarray

#: Tolerances of the hand pose at a keyframe, m and rad.
POSITION_TOLERANCE, ANGLE_TOLERANCE = 1e-3, 0.03
#: Maximum distance of the hand from the line or arc between two keyframes, m.
STRAIGHT_TOLERANCE = 3e-3


@dataclass
class Finding:
    """Result of checking the plan of one problem; ``errors`` is empty for a valid plan."""

    id: str
    status: str
    errors: list[str] = field(default_factory=list)
    has_actuation: bool = False
    whole: bool = False
    cost_ratio: float | None = None
    keyframe_mm: float = 0.0
    keyframe_rad: float = 0.0
    straight_mm: float = 0.0
    velocity_share: float = 0.0
    clearance_mm: dict[str, float] = field(default_factory=dict)
    checks: int = 0


def check_pose(problem: dict[str, Any], record: dict[str, Any], arm: Arm, finding: Finding) -> None:
    """Check the joint positions ``q_actuation`` and ``q_plan``, and the cost; append errors to ``finding``."""
    for name in ("q_actuation", "q_plan"):
        if record[name] is None:
            continue
        q = np.asarray(record[name], dtype=float)
        if q.shape != (9,) or not np.isfinite(q).all():
            finding.errors.append(f"{name} is not 9 finite numbers")
            continue
        hand = arm.hand_pose(q)
        finding.errors += [f"{name}: {error}" for error in constraint_errors(problem, hand)]
        finding.errors += limit_errors(arm, q, name)
        outside = np.maximum(BOX[:, 0] - hand[:3, 3], hand[:3, 3] - BOX[:, 1]).max()
        if outside > NUMERICAL:
            finding.errors.append(f"{name}: hand {1e3 * outside:.2f} mm outside the box")
    if record["q_actuation"] is not None:
        finding.has_actuation = True
        cost = pose_cost(problem, arm, np.asarray(record["q_actuation"]))
        if record["cost"] is None or abs(cost - record["cost"]) > 1e-6 * max(1.0, cost):
            finding.errors.append(f"cost is {cost:.6f}, stated {record['cost']}")
        best = (problem.get("reference", {}).get("actuation_best") or {}).get("cost")
        finding.cost_ratio = None if best is None else cost / best


def check_path(
    problem: dict[str, Any],
    times: Array,
    path: Array,
    what: str,
    arm: Arm,
    obstacles: list[Obstacle] | None,
    keyframes: list[Keyframe],
    finding: Finding,
) -> None:
    """Check limits, velocities, hand motion and distances of a path in joint space; append errors to ``finding``."""
    if path.ndim != 2 or path.shape[1] != 9 or len(path) != len(times) or not np.isfinite(path).all():
        finding.errors.append(f"{what} are not {len(times)} times 9 finite numbers")
        return
    if np.any(np.diff(times) <= 0.0):
        finding.errors.append(f"{what}: times do not increase")
        return
    if np.abs(path[0] - problem["q_current"]).max() > NUMERICAL:
        finding.errors.append(f"{what}: the first entry is not q_current")
    finding.errors += limit_errors(arm, path, what)
    share = (np.abs(np.diff(path, axis=0)) / np.diff(times)[:, None] / arm.velocity).max() if len(path) > 1 else 0.0
    finding.velocity_share = max(finding.velocity_share, float(share))
    if share > 1.0 + 1e-6:
        finding.errors.append(f"{what}: {share:.3f} times the velocity limit")
    fine_times, fine = refine(arm, times, path)
    for time, hand in zip(fine_times, arm.hand_poses(fine), strict=True):
        around = between(keyframes, time)
        if around is not None:
            finding.straight_mm = max(finding.straight_mm, 1e3 * off_path(*around, hand[:3, 3]))
    if finding.straight_mm > 1e3 * STRAIGHT_TOLERANCE:
        finding.errors.append(f"{what}: the hand leaves its line by {finding.straight_mm:.1f} mm")
    finding.checks += len(fine)
    if obstacles is not None:
        overlaps = check_distances(problem, fine_times, fine, arm, obstacles, finding)
        if overlaps:
            finding.errors.append(f"{what}: {overlaps[0]} (and {len(overlaps) - 1} more pairs)")


def check_distances(
    problem: dict[str, Any], times: Array, path: Array, arm: Arm, obstacles: list[Obstacle], finding: Finding
) -> list[str]:
    """Return a message for each forbidden overlap, and store the minimum distances in ``finding``."""
    pre = problem["pre_actuation_times"]
    clock = Clock(pre[-1] if pre else problem["start_time"], problem["actuation_time"])
    errors = []
    for group, pair in checked_pairs(arm, obstacles, clock, times, path):
        overlap, least, _ = judge(pair)
        if overlap is not None:
            errors.append(overlap.describe(times))
        if least < CUTOFF:
            finding.clearance_mm[group] = min(finding.clearance_mm.get(group, np.inf), 1e3 * least)
    return errors


def check_trajectory(
    problem: dict[str, Any],
    record: dict[str, Any],
    frames: str,
    arm: Arm,
    obstacles: list[Obstacle] | None,
    finding: Finding,
) -> None:
    """Check the keyframes, waypoints and samples of a plan; append errors to ``finding``."""
    if record["waypoints"] is None:
        if record["status"] == "solved":
            finding.errors.append("solved, but no waypoints")
        return
    if record["q_plan"] is None:
        finding.errors.append("waypoints, but no q_plan")
        return
    times, path = np.asarray(record["waypoint_times"]), np.asarray(record["waypoints"])
    keyframes = expected_keyframes(problem, arm.hand_pose(np.asarray(record["q_plan"])), frames)
    stated = record["keyframes"]
    if [round(frame["time"], 9) for frame in stated] != [round(frame.time, 9) for frame in keyframes]:
        finding.errors.append(f"keyframe times {[frame['time'] for frame in stated]}, not those of the config")
        return
    reached = [frame["reached"] for frame in stated]
    finding.whole = all(reached)
    if (record["status"] == "solved") != finding.whole:
        finding.errors.append(f"status {record['status']}, but {sum(reached)} of {len(reached)} keyframes reached")
    for keyframe, frame in zip(keyframes, stated, strict=True):
        pose = np.asarray(frame["T_base_hand"])
        if np.abs(pose - keyframe.pose).max() > 1e-4:
            finding.errors.append(
                f"keyframe at {keyframe.time}: the stated pose does not follow from q_plan and the config"
            )
        if not frame["reached"]:
            continue
        at = np.flatnonzero(np.abs(times - keyframe.time) < 1e-9)
        if len(at) == 0:
            finding.errors.append(f"keyframe at {keyframe.time}: no waypoint at that time")
            continue
        hand = arm.hand_pose(path[at[0]])
        position = float(np.linalg.norm(hand[:3, 3] - keyframe.pose[:3, 3]))
        angle = angle_between(hand[:3, :3], keyframe.pose[:3, :3])
        finding.keyframe_mm = max(finding.keyframe_mm, 1e3 * position)
        finding.keyframe_rad = max(finding.keyframe_rad, angle)
        if position > POSITION_TOLERANCE or angle > ANGLE_TOLERANCE:
            finding.errors.append(f"keyframe at {keyframe.time}: missed by {1e3 * position:.2f} mm, {angle:.4f} rad")
    check_path(problem, times, path, "waypoints", arm, obstacles, keyframes, finding)
    if record.get("samples") is not None:
        samples = np.asarray(record["samples"])
        clock = np.minimum(times[0] + record["sample_dt"] * np.arange(len(samples)), times[-1])
        keep = np.concatenate([[True], np.diff(clock) > 1e-12])
        check_path(problem, clock[keep], samples[keep], "samples", arm, obstacles, keyframes, finding)


def check_record(
    problem: dict[str, Any], record: dict[str, Any], arm: Arm, *, assets: Path | None, frames: str
) -> Finding:
    """Check one output line against its problem."""
    finding = Finding(problem["id"], record.get("status", "?"))
    if record.get("id") != problem["id"]:
        finding.errors.append(f"id is {record.get('id')!r}: lines must be in the order of the input")
        return finding
    check_pose(problem, record, arm, finding)
    obstacles = None
    if assets is not None and record["waypoints"] is not None:
        hand = arm.hand_pose(np.asarray(problem["q_current"]))
        obstacles, missing = scene_obstacles(problem, assets, hand)
        told = sum("missing mesh" in warning for warning in record["warnings"])
        if len(missing) != told:
            finding.errors.append(
                f"{len(missing)} meshes are missing, but the plan has {told} warnings about missing meshes"
            )
    check_trajectory(problem, record, frames, arm, obstacles, finding)
    return finding


def print_table(findings: list[Finding]) -> None:
    """Print a table of the results."""
    wrong = [finding for finding in findings if finding.errors]
    for finding in wrong:
        print(f"WRONG  {finding.id} ({finding.status}): {finding.errors[0]}")
        for error in finding.errors[1:3]:
            print(f"       {error}")
    ratios = [finding.cost_ratio for finding in findings if finding.cost_ratio is not None]
    groups = {
        name: [f.clearance_mm[name] for f in findings if name in f.clearance_mm] for name in ("self", "table", "object")
    }
    rows = [
        ("problems", str(len(findings))),
        ("statuses", ", ".join(f"{name} {count}" for name, count in Counter(f.status for f in findings).most_common())),
        ("with an actuation pose", str(sum(f.has_actuation for f in findings))),
        ("cost within 1 % of actuation_best", f"{sum(ratio <= 1.01 for ratio in ratios)} of {len(ratios)}"),
        ("whole motions", str(sum(f.whole for f in findings))),
        (
            "keyframes missed by at most",
            f"{max(f.keyframe_mm for f in findings):.3f} mm, {max(f.keyframe_rad for f in findings):.4f} rad",
        ),
        ("hand off its line by at most", f"{max(f.straight_mm for f in findings):.3f} mm"),
        ("share of the velocity limit at most", f"{max(f.velocity_share for f in findings):.3f}"),
        *((f"smallest distance checked, {name}", f"{min(values):.2f} mm") for name, values in groups.items() if values),
        ("configurations checked", str(sum(f.checks for f in findings))),
        ("invalid plans", str(len(wrong))),
    ]
    for name, value in rows:
        print(f"{name:40s} {value}")


def lines(path: Path) -> list[dict[str, Any]]:
    """Read a JSON Lines file; skip blank lines."""
    return [json.loads(line) for line in path.read_text().splitlines() if line.strip()]


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=Path, required=True)
    parser.add_argument("--plans", type=Path, required=True, help="output of gensim2 bench solver")
    parser.add_argument("--assets", type=Path, help="folder of real objects; without it, distances are not checked")
    parser.add_argument("--frames", choices=["original", "object"], default="original")
    parser.add_argument("--json", type=Path, help="write the results to this file")
    parser.add_argument("--limit", type=int, help="check only the first N plans")
    options = parser.parse_args(arguments)
    problems, records = lines(options.problems), lines(options.plans)
    if len(problems) != len(records):
        print(f"{len(problems)} problems, {len(records)} plans")
        return 1
    arm = Arm()
    findings = []
    for problem, record in list(zip(problems, records, strict=True))[: options.limit]:
        findings.append(check_record(problem, record, arm, assets=options.assets, frames=options.frames))
        if sys.stderr.isatty():
            print(f"\r{len(findings)} of {len(problems)}", end="", file=sys.stderr, flush=True)
    print_table(findings)
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(finding) for finding in findings], indent=1) + "\n")
    return 1 if any(finding.errors for finding in findings) else 0


if __name__ == "__main__":
    sys.exit(main())
