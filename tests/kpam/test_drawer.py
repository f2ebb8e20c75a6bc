"""Pick a cube, carry it over the front panel of a half-open drawer, place it inside, push the drawer shut."""

from __future__ import annotations

import numpy as np
import pytest

import gensim2_kpam as kpam

pytest.importorskip("coal")
pytest.importorskip("pinocchio")

from . import drawer
from .kpam_scenes import Q_START

#: Tolerance of the independent checker (m): rounding, and the curve between waypoints.
SLACK = 1e-3


def whole(plan: kpam.Plan) -> kpam.Plan:
    assert plan.status == "solved", plan.reason
    assert plan.trajectory is not None
    assert plan.q_plan is not None
    return plan


def reached(plan: kpam.Plan, label: str) -> float:
    times = {frame["label"]: frame["time"] for frame in plan.keyframes}
    return float(times[label])


def end(plan: kpam.Plan) -> np.ndarray:
    assert plan.trajectory is not None
    return np.asarray(plan.trajectory.positions[-1])


def pick(start: kpam.Scene) -> kpam.Plan:
    question = start.problem(
        drawer.config("head", "cube/grip", [["translate_z", -0.1]], ["move-up"]),
        Q_START,
        tool_keypoints=drawer.TOOL,
        options={"pick": ["cube"]},
    )
    return whole(kpam.plan(question))


def place(held: kpam.Scene, q: np.ndarray, tool: dict[str, object], release: list[str]) -> kpam.Plan:
    question = held.problem(
        drawer.config("cube/center", "drawer/inside", [["translate_z", -0.13]], ["move-up", "move-up"]),
        q,
        tool_keypoints={**drawer.TOOL, **tool},
        options={"release": release, "margin": 0.002},
    )
    return whole(kpam.plan(question))


def push(filled: kpam.Scene, q: np.ndarray) -> tuple[kpam.KeypointProblem, kpam.Plan]:
    question = filled.problem(
        drawer.config("head", "drawer/front", [["translate_z", -0.08]], [["follow_joint_to", 0.0]]),
        np.r_[q[:7], 0.0, 0.0],
        tool_keypoints=drawer.TOOL,
        joint="slide",
    )
    return question, whole(kpam.plan(question))


def test_the_whole_chain_by_other_code(panda: kpam.Robot) -> None:
    world = drawer.World()
    start = drawer.scene(panda)

    first = pick(start)
    steps = drawer.walk(first)
    hand = world.hand(steps.q)
    resting = drawer.at(*drawer.START, drawer.CUBE)
    grasp = np.linalg.inv(world.hand(first.q_plan[None])[0]) @ resting
    rides = steps.times >= reached(first, "actuation")
    open_ = np.array([drawer.HALF_OPEN])
    least, what = world.least(steps.q[~rides], resting[None], open_, held=False)
    assert least > -SLACK, what
    least, what = world.least(steps.q[rides], hand[rides] @ grasp, open_, held=True)
    assert least > -SLACK, what

    held = start.attached("cube", first.q_plan)
    second = place(held, end(first), {}, ["cube"])
    steps = drawer.walk(second)
    hand = world.hand(steps.q)
    rides = steps.times <= reached(second, "actuation")
    least, what = world.least(steps.q[rides], hand[rides] @ grasp, open_, held=True)
    assert least > -SLACK, what
    inside = world.hand(second.q_plan[None])[0] @ grasp
    least, what = world.least(steps.q[~rides], inside[None], open_, held=False)
    assert least > -SLACK, what

    # Without the cube as part of the robot, the same motion collides with the drawer's front.
    empty = start.with_pose("cube", drawer.at(0.0, 0.0, -1.0))
    blind = place(empty, end(first), {"cube/center": grasp[:3, 3]}, [])
    steps = drawer.walk(blind)
    rides = steps.times <= reached(blind, "actuation")
    least, what = world.least(steps.q[rides], world.hand(steps.q[rides]) @ grasp, open_, held=True)
    assert least < -5 * SLACK, (least, what)
    assert "cube" in what, (least, what)

    filled = held.detached("cube", second.q_plan, on="slide")
    question, third = push(filled, end(second))
    steps = drawer.walk(third)
    hand = world.hand(steps.q)
    moves = steps.times >= reached(third, "actuation")
    # The drawer moves with the hand that pushes it.
    gone = np.where(moves, hand[:, 0, 3] - world.hand(third.q_plan[None])[0, 0, 3], 0.0)
    np.testing.assert_allclose(-gone, kpam.joint_travel(question, third, steps.times), atol=2e-3)
    assert gone[-1] == pytest.approx(drawer.HALF_OPEN, abs=2e-3)
    carried = np.array([drawer.at(shift, 0.0, 0.0) @ inside for shift in gone])
    least, what = world.least(steps.q, carried, drawer.HALF_OPEN - gone, held=False)
    assert least > -SLACK, what


def test_the_arm_keeps_clear_of_a_drawer_that_comes_out(panda: kpam.Robot) -> None:
    # A flap on the drawer reaches over the hand that opens it: its start is clear of the arm, its motion is not.
    start = drawer.scene(panda).with_joint("slide", 0.02)
    flap = kpam.Body("flap", "rigid", [kpam.Shape.box([0.01, 0.2, 0.2])], drawer.at(0.68, 0.0, 0.5))
    joint = kpam.Joint("prismatic", [0.6, 0.0, 0.07], [-1.0, 0.0, 0.0], 0.02, 0.0, 0.18)
    scene = kpam.Scene(panda, [*start.bodies, flap], [kpam.SceneJoint("slide", joint, ["drawer", "flap"])])

    def plan(joint_travel: float) -> kpam.Plan:
        question = scene.problem(
            drawer.config("head", "drawer/front", [["translate_z", -0.05]], [["translate_y", 0.01]]),
            np.r_[Q_START[:7], 0.0, 0.0],
            tool_keypoints=drawer.TOOL,
            joint="slide",
            options={"joint_travel": [joint_travel], "contact_depth": None},
        )
        return kpam.plan(question)

    assert plan(0.0).status == "solved", plan(0.0).reason
    coming = plan(0.16)
    assert coming.status == "collision", coming.reason
    assert "flap" in coming.reason
    assert "panda_link" in coming.reason
