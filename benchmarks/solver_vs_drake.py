"""Ours against the original's formulation in a current Drake with SNOPT, in turn on one core.

    python benchmarks/solver_vs_drake.py --problems plans.jsonl [--assets DIR] [--every 10] [--repeats 5]

Drake solves what the original solved: nine inverse-kinematics seeds with hard constraints, joint limits and the
box, then a joint trajectory that meets each keyframe's hand pose, without joint limits or collisions. Ours solves the
whole problem, with the objects as obstacles where ``--assets`` is given. Times are CPU milliseconds; Drake's are those
of its ``Solve`` calls alone (building its programs in Python is printed beside them), ours what the plans state.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import statistics
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from check_plans import lines
from peers import Arm, panda_files
from rules import BOX, expected_keyframes, pose_cost

Array = np.ndarray
SEEDS = 9


@dataclass
class Timing:
    """One problem: CPU ms of each part, and whether it was solved."""

    id: str
    drake_actuation: float
    drake_trajectory: float
    drake_building: float
    drake_poses: int
    drake_solved: bool
    drake_cost: float | None
    recorded: float | None = None
    ours_actuation: float | None = None
    ours_trajectory: float | None = None
    ours_total: float | None = None
    ours_status: str | None = None
    ours_cost: float | None = None


class Drake:
    """The Panda in Drake, and the original's two programs."""

    def __init__(self) -> None:
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.solvers import SnoptSolver

        root = ElementTree.fromstring(re.sub(r"<mimic[^>]*/>", "", panda_files()[0].read_text()))
        for link in root.findall("link"):
            for element in [*link.findall("visual"), *link.findall("collision")]:
                link.remove(element)
        self.plant = MultibodyPlant(0.0)
        Parser(self.plant).AddModelsFromString(ElementTree.tostring(root, encoding="unicode"), "urdf")
        self.plant.WeldFrames(self.plant.world_frame(), self.plant.GetFrameByName("panda_link0"))
        self.plant.Finalize()
        self.context = self.plant.CreateDefaultContext()
        self.world, self.hand = self.plant.world_frame(), self.plant.GetFrameByName("panda_hand")
        self.solver = SnoptSolver()
        if not (self.solver.available() and self.solver.enabled()):
            raise SystemExit("this build of Drake has no SNOPT")
        self.building = 0.0

    def actuation(self, problem: dict[str, Any], here: Array, seed: Array) -> tuple[Array | None, float]:
        """Solve the actuation pose from one seed: joints or None, CPU ms of the solve."""
        from pydrake.math import RotationMatrix
        from pydrake.multibody.inverse_kinematics import InverseKinematics

        begin = time.process_time()
        program = InverseKinematics(self.plant, self.context, True)
        variables, current = program.q(), np.asarray(problem["q_current"])
        tool = {name: np.asarray(point) for name, point in problem["tool_keypoints_hand"].items()}
        target = {name: np.asarray(point) for name, point in problem["object_keypoints_base"].items()}
        axes = {
            "world": np.linalg.inv(np.asarray(problem["T_world_base"]))[:3, :3],
            "object": np.asarray(problem["T_base_object"])[:3, :3],
        }
        for entry in problem["config"]["constraint_list"]:
            slack = entry["tolerance"]
            if entry["type"] == "point2point_constraint":
                point = target[entry["target_keypoint_name"]]
                program.AddPositionConstraint(
                    self.hand, tool[entry["keypoint_name"]], self.world, point - slack, point + slack
                )
                continue
            own = tool[entry["axis_to_keypoint_name"]] - tool[entry["axis_from_keypoint_name"]]
            if entry["type"].startswith("keypoint_axis"):
                to, start = entry["target_axis_to_keypoint_name"], entry["target_axis_from_keypoint_name"]
                other = target[to] - target[start]
            else:
                other = axes.get(entry["target_axis_frame"], axes["world"]) @ np.asarray(
                    entry["target_axis"], dtype=float
                )
            angle = float(np.arccos(np.clip(entry["target_inner_product"], -1.0, 1.0)))
            low, high = max(0.0, angle - slack), min(np.pi, angle + slack)
            program.AddAngleBetweenVectorsConstraint(self.world, other, self.hand, own, low, high)
        program.AddPositionConstraint(self.hand, np.zeros(3), self.world, BOX[:, 0], BOX[:, 1])
        program.prog().AddQuadraticErrorCost(np.diag([10.0] + [1.0] * 8), current, variables)
        program.AddPositionCost(self.world, here[:3, 3], self.hand, np.zeros(3), np.eye(3))
        program.AddOrientationCost(self.world, RotationMatrix(here[:3, :3]), self.hand, RotationMatrix(), 1.0)
        solve = time.process_time()
        self.building += 1e3 * (solve - begin)
        result = self.solver.Solve(program.prog(), seed)
        spent = 1e3 * (time.process_time() - solve)
        return (np.array(result.GetSolution(variables)) if result.is_success() else None), spent

    def trajectory(
        self, problem: dict[str, Any], q_actuation: Array, keyframes: list[Any]
    ) -> tuple[Array | None, float]:
        """Solve the joint trajectory through the keyframes: (N, 9) waypoints if it converged, CPU ms of the solve."""
        from pydrake.math import RotationMatrix
        from pydrake.multibody.inverse_kinematics import OrientationConstraint, PositionConstraint
        from pydrake.solvers import MathematicalProgram

        begin = time.process_time()
        times = waypoint_times(problem, [keyframe.time for keyframe in keyframes])
        program = MathematicalProgram()
        q = program.NewContinuousVariables(len(times), 9, "q")
        current = np.asarray(problem["q_current"])
        program.AddConstraint(np.sum((q[0] - current) ** 2) == 0)
        weights = np.diag([10.0] + [1.0] * 7 + [10.0])
        block = 2.0 * np.block([[weights, -weights], [-weights, weights]])
        matrix = np.zeros((q.size, q.size))
        for first in range(0, q.size - 9, 9):
            matrix[first : first + 18, first : first + 18] += block
        program.AddQuadraticCost(matrix, np.zeros(q.size), q.ravel(), True)
        contexts = [self.plant.CreateDefaultContext() for _ in times]
        for keyframe in keyframes:
            index = int(np.argmin(np.abs(times - keyframe.time)))
            position, turn = keyframe.pose[:3, 3], RotationMatrix.ProjectToRotationMatrix(keyframe.pose[:3, :3])
            program.AddConstraint(
                PositionConstraint(self.plant, self.world, position, position, self.hand, np.zeros(3), contexts[index]),
                q[index],
            )
            program.AddConstraint(
                OrientationConstraint(self.plant, self.world, turn, self.hand, RotationMatrix(), 0.03, contexts[index]),
                q[index],
            )
        start = problem["start_time"]
        shares = np.clip((times - start) / (problem["actuation_time"] - start), 0.0, 1.0)
        program.SetInitialGuess(q, current + shares[:, None] * (q_actuation - current))
        solve = time.process_time()
        self.building += 1e3 * (solve - begin)
        result = self.solver.Solve(program)
        spent = 1e3 * (time.process_time() - solve)
        return (np.asarray(result.GetSolution(q)) if result.is_success() else None), spent


def waypoint_times(problem: dict[str, Any], keyframe_times: Sequence[float]) -> Array:
    """Return the times of the original's waypoints in seconds, shape (N,).

    Every keyframe is a waypoint. Between keyframes there is about one waypoint per second until the actuation, and two
    per second afterwards.
    """
    times = [problem["start_time"], *keyframe_times]
    parts = [
        np.linspace(
            begin, end, max(1, int((end - begin) * (1 if end < problem["actuation_time"] else 2))), endpoint=False
        )
        for begin, end in pairwise(times)
    ]
    return np.concatenate([*parts, times[-1:]])


def solve_in_drake(drake: Drake, arm: Arm, problem: dict[str, Any], anchors: Array) -> Timing:
    """The original's whole plan: nine seeds, the cheapest pose, the trajectory."""
    drake.building = 0.0
    current = np.asarray(problem["q_current"])
    here = arm.hand_pose(current)
    actuation, poses = 0.0, []
    for seed in [current, *anchors]:
        q, spent = drake.actuation(problem, here, seed)
        actuation += spent
        if q is not None:
            poses.append(q)
    if not poses:
        return Timing(problem["id"], actuation, 0.0, drake.building, 0, False, None)
    best = min(poses, key=lambda q: pose_cost(problem, arm, q))
    keyframes = expected_keyframes(problem, arm.hand_pose(best), "original")
    waypoints, trajectory = drake.trajectory(problem, best, keyframes)
    cost = pose_cost(problem, arm, best)
    return Timing(problem["id"], actuation, trajectory, drake.building, len(poses), waypoints is not None, cost)


def add_ours(timing: Timing, problem: Any, repeats: int) -> None:
    """Plan with gensim2's solver and write the medians into ``timing``."""
    import gensim2_kpam as kpam

    plans = [kpam.plan(problem) for _ in range(repeats)]
    for part in ("actuation", "trajectory", "total"):
        setattr(timing, f"ours_{part}", statistics.median(plan.cpu_ms[part] for plan in plans))
    timing.ours_status, timing.ours_cost = plans[0].status, plans[0].cost


def our_problems(path: Path, assets: Path | None) -> dict[str, Any]:
    """Every problem as our solver takes it."""
    from gensim2 import robots
    from gensim2.bench.problems import read_problems
    from gensim2.bench.scene import problem_scene
    from gensim2.bench.solver import keypoint_problem

    robot, found = robots.robot("panda").model, {}
    for problem in read_problems(path):
        hand = robot.forward_kinematics(np.asarray(problem.q_current))
        found[problem.id] = keypoint_problem(problem, problem_scene(problem, assets, hand), robot)
    return found


def jacobian_us(arm: Arm, count: int = 20000) -> float:
    """CPU microseconds of one Pinocchio frame Jacobian, called from Python."""
    import pinocchio as pin

    q = pin.randomConfiguration(arm.model)
    begin = time.process_time()
    for _ in range(count):
        pin.computeFrameJacobian(arm.model, arm.data, q, arm.hand, pin.LOCAL_WORLD_ALIGNED)
    return 1e6 * (time.process_time() - begin) / count


def print_summary(timings: list[Timing], jacobian: float) -> None:
    """Medians and ratios."""

    def row(name: str, value: str) -> None:
        print(f"{name:52s} {value}")

    median = statistics.median
    drake = [timing.drake_actuation + timing.drake_trajectory for timing in timings]
    row("problems", str(len(timings)))
    row("Drake: nine seeds, CPU ms, median", f"{median(t.drake_actuation for t in timings):.2f}")
    row("Drake: trajectory, CPU ms, median", f"{median(t.drake_trajectory for t in timings):.2f}")
    row("Drake: whole plan, CPU ms, median", f"{median(drake):.2f}")
    row("Drake: building the programs (not counted), median", f"{median(t.drake_building for t in timings):.2f}")
    row(
        "Drake: problems with a pose, with a trajectory",
        f"{sum(t.drake_poses > 0 for t in timings)}, {sum(t.drake_solved for t in timings)}",
    )
    recorded = [timing.recorded for timing in timings if timing.recorded is not None]
    if recorded:
        row("recorded by the original elsewhere, CPU ms, median", f"{median(recorded):.2f}")
    row("Pinocchio: one frame Jacobian, us", f"{jacobian:.3f}")
    ours = [timing for timing in timings if timing.ours_total is not None]
    if not ours:
        return
    total = [timing.ours_total or 0.0 for timing in ours]
    pose = median(timing.ours_actuation or 0.0 for timing in ours)
    row("ours: actuation pose, CPU ms, median", f"{pose:.4f}")
    row("ours: trajectory, CPU ms, median", f"{median(t.ours_trajectory or 0.0 for t in ours):.4f}")
    row("ours: whole plan, CPU ms, median and 99th percentile", f"{median(total):.4f}, {np.percentile(total, 99):.4f}")
    row(
        "ours: problems with a pose, with a whole motion",
        f"{sum(t.ours_cost is not None for t in ours)}, {sum(t.ours_status == 'solved' for t in ours)}",
    )
    row("ratio of medians, whole plan", f"{median(drake) / median(total):.1f}")
    if recorded:
        row("ratio of medians to the original's record", f"{median(recorded) / median(total):.1f}")
    row("ratio of medians, actuation pose", f"{median(t.drake_actuation for t in timings) / pose:.1f}")
    row("median of ratios, whole plan", f"{median(a / b for a, b in zip(drake, total, strict=True)):.1f}")
    row("Drake's median over our 99th percentile", f"{median(drake) / float(np.percentile(total, 99)):.1f}")
    row("whole plan in Pinocchio Jacobians, median", f"{1e3 * median(total) / jacobian:.0f}")


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=Path, required=True)
    parser.add_argument("--anchors", type=Path, help="JSON list of seeds (9 joints each); default: random ones")
    parser.add_argument("--assets", type=Path, help="folder of real objects, obstacles for ours")
    parser.add_argument("--every", type=int, default=1, help="only every so many-th problem")
    parser.add_argument("--repeats", type=int, default=5, help="plans of ours a problem; the median counts")
    parser.add_argument("--drake-repeats", type=int, default=1, help="plans of Drake's a problem; the median counts")
    parser.add_argument("--core", type=int, default=0, help="core that everything is pinned to")
    parser.add_argument("--drake-only", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    os.sched_setaffinity(0, {options.core})
    arm, drake = Arm(), Drake()
    draw = np.random.default_rng(0)
    if options.anchors is not None:
        anchors = np.array(json.loads(options.anchors.read_text()))
    else:
        anchors = draw.uniform(arm.lower, arm.upper, (14, 9))
    problems = lines(options.problems)[:: options.every]
    ours = {} if options.drake_only else our_problems(options.problems, options.assets)
    timings = []
    for problem in problems:
        seeds = anchors[draw.choice(len(anchors), SEEDS - 1, replace=False)]
        runs = [solve_in_drake(drake, arm, problem, seeds) for _ in range(options.drake_repeats)]
        timing = runs[0]
        for part in ("drake_actuation", "drake_trajectory", "drake_building"):
            setattr(timing, part, statistics.median(getattr(run, part) for run in runs))
        timing.recorded = problem.get("reference", {}).get("plan_cpu_ms")
        if not options.drake_only:
            add_ours(timing, ours[problem["id"]], options.repeats)
        timings.append(timing)
    print_summary(timings, statistics.median(jacobian_us(arm) for _ in range(5)))
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(timing) for timing in timings], indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
