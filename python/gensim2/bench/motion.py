"""``gensim2 bench motion``: plan joint-to-joint motions from a file of problems."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

import gensim2_kpam as kpam
from gensim2 import robots
from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.core.foreign.limits import MAX_RECORD
from gensim2.core.foreign.tree import read_input
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.record_files import parse_record
from gensim2.robots.profile import rotation_matrix

#: Time step (s) of the joint positions that are written for each motion.
SAMPLE_DT = 0.005
#: Position (m) of both finger joints if a problem gives only the arm's joints.
FINGERS_OPEN = 0.04


@dataclass(frozen=True)
class MotionProblem:
    """Planning problem: move from one joint vector to any of several goals without touching the obstacles.

    ``start`` and ``goals`` are (m,) joint positions of the arm from base to hand. ``obstacles`` are in the base frame.
    """

    id: str
    start: tuple[float, ...]
    goals: tuple[tuple[float, ...], ...]
    obstacles: tuple[Mapping[str, Any], ...]


_PROBLEM = TypeAdapter(MotionProblem)


@dataclass(frozen=True)
class MotionSummary:
    """Summary of all problems.

    CPU times are in ms. Duration (s) and path length (rad) are medians over solved problems.
    """

    problems: int
    statuses: dict[str, int]
    cpu_ms_median: float
    cpu_ms_p95: float
    duration_median: float
    length_median: float

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def read_motion_problems(path: Path) -> list[MotionProblem]:
    """Read joint-to-joint problems, one JSON object per line.

    Raises:
        InputError: the file cannot be read, or a line is invalid; the message names line and field.

    Example:
        ```python
        problems = read_motion_problems(Path("motions.jsonl"))
        ```
    """
    remedy = "give id, start, goals and obstacles; docs/reference/benchmarks.md has the format"
    lines = read_input(path, MAX_RECORD, "name a JSON Lines file").split(b"\n")
    return [
        parse_record(line, _PROBLEM, path, remedy, f"line {number}")
        for number, line in enumerate(lines, 1)
        if line.strip()
    ]


def obstacle_body(obstacle: Mapping[str, Any], name: str) -> kpam.Body:
    """Convert an obstacle of a problem to a body of the solver.

    Raises:
        InputError: the obstacle's type or a field is unknown or invalid.
    """
    pose = np.eye(4)
    try:
        pose[:3, 3] = obstacle["position"]
        if "quaternion_wxyz" in obstacle:
            quaternion = np.asarray(obstacle["quaternion_wxyz"], dtype=np.float64)
            length = math.hypot(*quaternion)
            if not 1e-6 < length < 1e6:
                raise ValueError("the norm of quaternion_wxyz must lie between 1e-6 and 1e6")
            pose[:3, :3] = rotation_matrix(quaternion / length)
        match obstacle["type"]:
            case "box":
                shape = kpam.Shape.box(obstacle["half_extents"])
            case "cylinder":
                shape = kpam.Shape.cylinder(float(obstacle["radius"]), float(obstacle["length"]))
            case "sphere":
                shape = kpam.Shape.sphere(float(obstacle["radius"]))
            case other:
                raise ValueError(f"type {other!r}")
        return kpam.Body(name, "rigid", [shape], pose)
    except (KeyError, TypeError, ValueError, OverflowError, kpam.KpamError) as error:
        raise InputError(
            f"is not a valid obstacle: {type(error).__name__}: {error}",
            field=name,
            remedy="give position and type, and half_extents (box), radius and length (cylinder) or radius (sphere)",
        ) from error


def _full(robot: kpam.Robot, values: Sequence[float]) -> Array:
    """Return the positions of all joints. The arm joints have the given values, and the fingers are open."""
    q = np.full(len(robot.joint_names), FINGERS_OPEN)
    q[: len(values)] = values
    if len(values) < len(q):
        q[len(values) :] = np.clip(q[len(values) :], robot.lower[len(values) :], robot.upper[len(values) :])
    return q


def solve_motions(
    problems: Sequence[MotionProblem],
    *,
    robot: str = "panda",
    margin: float = 0.005,
    deadline_ms: float | None = None,
    progress: Progress = NULL_PROGRESS,
) -> list[dict[str, Any]]:
    """Plan a motion for every problem and return one record for each problem.

    A record has these fields:

    - ``id``, ``status``, ``reason``: id of the problem, result of the planner, and reason for a failure.
    - ``cpu_ms``: CPU time of the planning call in ms, including the time to build the scene.
    - ``duration``: duration of the motion, s.
    - ``length``: length of the path in joint space, rad.
    - ``nearer``: pairs of bodies that are closer than ``margin`` already at the start or at the goal. Each entry has
      the names of two bodies and their distance (m). The bodies must keep this distance instead of ``margin``.
    - ``checks``: number of collision checks.
    - ``samples``: joint positions every 5 ms, rad.

    Raises:
        InputError: the robot is unknown, or a problem does not match the robot.

    Example:
        ```python
        records = solve_motions(read_motion_problems(Path("motions.jsonl")), robot="panda", margin=0.005)
        ```
    """
    model = robots.robot(robot).model
    # Run one check first, because the first check also computes the spheres that cover the links. The measured time
    # must not include this.
    rest = np.clip(np.zeros(len(model.joint_names)), model.lower, model.upper)
    kpam.Scene(model).in_collision(rest)
    records: list[dict[str, Any]] = []
    progress.start("motions", len(problems))
    for problem in problems:
        bodies = [obstacle_body(o, f"{k}_{o.get('name', 'obstacle')}") for k, o in enumerate(problem.obstacles)]
        try:
            motion = kpam.Scene(model, bodies).plan_to(
                _full(model, problem.start),
                np.stack([_full(model, goal) for goal in problem.goals]),
                margin=margin,
                deadline_ms=deadline_ms,
                # Limits of acceleration and jerk are published for Franka's arm only.
                limits="panda" if robot == "panda" else None,
            )
        except (kpam.KpamError, ValueError) as error:
            raise InputError(
                str(error),
                field=f"problem {problem.id}",
                remedy="give start and goal positions within the joint limits",
            ) from error
        trajectory, corners = motion.trajectory, motion.corners
        records.append(
            {
                "id": problem.id,
                "status": motion.status,
                "reason": motion.reason,
                "cpu_ms": motion.cpu_ms,
                "duration": None if trajectory is None else trajectory.duration,
                "length": None if corners is None else float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum()),
                "nearer": [[first, second, distance] for first, second, distance in motion.nearer],
                "checks": motion.checks,
                "samples": None if trajectory is None else trajectory.sample_every(SAMPLE_DT).tolist(),
            }
        )
        progress.advance()
    return records


def motion_summary(records: Sequence[Mapping[str, Any]]) -> MotionSummary:
    """Summarize records of :func:`solve_motions`.

    Example:
        ```python
        records = solve_motions(read_motion_problems(Path("motions.jsonl")))
        print(motion_summary(records))
        ```
    """
    statuses = dict(Counter[str](record["status"] for record in records))
    solved = [record for record in records if record["status"] == "solved"]

    def figure(values: Sequence[float], share: float) -> float:
        return float(np.percentile(values, share)) if values else float("nan")

    times = [record["cpu_ms"] for record in records]
    return MotionSummary(
        problems=len(records),
        statuses=dict(sorted(statuses.items())),
        cpu_ms_median=figure(times, 50),
        cpu_ms_p95=figure(times, 95),
        duration_median=figure([record["duration"] for record in solved], 50),
        length_median=figure([record["length"] for record in solved], 50),
    )
