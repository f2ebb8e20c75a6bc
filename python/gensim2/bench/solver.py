"""``gensim2 bench solver``: solve the recorded problems in a file."""

from __future__ import annotations

import json
import math
import resource
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

import gensim2_kpam as kpam
from gensim2 import robots
from gensim2.bench.problems import PlanProblem, read_problems
from gensim2.bench.scene import ProblemScene, SceneObstacle, check_assets, problem_scene
from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS, Progress

Frames = Literal["original", "object"]


def _body(obstacle: SceneObstacle) -> kpam.Body:
    shapes = [kpam.Shape.convex_hull(points) for points in obstacle.hulls]
    return kpam.Body(obstacle.name, obstacle.role, shapes, obstacle.pose)


def keypoint_problem(
    problem: PlanProblem,
    scene: ProblemScene,
    robot: kpam.Robot,
    *,
    frames: Frames = "original",
    options: kpam.Options | None = None,
) -> kpam.KeypointProblem:
    """Convert a recorded planning problem to a problem of the keypoint solver.

    Args:
        problem: recorded problem, with its keyframe times and keypoints.
        scene: scene with the obstacles of the problem.
        robot: model of the arm with hand and fingers.
        frames: frame of the hand's motions in the config: ``"object"`` (the hand's), or ``"original"``, as in the
            original GenSim2, rotated by the object's yaw.
        options: solver options that replace the default options for recorded problems.

    Raises:
        InputError: the solver rejects the problem's config, or a number is out of range.
    """
    joint = scene.joint
    # The original solver keeps no margin and ignores collisions between the hand and the manipulated object.
    recorded: kpam.Options = {
        "timing": "config",
        "frames": frames,
        "start_time": problem.start_time,
        "velocity_scale": 1.0,
        "acceleration_scale": 1.0,
        "allow_partial": True,
        **robots.robot("panda").solver,
        "least_margin": 0.0,
        "contact_depth": None,
        "start_depth": 1.0,
    }
    if options is not None:
        recorded.update(options)
    try:
        return kpam.KeypointProblem(
            robot,
            kpam.SolverConfig(problem.timed_config()),
            np.asarray(problem.q_current),
            tool_keypoints={name: np.asarray(p) for name, p in problem.tool_keypoints_hand.items()},
            object_keypoints={name: np.asarray(p) for name, p in problem.object_keypoints_base.items()},
            T_base_object=problem.pose("T_base_object"),
            joint=None
            if joint is None
            else kpam.Joint(joint.kind, joint.origin, joint.axis, joint.value, joint.lower, joint.upper),
            object_axis=problem.object_axis or "y",
            object_yaw=problem.object_yaw,
            T_base_world=np.asarray(np.linalg.inv(problem.pose("T_world_base")), dtype=np.float64),
            bodies=[_body(obstacle) for obstacle in scene.obstacles],
            options=recorded,
        )
    except kpam.KpamError as error:
        raise InputError(
            str(error), field=f"problem {problem.id}", remedy="see docs/reference/solver.md for the config language"
        ) from error


#: Number of problems per thread that are passed to the solver in one call.
BATCH_PER_THREAD = 8
#: Time step (s) at which the clearances along a motion are computed.
CLEARANCE_STEP = 0.02
#: Minimum time step of the written joint positions, s; at this step a motion of 30 s has 30,000 samples.
SHORTEST_SAMPLE_DT = 0.001


@dataclass(frozen=True)
class BenchSummary:
    """Summary of all problems. Each time is the median CPU time over the problems, in ms.

    ``peak_memory_mb`` is the peak memory of the whole process, which also holds the scenes and the output.
    """

    problems: int
    statuses: dict[str, int]
    with_actuation: int
    warnings: int
    cpu_ms_actuation: float
    cpu_ms_trajectory: float
    cpu_ms_total: float
    cpu_ms_total_p99: float
    peak_memory_mb: float

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def _listed(value: Any) -> Any:
    return None if value is None else np.asarray(value, dtype=np.float64).tolist()


def _clearance(question: kpam.KeypointProblem, plan: kpam.Plan) -> dict[str, float | None]:
    """Return the smallest signed distances (m) of the checked pairs along a motion.

    A distance is None without a motion or without such pairs.
    """
    found = kpam.min_clearance(question, plan, CLEARANCE_STEP)
    values: dict[str, float | None] = {"self": None, "table": None, "object": None}
    if found is not None:
        values |= {"self": found["self"], "table": found["table"], "object": found["object"]}
    return {name: value if value is not None and math.isfinite(value) else None for name, value in values.items()}


def record_of(
    problem: PlanProblem,
    question: kpam.KeypointProblem,
    plan: kpam.Plan,
    warnings: tuple[str, ...],
    sample_dt: float | None,
) -> dict[str, Any]:
    """Return the result of one problem as written to the output; docs/reference/benchmarks.md describes the fields."""
    trajectory = plan.trajectory
    record: dict[str, Any] = {
        "id": problem.id,
        "status": plan.status,
        "reason": plan.reason,
        "warnings": [*warnings, *plan.warnings],
        "q_actuation": _listed(plan.q_actuation),
        "q_best_effort": _listed(plan.q_best_effort),
        "cost": plan.cost,
        "residuals": [dict(entry) for entry in plan.residuals],
        "q_plan": _listed(plan.q_plan),
        "keyframes": [
            {
                "time": time_of if frame["time"] is None else float(frame["time"]),
                "T_base_hand": _listed(frame["T_base_hand"]),
                "reached": bool(frame["reached"]),
            }
            for time_of, frame in zip(problem.keyframe_times(), plan.keyframes, strict=bool(plan.keyframes))
        ],
        "waypoint_times": None if trajectory is None else _listed(trajectory.times),
        "waypoints": None if trajectory is None else _listed(trajectory.positions),
        "min_clearance_m": _clearance(question, plan),
        "start_overlap_m": float(plan.start_overlap),
        "cpu_ms": dict(plan.cpu_ms),
    }
    if sample_dt is not None:
        record["sample_dt"] = sample_dt
        record["samples"] = None if trajectory is None else _listed(trajectory.sample_every(sample_dt))
    return record


def json_lines(records: Sequence[dict[str, Any]]) -> str:
    """Return records as JSON Lines.

    Example:
        ```python
        Path("results.jsonl").write_text(json_lines(solve_problems(Path("problems.jsonl"))))
        ```
    """
    return "".join(json.dumps(record, allow_nan=False) + "\n" for record in records)


def solve_problems(
    problems: Path,
    *,
    assets: Path | None = None,
    frames: Frames = "original",
    threads: int = 1,
    sample_dt: float | None = None,
    progress: Progress = NULL_PROGRESS,
) -> list[dict[str, Any]]:
    """Solve every problem of a file and return one record for each, in the same order.

    Scenes are loaded before the solver runs, so that ``cpu_ms`` covers the solver only.

    Args:
        problems: JSON Lines, see ``gensim2.bench.problems``.
        assets: folder of the problems' objects, which are all obstacles. None: only the table is an obstacle.
        frames: how motion frames are interpreted (see :func:`~gensim2.bench.solver.keypoint_problem`).
        threads: number of solver threads, which does not affect results.
        sample_dt: time step of the joint positions in the records, s; None: no joint positions.

    Raises:
        InputError: a line is invalid, a folder is missing, or an object cannot be read.

    Example:
        ```python
        records = solve_problems(Path("problems.jsonl"), threads=2)
        print([record["status"] for record in records])
        ```
    """
    if sample_dt is not None and not SHORTEST_SAMPLE_DT <= sample_dt < float("inf"):
        wrong = f"must be at least {SHORTEST_SAMPLE_DT} s, but is {sample_dt}"
        raise InputError(wrong, field="--sample-dt", remedy="for example 0.05")
    recorded = read_problems(problems)
    folder = None if assets is None else check_assets(assets)
    robot = robots.robot("panda").model
    prepared: list[tuple[kpam.KeypointProblem, tuple[str, ...]]] = []
    progress.start("scenes", len(recorded))
    for problem in recorded:
        hand = robot.forward_kinematics(np.asarray(problem.q_current))
        scene = problem_scene(problem, folder, hand)
        odd = tuple(f"target_axis_frame {name!r} read as world" for name in problem.odd_frames())
        prepared.append((keypoint_problem(problem, scene, robot, frames=frames), (*scene.warnings, *odd)))
        progress.advance()
    progress.start("plans", len(recorded))
    records: list[dict[str, Any]] = []
    size = 1 if threads == 1 else threads * BATCH_PER_THREAD
    for start in range(0, len(prepared), size):
        batch = prepared[start : start + size]
        plans = kpam.plan_batch([question for question, _ in batch], threads)
        for problem, (question, warnings), plan in zip(recorded[start:], batch, plans, strict=False):
            records.append(record_of(problem, question, plan, warnings, sample_dt))
            progress.advance()
    return records


def summary_of(records: list[dict[str, Any]]) -> BenchSummary:
    """Summarize records of :func:`solve_problems`.

    Example:
        ```python
        print(summary_of(solve_problems(Path("problems.jsonl"))))
        ```
    """
    statuses = dict(Counter[str](record["status"] for record in records))
    times = {
        part: np.array([record["cpu_ms"][part] for record in records]) for part in ("actuation", "trajectory", "total")
    }
    return BenchSummary(
        problems=len(records),
        statuses=dict(sorted(statuses.items())),
        with_actuation=sum(record["q_actuation"] is not None for record in records),
        warnings=sum(len(record["warnings"]) for record in records),
        cpu_ms_actuation=float(np.median(times["actuation"])),
        cpu_ms_trajectory=float(np.median(times["trajectory"])),
        cpu_ms_total=float(np.median(times["total"])),
        cpu_ms_total_p99=float(np.percentile(times["total"], 99)),
        peak_memory_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    )
