"""Mimic joints: in the planned chain they move with their sources and limit them; fingers keep to theirs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, problem

JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
    '<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" effort="1" velocity="{velocity}"/>{mimic}</joint>'
)


def joint(name: str, parent: str, child: str, at: str, axis: str, **rest: Any) -> str:
    settings = {"kind": "revolute", "lower": -2.5, "upper": 2.5, "velocity": 2.0, "mimic": "", **rest}
    return JOINT.format(name=name, parent=parent, child=child, at=at, axis=axis, **settings)


def linkage(tmp_path: Path) -> kpam.Robot:
    """A turntable, a parallelogram whose upper bar turns back by as much as the lower one leans, a lift that follows
    the forearm at twice its rate and is declared first, and two fingers, the second moving twice as far as the first.
    """
    links = "".join(f'<link name="{name}"/>' for name in ("base", "lift", "turn", "lower", "upper", "hand", "f1", "f2"))
    joints = [
        joint(
            "j_lift",
            "base",
            "lift",
            "0 0 0.3",
            "0 0 1",
            kind="prismatic",
            lower=-0.3,
            upper=0.3,
            velocity=0.2,
            mimic='<mimic joint="j_upper" multiplier="-0.2" offset="0.01"/>',
        ),
        joint("j_turn", "lift", "turn", "0 0 0", "0 0 1"),
        joint("j_lower", "turn", "lower", "0 0 0.1", "0 1 0"),
        joint("j_upper", "lower", "upper", "0 0 0.4", "0 1 0", mimic='<mimic joint="j_lower" multiplier="-1"/>'),
        joint("j_out", "upper", "hand", "0.3 0 0", "1 0 0", kind="prismatic", lower=0.0, upper=0.5),
        joint("f_a", "hand", "f1", "0 0 0", "0 1 0", kind="prismatic", lower=0.0, upper=0.05),
        joint(
            "f_b",
            "hand",
            "f2",
            "0 0 0",
            "0 -1 0",
            kind="prismatic",
            lower=0.0,
            upper=0.08,
            mimic='<mimic joint="f_a" multiplier="2"/>',
        ),
    ]
    file = tmp_path / "linkage.urdf"
    file.write_text(f'<robot name="linkage">{links}{"".join(joints)}</robot>')
    return kpam.Robot.from_urdf(file, hand_link="hand")


# j_upper = -j_lower, j_lift = 0.2 j_lower + 0.01.
START = np.array([0.03, 0.0, 0.1, -0.1, 0.1, 0.02, 0.04])


def reach(robot: kpam.Robot, **changes: Any) -> kpam.KeypointProblem:
    point = {"type": "point2point_constraint", "keypoint_name": "tip", "target_keypoint_name": "goal"}
    settings = {"constraint_list": [{**point, "tolerance": 0.001}]}
    arguments: dict[str, Any] = {
        "config": settings,
        "q_start": START,
        "tool_keypoints": {"tip": [0.1, 0.0, 0.0]},
        "object_keypoints": {"goal": [0.6, 0.4, 0.7]},
        "bodies": [],
    }
    return problem(robot, **(arguments | changes))


def test_mimic_columns_move_and_bind_their_source(tmp_path: Path) -> None:
    robot = linkage(tmp_path)
    plan = kpam.plan(reach(robot, options={"velocity_scale": 1.0, "acceleration_scale": 1.0}))
    assert plan.status == "solved", plan.reason
    assert plan.trajectory is not None
    moved = 0.0
    for t in np.linspace(0.0, plan.trajectory.duration, 300):
        q, v, a = plan.trajectory.sample(t)
        np.testing.assert_allclose(q[3], -q[2], atol=1e-12)
        np.testing.assert_allclose(q[0], 0.2 * q[2] + 0.01, atol=1e-12)
        np.testing.assert_allclose([v[3], v[0]], [-v[2], 0.2 * v[2]], atol=1e-12)
        np.testing.assert_allclose([a[3], a[0]], [-a[2], 0.2 * a[2]], atol=1e-12)
        assert (np.abs(v) <= robot.velocity + 1e-9).all()
        moved = max(moved, abs(q[2] - START[2]))
    assert moved > 0.2
    hand = robot.forward_kinematics(plan.trajectory.sample(plan.trajectory.duration)[0])
    assert np.abs(hand[:3, :3] @ [0.1, 0.0, 0.0] + hand[:3, 3] - [0.6, 0.4, 0.7]).max() <= 0.001


def test_limits_of_a_mimic_bind_its_source(tmp_path: Path) -> None:
    # The lift's 0.3 m allow j_lower 1.45 rad, far less than its own limit of 2.5; lower poses do not reach this goal.
    robot = linkage(tmp_path)
    plan = kpam.plan(reach(robot, object_keypoints={"goal": [0.6, 0.0, 0.12]}))
    assert plan.status == "actuation_infeasible"
    assert plan.q_best_effort is not None
    assert (plan.q_best_effort >= robot.lower - 1e-9).all()
    assert (plan.q_best_effort <= robot.upper + 1e-9).all()


def test_a_start_that_no_linkage_can_take_is_refused(tmp_path: Path) -> None:
    start = START.copy()
    start[3] = 0.2
    with pytest.raises(kpam.ProblemError, match=r"q_start\[3\].*j_upper.*j_lower"):
        reach(linkage(tmp_path), q_start=start)


def test_fingers_keep_to_their_mimics_and_limits(tmp_path: Path, panda: kpam.Robot) -> None:
    robot = linkage(tmp_path)
    plan = kpam.plan(reach(robot, options={"finger_width": 0.03}))
    assert plan.trajectory is not None
    np.testing.assert_allclose(plan.trajectory.positions[:, 5:], [[0.03, 0.06]] * len(plan.trajectory.times))
    with pytest.raises(kpam.ProblemError, match=r"options\.finger_width.*f_b.*0\.1"):
        reach(robot, options={"finger_width": 0.05})
    with pytest.raises(kpam.ProblemError, match=r"options\.finger_width.*panda_finger_joint"):
        problem(panda, options={"finger_width": 0.2}, q_start=Q_START)
