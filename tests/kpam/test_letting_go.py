"""Hands that hold, release, and let go at the end of a motion."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, config, problem, table

BACK = 0.06


def box(name: str, role: Any, at: Any, half: Any) -> kpam.Body:
    pose = np.eye(4)
    pose[:3, 3] = at
    return kpam.Body(name, role, [kpam.Shape.box(half)], pose)


def flap() -> kpam.Body:
    """A thin part at the fingers' grasp point; the joint lifts it."""
    return box("flap", "moving_link", [0.5, 0.1, 0.2], [0.04, 0.004, 0.02])


def follows(**changes: Any) -> dict[str, Any]:
    """A config that grasps the edge, follows its joint and lets go."""
    out = {"gripper": "grasp", "let_go": BACK, "post_actuation_motions": [["follow_joint", -0.3]]}
    return config(**{**out, **changes})


def speed(plan: kpam.Plan, label: str) -> float:
    assert plan.trajectory is not None
    [time] = [frame["time"] for frame in plan.keyframes if frame["label"] == label]
    return float(np.abs(plan.trajectory.sample(time)[1]).max())


def labels(plan: kpam.Plan) -> list[str]:
    return [frame["label"] for frame in plan.keyframes]


def test_the_hand_moves_back_along_its_fingers_and_leaves_the_joint_where_it_is(panda: kpam.Robot) -> None:
    question = problem(panda, config=follows(), bodies=[table(), flap()])
    plan = kpam.plan(question)
    assert plan.status == "solved", plan.reason
    assert labels(plan) == ["pre_0", "actuation", "post_0", "let_go"]
    before, after = (frame["T_base_hand"] for frame in plan.keyframes[-2:])
    np.testing.assert_allclose(after[:3, 3], before[:3, 3] - BACK * before[:3, 2], atol=1e-12)
    np.testing.assert_allclose(after[:3, :3], before[:3, :3])
    assert plan.trajectory is not None
    np.testing.assert_allclose(
        panda.forward_kinematics(plan.trajectory.sample(plan.keyframes[-1]["time"])[0]), after, atol=1e-3
    )
    assert speed(plan, "post_0") == 0.0
    times = np.linspace(plan.keyframes[2]["time"], plan.keyframes[3]["time"], 20)
    travel = kpam.joint_travel(question, plan, times)
    assert np.ptp(travel[1:]) < 1e-12
    # No joint leaves its range: it goes from 0.2 to 0.
    assert travel[-1] == pytest.approx(-0.2, abs=1e-3)
    clearance = kpam.min_clearance(question, plan, 0.02)
    assert clearance is not None
    assert clearance["object"] > 0.0


def test_without_letting_go_the_rest_is_the_same(panda: kpam.Robot) -> None:
    whole = kpam.plan(problem(panda, config=follows(gripper="grasp")))
    plain = kpam.plan(problem(panda, config=follows(let_go=None)))
    assert whole.keyframes[2]["time"] == plain.keyframes[2]["time"]
    assert whole.trajectory is not None
    assert plain.trajectory is not None
    for time in np.linspace(0.0, plain.keyframes[2]["time"], 50):
        np.testing.assert_allclose(whole.trajectory.sample(time)[0], plain.trajectory.sample(time)[0], atol=1e-12)


@pytest.mark.parametrize(("word", "rests"), [("hold", False), ("release", True), ("grasp", True), ("open", False)])
def test_the_motion_rests_where_the_fingers_act(panda: kpam.Robot, word: str, rests: bool) -> None:
    posts = [["translate_z", 0.05]]
    plan = kpam.plan(problem(panda, config=config(gripper=word, post_actuation_motions=posts)))
    assert plan.status == "solved", plan.reason
    assert (speed(plan, "actuation") == 0.0) == rests


def test_letting_go_right_after_the_actuation_stops_there(panda: kpam.Robot) -> None:
    plan = kpam.plan(problem(panda, config=config(gripper="hold", let_go=BACK, post_actuation_motions=[])))
    assert plan.status == "solved", plan.reason
    assert labels(plan) == ["pre_0", "actuation", "let_go"]
    assert speed(plan, "actuation") == 0.0
    assert plan.reached_fraction == 1.0


def test_what_is_in_the_way_makes_it_partial(panda: kpam.Robot) -> None:
    lowered = config(gripper="hold", let_go=0.25, pre_actuation_motions=[], post_actuation_motions=[])
    # Above the wrist, which rises with the hand.
    shelf = box("shelf", "rigid", [0.56, 0.1, 0.56], [0.05, 0.1, 0.005])
    free = kpam.plan(problem(panda, config=lowered))
    assert free.status == "solved", free.reason
    question = problem(panda, config=lowered, bodies=[table(), shelf])
    assert kpam.plan(question).status != "solved"
    allowed = problem(panda, config=lowered, bodies=[table(), shelf], options={"allow_partial": True})
    plan = kpam.plan(allowed)
    assert plan.status == "partial", plan.reason
    assert "let_go" in plan.reason
    assert [frame["reached"] for frame in plan.keyframes] == [True, False]
    assert 0.0 < plan.reached_fraction < 1.0


def test_the_longest_part_is_that_of_the_best_pose(panda: kpam.Robot) -> None:
    lowered = config(gripper="hold", let_go=0.25, pre_actuation_motions=[], post_actuation_motions=[])
    shelf = box("shelf", "rigid", [0.5, 0.2, 0.56], [0.05, 0.05, 0.02])
    options: dict[str, Any] = {"allow_partial": True, "least_margin": 0.0, "extra_seeds": 0}

    def plan(poses: int, **request: Any) -> kpam.Plan:
        question = problem(panda, config=lowered, bodies=[table(), shelf], options={**options, "candidates": poses})
        return kpam.plan(question, **request)

    # Poses are tried by increasing cost, so more of them never give a shorter part.
    parts = [plan(poses) for poses in (1, 2, 5, 12, 40)]
    fractions = [part.reached_fraction for part in parts]
    assert all(part.status == "partial" for part in parts)
    assert fractions == sorted(fractions)
    assert fractions[-1] > fractions[0], "the cheapest pose leads furthest: this tests nothing"
    # A bounded search also looks for parts with the whole margin; the answer is the same.
    limited = plan(40, max_checks=10**9)
    assert limited.reached_fraction == fractions[-1]
    assert limited.trajectory is not None
    assert parts[-1].trajectory is not None
    np.testing.assert_array_equal(limited.trajectory.positions, parts[-1].trajectory.positions)


def tip_over(panda: kpam.Robot, q: Any) -> np.ndarray:
    return panda.forward_kinematics(q)[:3, 3] + [0.0, 0.0, -0.105]


def test_what_was_held_stays_where_the_hand_let_go(panda: kpam.Robot) -> None:
    """A hand that moves back out of a tunnel leaves the object, which would not fit through."""
    held = kpam.Scene(panda, [box("held", "rigid", tip_over(panda, Q_START), [0.05, 0.01, 0.01])])
    held = held.attached("held", Q_START)
    # Two walls beside the hand, above the held bar: the fingers pass between them, but the bar does not.
    walls = [box(f"wall {x}", "rigid", [0.5 + x, 0.1, 0.26], [0.006, 0.2, 0.01]) for x in (-0.06, 0.06)]
    into = config(gripper="hold", pre_actuation_motions=[["translate_y", -0.25]], post_actuation_motions=[])
    settings: dict[str, Any] = {"bodies": [table(), *held.bodies, *walls], "options": {"num_seeds": 96}}
    leaves = kpam.plan(problem(panda, config={**into, "let_go": 0.1}, **settings))
    assert leaves.status == "solved", leaves.reason
    carries = kpam.plan(problem(panda, config={**into, "post_actuation_motions": [["translate_z", -0.1]]}, **settings))
    assert carries.status == "collision", carries.reason


def test_letting_go_can_be_resumed(panda: kpam.Robot) -> None:
    question = problem(panda, config=follows(), bodies=[table(), flap()])
    plan = kpam.plan(question)
    assert plan.trajectory is not None
    begin, end = (frame["time"] for frame in plan.keyframes[-2:])
    position, velocity, _ = plan.trajectory.sample(0.5 * (begin + end))
    rest = kpam.plan(question.with_start(position, velocity), warm_start=plan, resume="let_go")
    assert rest.status == "solved", rest.reason
    assert rest.trajectory is not None
    np.testing.assert_allclose(
        panda.forward_kinematics(rest.trajectory.positions[-1]), plan.keyframes[-1]["T_base_hand"], atol=1e-3
    )
    with pytest.raises(kpam.ProblemError, match="warm_start"):
        kpam.plan(question, resume="let_go")
    with pytest.raises(kpam.ProblemError, match=r"resume.*pre_0, actuation, post_0"):
        kpam.plan(problem(panda), resume="let_go")


def test_windows_and_refinement_know_it_and_it_pickles(panda: kpam.Robot) -> None:
    window = {"links": ["panda_hand"], "bodies": ["table"], "from": "post_0", "to": "let_go"}
    question = problem(panda, config=follows(), options={"contacts": [window]})
    again = pickle.loads(pickle.dumps(question))
    plan = kpam.plan(again)
    assert plan.status == "solved", plan.reason
    assert pickle.dumps(plan) == pickle.dumps(kpam.plan(question))
    refined = kpam.refine(question, plan)
    assert refined["cost_after"] <= refined["cost_before"]
    ends = panda.forward_kinematics(refined["waypoints"][refined["keyframes"]])
    np.testing.assert_allclose(ends[-1][:3, 3], plan.keyframes[-1]["T_base_hand"][:3, 3], atol=1e-4)
    with pytest.raises(kpam.ProblemError, match=r"contacts\[0\].to.*pre_0, actuation, post_0, post_1"):
        problem(panda, options={"contacts": [{**window, "from": "start"}]})
