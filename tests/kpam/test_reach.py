"""Reaching for an object without touching it: the clearance up to and including the actuation pose."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam

from .kpam_scenes import config, problem, table

CLEARANCE = 0.003
#: Rounding that the planner tolerates (m).
SLACK = 2e-4
#: Distance of the open pads from the middle (m).
OPEN = 0.04


def lid(half_width: float, role: Any = "moving_link", *, y: float = 0.1) -> kpam.Body:
    """An upright panel at the fingers' target."""
    pose = np.eye(4)
    pose[:3, 3] = [0.5, y, 0.17]
    return kpam.Body("lid", role, [kpam.Shape.box([0.02, half_width, 0.05])], pose)


def follows(**changes: Any) -> dict[str, Any]:
    out = {"gripper": "grasp", "post_actuation_motions": [["follow_joint", -0.2]]}
    return config(**{**out, **changes})


def planned(panda: kpam.Robot, body: kpam.Body, clearance: float | None, **changes: Any) -> kpam.Plan:
    options = {"reach_clearance": clearance, **changes.pop("options", {})}
    return kpam.plan(problem(panda, bodies=[table(), body], **{"config": follows(), "options": options, **changes}))


def least_before_actuation(panda: kpam.Robot, body: kpam.Body, plan: kpam.Plan) -> float:
    """Return the smallest distance (m) of robot and body on the way to the actuation pose, without exceptions."""
    assert plan.trajectory is not None
    [end] = [frame["time"] for frame in plan.keyframes if frame["label"] == "actuation"]
    q = np.array([plan.trajectory.sample(t)[0] for t in np.append(np.arange(0.0, end, 0.01), end)])
    distances = np.asarray(kpam.Scene(panda, [body]).distance(q, 0.02))
    return float(distances.min())


def test_nothing_comes_nearer_than_the_clearance_before_the_actuation_pose(panda: kpam.Robot) -> None:
    # Off the middle, one finger would touch; the constraints allow to shift the hand by 6 mm.
    body = lid(0.033, y=0.094)
    roomy = follows()
    roomy["constraint_list"][0]["tolerance"] = 0.006
    tight = planned(panda, body, None, config=roomy)
    clear = planned(panda, body, CLEARANCE, config=roomy)
    assert tight.status == clear.status == "solved", clear.reason
    assert least_before_actuation(panda, body, tight) < CLEARANCE - SLACK
    assert least_before_actuation(panda, body, clear) >= CLEARANCE - SLACK


def test_without_room_for_it_the_plan_says_what_comes_too_near(panda: kpam.Robot) -> None:
    body = lid(OPEN - 0.001)
    assert planned(panda, body, None).status == "solved"
    plan = planned(panda, body, CLEARANCE)
    assert plan.status == "collision"
    assert "finger" in plan.reason
    assert "lid" in plan.reason
    assert plan.trajectory is None
    assert planned(panda, body, 0.0).status == "solved"


def test_after_the_actuation_pose_it_may_be_touched(panda: kpam.Robot) -> None:
    # The closed hand moves down through the lid, which yields: only from the actuation pose on.
    body = lid(0.01, y=0.1)
    above = config(gripper="closed", post_actuation_motions=[["trace_joint", -0.2], "move-down"])
    above["constraint_list"][0]["target_offset"] = [0.0, 0.0, 0.035]
    options = {"finger_width": 0.0}
    plan = planned(panda, body, CLEARANCE, config=above, options=options)
    assert plan.status == "solved", plan.reason
    assert least_before_actuation(panda, body, plan) >= CLEARANCE - SLACK


def test_what_is_picked_is_not_touched_before_it_is_picked(panda: kpam.Robot) -> None:
    body = lid(OPEN - 0.001, "rigid")
    lift = follows(post_actuation_motions=["move-up"])
    picked = {"config": lift, "options": {"pick": ["lid"]}, "joint": None}
    assert planned(panda, body, None, **picked).status == "solved"
    assert planned(panda, body, CLEARANCE, **picked).status == "collision"
    narrow = lid(OPEN - 0.01, "rigid")
    plan = planned(panda, narrow, CLEARANCE, **picked)
    assert plan.status == "solved", plan.reason
    assert least_before_actuation(panda, narrow, plan) >= CLEARANCE - SLACK


def test_a_start_that_is_nearer_may_leave(panda: kpam.Robot) -> None:
    # The hand is around the lid with a pad 1 mm away, as after a failed attempt.
    half = OPEN - 0.012
    there = planned(panda, lid(half), CLEARANCE)
    assert there.q_plan is not None
    q, y = np.array(there.q_plan), 0.1 - 0.0105
    body, points = lid(half, y=y), {"edge": [0.5, y, 0.2], "inside": [0.5, y, 0.05]}
    assert 0.0 < float(kpam.Scene(panda, [body]).distance(q)) < CLEARANCE - SLACK
    plan = planned(panda, body, CLEARANCE, q_start=q, object_keypoints=points)
    assert plan.status == "solved", plan.reason
    assert plan.start_overlap == 0.0


def test_replans_keep_it_as_well(panda: kpam.Robot) -> None:
    body = lid(OPEN - 0.01)
    first = planned(panda, body, CLEARANCE)
    assert first.trajectory is not None
    settings = follows()
    [at] = [frame["time"] for frame in first.keyframes if frame["label"] == "pre_0"]
    q, velocity, _ = first.trajectory.sample(0.5 * at)
    shifted = lid(OPEN - 0.01, y=0.104)
    points = {"edge": [0.5, 0.104, 0.2], "inside": [0.5, 0.104, 0.05]}
    question = problem(
        panda,
        config=settings,
        bodies=[table(), shifted],
        object_keypoints=points,
        q_start=q,
        options={"reach_clearance": CLEARANCE, "start_velocity": velocity},
    )
    plan = kpam.plan(question, warm_start=first)
    assert plan.status == "solved", plan.reason
    assert least_before_actuation(panda, shifted, plan) >= CLEARANCE - SLACK


def test_it_is_in_range_and_goes_with_the_default_rules(panda: kpam.Robot) -> None:
    for wrong in (-0.001, 0.06, float("nan")):
        with pytest.raises(kpam.ProblemError, match="reach_clearance"):
            problem(panda, options={"reach_clearance": wrong})
    window = {"links": [], "bodies": [], "from": "start", "to": "end"}
    with pytest.raises(kpam.ProblemError, match=r"options\.reach_clearance: .*contacts"):
        problem(panda, options={"reach_clearance": 0.003, "contacts": [window]})
