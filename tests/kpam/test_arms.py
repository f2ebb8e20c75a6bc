"""Five arms, each with a held object: every plan is complete and passes the checker."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pytest
from constraints import point_to_point

import gensim2_kpam as kpam

pytest.importorskip("coal")
pytest.importorskip("pinocchio")

from contacts import Obstacle
from mechanism import Mechanism
from parts import part
from recheck import Question, answer_of, recheck

from .six_arms import six_joints

Array = np.ndarray
ACCELERATION, JERK = 6.0, 200.0


@dataclass
class ArmCase:
    """An arm at rest, the direction of its joints to the actuation pose, and the box's place in its hand frame."""

    urdf: str
    hand: str
    q_start: list[float]
    change: list[float]
    held_at: list[float]
    srdf: str | None = None
    base: str | None = None
    before: list[Any] = field(default_factory=lambda: [["translate_z", -0.05], ["translate_z", -0.04]])
    after: list[Any] = field(default_factory=lambda: ["move-up", ["translate_x", 0.05]])
    budget: dict[str, int] = field(default_factory=dict)


ARMS = {
    "panda": ArmCase(
        "panda/panda_v2.urdf",
        "panda_hand",
        [0.0, -0.32, 0.0, -2.61799, 0.0, 2.23, 0.785398, 0.02, 0.02],
        [0.5, 0.5, 0.1, 0.4, -0.1, 0.1, 0.2, 0.0, 0.0],
        [0.0, 0.0, 0.11],
        srdf="panda/panda_v2.srdf",
    ),
    "xarm7": ArmCase(
        "xarm7/xarm7.urdf",
        "link_eef",
        [0.0, -0.3, 0.0, 1.2, 0.0, 1.4, 0.0],
        [0.6, 0.3, 0.2, 0.3, 0.1, -0.1, 0.4],
        [0.0, 0.0, 0.05],
    ),
    "six joints": ArmCase(
        "", "tool0", [0.0, 0.3, 1.3, -0.2, 0.4, 0.0], [0.7, 0.3, -0.3, 0.2, 0.2, 0.3], [0.0, 0.0, 0.05]
    ),
    # Five joints cannot keep an orientation on a line: the hand turns about the base.
    "so100": ArmCase(
        "so100/so100.urdf",
        "Fixed_Jaw",
        [0.0, 0.2, 0.3, 0.6, 0.0, 0.3],
        [0.5, 0.3, -0.3, 0.2, 0.3, 0.0],
        [0.0, -0.08, 0.0],
        srdf="so100/so100.srdf",
        before=[["rotate", 0.2]],
        after=[["rotate", -0.15], ["rotate", 0.3]],
        # With five joints the poses at the place form a plane, and one in thirty passes the post on both sides.
        budget={"candidates": 200, "extra_seeds": 1000},
    ),
    "fetch": ArmCase(
        "fetch/fetch.urdf",
        "gripper_link",
        [0.3, 0.0, 0.0, 0.8, 0.6, 0.0, 1.2, 0.0, 0.9, 0.0, 0.03, 0.03],
        [0.05, 0.0, 0.0, -0.4, -0.2, 0.3, -0.3, 0.1, 0.2, 0.2, 0.0, 0.0],
        [0.02, 0.0, 0.0],
        srdf="fetch/fetch.srdf",
        base="base_link",
        before=[["translate_x", -0.05]],
    ),
}


def texts(case: ArmCase, robots: Path, tmp_path: Path) -> tuple[Path, Path | None]:
    """Return the files of the arm."""
    if case.urdf:
        return robots / case.urdf, None if case.srdf is None else robots / case.srdf
    path = tmp_path / "six.urdf"
    path.write_text(six_joints())
    return path, None


def about_the_first_joint(arm: Mechanism, q: Array) -> Array:
    """Return a frame (4, 4) whose z axis is that of the joint next to the base."""
    link = next(link for link in arm.links if link.joint >= 0)
    frame = arm.place(q[None])[link.name][0]
    axis = frame[:3, :3] @ arm.joints[link.joint].axis
    side = np.linalg.svd(axis[None])[2][1]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.column_stack([side, np.cross(axis, side), axis]), frame[:3, 3]
    return pose


@pytest.mark.parametrize("name", ARMS)
def test_every_arm_carries_something(name: str, robots: Path, tmp_path: Path) -> None:
    case = ARMS[name]
    urdf, srdf = texts(case, robots, tmp_path)
    robot = kpam.Robot.from_urdf(
        str(urdf), srdf=None if srdf is None else str(srdf), hand_link=case.hand, base_link=case.base
    )
    arm = Mechanism(urdf.read_text(), urdf.parent, case.hand, None if srdf is None else srdf.read_text(), case.base)
    assert arm.joint_names == robot.joint_names
    q_start = np.array(case.q_start)
    count = len(q_start)
    draw = np.random.default_rng(0)
    assert arm.disagreement(q_start + draw.uniform(-0.3, 0.3, (20, count))) < 1e-9
    hand = arm.hand_poses(q_start + np.array(case.change))[0]
    tip = np.array(case.held_at)
    grip = np.eye(4)
    grip[:3, 3] = tip
    here = arm.hand_poses(q_start)[0]
    # A post stands between the held box and its goal, below the hand's straight path.
    half, thin = [0.012, 0.012, 0.012], [0.01, 0.01, 0.1]
    there = hand[:3, :3] @ tip + hand[:3, 3]
    post = np.eye(4)
    post[:3, 3] = 0.5 * (here[:3, :3] @ tip + here[:3, 3] + there) - [0.0, 0.0, 0.07]
    floor = np.eye(4)
    floor[2, 3] = -0.2
    constraints = [point_to_point("tip", "goal", 1e-3)]
    config = {
        "constraint_list": constraints,
        "pre_actuation_motions": case.before,
        "post_actuation_motions": case.after,
    }
    velocity = np.where(np.isfinite(arm.velocity), arm.velocity, 2.0)
    bodies = [
        ("box", "attached", half, grip),
        ("post", "rigid", thin, post),
        ("floor", "table", [2.0, 2.0, 0.02], floor),
    ]
    problem = kpam.KeypointProblem(
        robot,
        kpam.SolverConfig(config),
        q_start,
        tool_keypoints={"tip": tip},
        object_keypoints={"goal": there},
        T_base_object=about_the_first_joint(arm, q_start),
        object_axis="z",
        bodies=[kpam.Body(label, role, [kpam.Shape.box(size)], pose) for label, role, size, pose in bodies],  # type: ignore[arg-type]
        options={
            # One of the arms starts inside the post.
            "start_depth": 0.05,
            "velocity_scale": 1.0,
            "acceleration_scale": 1.0,
            "velocity_limits": velocity,
            "acceleration_limits": np.full(count, ACCELERATION),
            "jerk_limits": np.full(count, JERK),
            **case.budget,
        },
    )
    plan = kpam.plan(problem)
    assert plan.status == "solved", plan.reason
    question = Question(
        arm,
        q_start,
        velocity,
        np.full(count, ACCELERATION),
        np.full(count, JERK),
        np.zeros(count),
        np.zeros(count),
        [
            Obstacle(label, role, [part(coal.Box(*(2.0 * np.array(size))), np.eye(4))], pose)
            for label, role, size, pose in bodies
        ],
    )
    verdict = recheck(question, answer_of(plan))
    assert verdict.errors == []
    assert verdict.looks > 100
