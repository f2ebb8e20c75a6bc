"""The world of a motion: held bodies, allowed contacts, scenes, and planning that continues from an earlier plan."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, TOOL, config, problem, table

LINKS = [f"panda_link{i}" for i in range(3, 8)]


def ball(name: str, role: Any, at: Any, radius: float = 0.03) -> kpam.Body:
    pose = np.eye(4)
    pose[:3, 3] = at
    return kpam.Body(name, role, [kpam.Shape.sphere(radius)], pose)


def middle_of(panda: kpam.Robot, link: str) -> np.ndarray:
    """Return a point inside a link, base frame."""
    inside = {"panda_link3": [0.03, 0.0, -0.06], "panda_link4": [-0.05, 0.04, 0.0], "panda_link5": [0.0, 0.05, -0.15]}
    inside |= {"panda_link6": [0.05, 0.0, 0.0], "panda_link7": [0.0, 0.0, 0.06]}
    return (panda.forward_kinematics(Q_START, link) @ [*inside[link], 1.0])[:3]


@pytest.mark.parametrize("link", LINKS)
def test_nothing_can_be_held_inside_the_arm(panda: kpam.Robot, link: str) -> None:
    held = ball("held", "rigid", middle_of(panda, link), 0.02)
    scene = kpam.Scene(panda, [table(), held]).attached("held", Q_START)
    assert scene.in_collision(Q_START)
    assert any(set(near["bodies"]) == {link, "held"} for near in scene.check(Q_START))
    plan = kpam.plan(problem(panda, bodies=scene.bodies))
    assert plan.start_overlap > 0.005
    if link == "panda_link7":  # moves with the hand, so the point stays inside
        assert plan.status != "solved"


def test_the_hand_may_hold_what_it_holds(panda: kpam.Robot) -> None:
    at = panda.forward_kinematics(Q_START)[:3, 3] + [0.0, 0.0, -0.1]
    scene = kpam.Scene(panda, [table(), ball("held", "rigid", at)]).attached("held", Q_START)
    assert not scene.in_collision(Q_START)
    assert kpam.plan(problem(panda, bodies=scene.bodies)).status == "solved"


def tipped(robots: Path, tmp_path: Path) -> kpam.Robot:
    """The Panda with a bare tool frame as its hand link."""
    folder = robots / "panda"
    frame = (
        '<link name="tip"/><joint name="tip_joint" type="fixed"><parent link="panda_hand"/><child link="tip"/>'
        '<origin xyz="0 0 0.1"/></joint></robot>'
    )
    text = (folder / "panda_v2.urdf").read_text().replace('filename="', f'filename="{folder}/')
    file = tmp_path / "tipped.urdf"
    file.write_text(text.replace("</robot>", frame))
    return kpam.Robot.from_urdf(file, hand_link="tip", srdf=folder / "panda_v2.srdf")


def test_a_body_under_a_bare_tool_frame_is_swept(robots: Path, tmp_path: Path) -> None:
    """The ends of a long bar move far while the hand turns in place; poles stand in their path."""
    robot = tipped(robots, tmp_path)
    bar = kpam.Body("bar", "attached", [kpam.Shape.box([0.01, 0.25, 0.01])], np.eye(4))
    tool = {name: [x, y, z - 0.1] for name, (x, y, z) in TOOL.items()}
    swung = config(pre_actuation_motions=[], post_actuation_motions=[])
    swung["constraint_list"][2]["target_axis"] = [1, 0, 0]
    generator = np.random.default_rng(3)
    solved = 0
    for _ in range(25):
        around, out = generator.uniform(-np.pi, np.pi), generator.uniform(0.12, 0.24)
        pose = np.eye(4)
        pose[:3, 3] = [0.5 + out * np.cos(around), 0.1 + out * np.sin(around), 0.35]
        pole = kpam.Body("pole", "rigid", [kpam.Shape.box([0.004, 0.004, 0.1])], pose)
        goal = {"edge": [0.5, 0.1, 0.35], "inside": [0.5, 0.1, 0.2]}
        bodies = [bar, pole]
        question = problem(robot, config=swung, tool_keypoints=tool, object_keypoints=goal, bodies=bodies)
        plan = kpam.plan(question)
        if plan.status != "solved" or plan.start_overlap > 0.0:
            continue
        assert plan.trajectory is not None
        solved += 1
        assert not np.any(question.scene.distance(plan.trajectory.sample_every(0.004)) < -1e-3)
    assert solved > 10


def test_a_ball_under_a_bare_tool_frame_is_judged_against_the_arm(robots: Path, tmp_path: Path) -> None:
    robot = tipped(robots, tmp_path)
    held = ball("held", "rigid", middle_of(robot, "panda_link5"), 0.02)
    assert kpam.Scene(robot, [held]).attached("held", Q_START).in_collision(Q_START)
    at = robot.forward_kinematics(Q_START)[:3, 3]
    assert not kpam.Scene(robot, [ball("held", "rigid", at, 0.02)]).attached("held", Q_START).in_collision(Q_START)


def test_margins_of_any_size_end(panda: kpam.Robot) -> None:
    for margin in (0.1, 0.12, 0.15, 0.2):
        plan = kpam.plan(
            problem(panda, options={"margin": margin, "least_margin": 0.0, "samples": 50, "extra_seeds": 5})
        )
        assert plan.status == "solved", plan.reason


def test_contact_windows_cost_nothing(panda: kpam.Robot) -> None:
    turns = 0.7 * np.arange(40)
    places = zip(0.5 + 0.45 * np.cos(turns), 0.1 + 0.45 * np.sin(turns), 0.05 + 0.01 * np.arange(40), strict=True)
    balls = [ball(f"ball {i}", "rigid", place, 0.02) for i, place in enumerate(places)]
    window = {"links": ["panda_hand", "panda_leftfinger"], "bodies": [b.name for b in balls], "from": "post_0"}

    def cost(count: int) -> float:
        options = {"contacts": [{**window, "to": "end"}] * count}
        question = problem(panda, bodies=[table(), *balls], options=options)
        return min(kpam.plan(question).cpu_ms["total"] for _ in range(5))

    assert cost(100) < 3.0 * cost(1)


def test_windows_name_what_rides(panda: kpam.Robot) -> None:
    held = ball("held", "attached", [0.0, 0.0, 0.1])
    window = {"links": ["held"], "bodies": ["table"], "from": "start", "to": "end", "depth": 0.1}
    low = {"edge": [0.5, 0.1, 0.02], "inside": [0.5, 0.1, 0.0]}
    arguments: dict[str, Any] = {"bodies": [table(), held], "object_keypoints": low}
    settings = config(post_actuation_motions=["move-up"])
    strict = kpam.plan(problem(panda, config=settings, **arguments))
    assert strict.status == "collision"
    assert "held" in strict.reason
    lenient = kpam.plan(problem(panda, config=settings, options={"contacts": [window]}, **arguments))
    assert lenient.status == "solved", lenient.reason


def test_what_is_picked_leaves_nothing_behind(panda: kpam.Robot) -> None:
    """The hand moves down through the cube's former place, which is free once the cube is held."""
    cube = ball("cube", "rigid", [0.5, 0.1, 0.2], 0.05)
    settings = config(post_actuation_motions=["move-up", "move-down"])
    blocked = kpam.plan(problem(panda, config=settings, bodies=[table(), cube]))
    assert blocked.status == "collision"
    assert "cube" in blocked.reason
    picked = kpam.plan(
        problem(panda, config=settings, bodies=[table(), cube], options={"pick": ["cube"], "contact_depth": 0.05})
    )
    assert picked.status == "solved", picked.reason


def test_what_is_released_becomes_an_obstacle(panda: kpam.Robot) -> None:
    """A wide plate that the hand releases is an obstacle for the rest of the motion."""
    pose = np.eye(4)
    pose[:3, 3] = [0.0, 0.0, 0.115]
    plate = kpam.Body("plate", "attached", [kpam.Shape.box([0.25, 0.25, 0.005])], pose)
    settings = config(post_actuation_motions=["move-up", ["translate_z", 0.06]])
    kept = problem(panda, config=settings, bodies=[table(), plate], options={"release": ["plate"]})
    plan = kpam.plan(kept)
    assert plan.status == "solved", plan.reason


def test_release_of_what_is_not_held_is_refused(panda: kpam.Robot) -> None:
    with pytest.raises(kpam.ProblemError, match=r"options.release\[0\]"):
        problem(panda, options={"release": ["table"]})
    with pytest.raises(kpam.ProblemError, match=r"options.pick\[0\]"):
        problem(panda, options={"pick": ["nothing"]})
    with pytest.raises(kpam.ProblemError, match=r"options\.joint_travel"):
        problem(panda, options={"joint_travel": [0.1]})


def test_scenes_derive(panda: kpam.Robot) -> None:
    door = ball("door", "rigid", [0.5, 0.0, 0.3])
    joint = kpam.Joint("revolute", [0.5, 0.3, 0.0], [0.0, 0.0, 1.0], 0.0, 0.0, 1.5)
    scene = kpam.Scene(panda, [table(), door], [kpam.SceneJoint("hinge", joint, ["door"])])
    turned = scene.with_joint("hinge", np.pi / 4)
    np.testing.assert_allclose(
        turned.bodies[1].pose[:3, 3], [0.5 + 0.3 * np.sin(np.pi / 4), 0.3 - 0.3 * np.cos(np.pi / 4), 0.3]
    )
    assert turned.joints[0].value == pytest.approx(np.pi / 4)
    np.testing.assert_allclose(scene.bodies[1].pose[:3, 3], [0.5, 0.0, 0.3])
    held = turned.attached("door", Q_START)
    assert held.bodies[1].role == "attached"
    assert held.joints[0].moves == []
    back = held.detached("door", Q_START, on="hinge")
    np.testing.assert_allclose(back.bodies[1].pose, turned.bodies[1].pose, atol=1e-12)
    assert back.bodies[1].role == "rigid"
    assert back.joints[0].moves == ["door"]
    for wrong in (
        lambda: scene.with_joint("hinge", 2.0),
        lambda: scene.with_joint("no", 0.1),
        lambda: scene.attached("no", Q_START),
        lambda: scene.detached("door", Q_START),
        lambda: kpam.Scene(panda, [door, door]),
        lambda: kpam.Scene(panda, [door], [kpam.SceneJoint("hinge", joint, ["no"])]),
    ):
        with pytest.raises(kpam.ProblemError):
            wrong()


def test_checks_tell_distances(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda, [ball("ball", "rigid", [0.0, 0.0, 3.0], 0.5)])
    near = scene.check(np.stack([Q_START, Q_START]), reach=5.0)
    assert next([pair["bodies"] for pair in row] for row in near) == [pair["bodies"] for pair in near[1]]
    assert near[0][0]["distance"] == pytest.approx(scene.distance(Q_START, max_distance=5.0))
    assert any("ball" in pair["bodies"] for pair in near[0])
    assert scene.distance(np.stack([Q_START] * 3)).shape == (3,)
    assert scene.check(Q_START) == []


def test_scenes_pickle(panda: kpam.Robot) -> None:
    joint = kpam.Joint("revolute", [0.5, 0.3, 0.0], [0.0, 0.0, 1.0], 0.0, 0.0, 1.5)
    scene = kpam.Scene(
        panda, [table(), ball("door", "rigid", [0.5, 0.0, 0.3])], [kpam.SceneJoint("j", joint, ["door"])]
    )
    again = pickle.loads(pickle.dumps(scene)).with_joint("j", 0.7)
    assert again.distance(Q_START) == scene.with_joint("j", 0.7).distance(Q_START)


def test_poses_alone(panda: kpam.Robot) -> None:
    question = problem(panda)
    found = kpam.ik(question, max_solutions=3)
    plan = kpam.plan(question)
    assert 1 <= len(found) <= 3
    np.testing.assert_allclose(found[0]["q"], plan.q_actuation)
    assert [pose["cost"] for pose in found] == sorted(pose["cost"] for pose in found)


def resumed(panda: kpam.Robot, share: float, **changes: Any) -> tuple[kpam.Plan, kpam.Plan]:
    question = problem(panda, **changes)
    plan = kpam.plan(question)
    assert plan.status == "solved"
    assert plan.trajectory is not None
    now = share * plan.trajectory.duration
    q, _, _ = plan.trajectory.sample(now)
    label = next(frame["label"] for frame in plan.keyframes if frame["time"] > now)
    again = kpam.plan(problem(panda, **(changes | {"q_start": q})), warm_start=plan, resume=label)
    return plan, again


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.6, 0.8, 0.95])
def test_the_rest_of_a_motion_from_its_middle(panda: kpam.Robot, share: float) -> None:
    plan, again = resumed(panda, share)
    assert again.status == "solved", again.reason
    assert again.trajectory is not None
    assert plan.trajectory is not None
    np.testing.assert_allclose(again.trajectory.positions[-1], plan.trajectory.positions[-1], atol=0.02)
    wanted = {frame["label"]: frame["T_base_hand"] for frame in plan.keyframes}
    for frame in again.keyframes:
        if frame["time"] is not None:
            q, _, _ = again.trajectory.sample(frame["time"])
            np.testing.assert_allclose(panda.forward_kinematics(q), wanted[frame["label"]], atol=2e-4)


def test_the_rest_follows_the_joint(panda: kpam.Robot) -> None:
    settings = config(post_actuation_motions=[["follow_joint", 0.5]])
    plan, again = resumed(panda, 0.8, config=settings)
    assert again.status == "solved", again.reason
    assert again.trajectory is not None
    assert plan.trajectory is not None
    question = problem(panda, config=settings)
    ends = [kpam.joint_travel(question, p, [p.trajectory.duration])[0] for p in (plan, again) if p.trajectory]
    np.testing.assert_allclose(ends, [0.5, 0.5], atol=1e-3)


def test_what_cannot_be_resumed_is_refused(panda: kpam.Robot) -> None:
    with pytest.raises(kpam.ProblemError, match="resume"):
        kpam.plan(problem(panda), resume="post_7")
    with pytest.raises(kpam.ProblemError, match="warm_start"):
        kpam.plan(problem(panda), resume="post_0")


def test_an_earlier_plan_comes_first(panda: kpam.Robot) -> None:
    question = problem(panda)
    plan = kpam.plan(question)
    again = kpam.plan(question, warm_start=plan)
    assert again.status == "solved"
    assert again.tried == 1
    np.testing.assert_allclose(again.q_plan, plan.q_plan)


def test_budgets_are_counts(panda: kpam.Robot) -> None:
    question = problem(panda)
    assert kpam.plan(question, max_checks=0).status == "not_found"
    assert kpam.plan(question, max_checks=1_000_000).status == "solved"
    assert kpam.plan(question, max_checks=30).to_dict() == kpam.plan(question, max_checks=30).to_dict()


def test_each_pose_says_why(panda: kpam.Robot) -> None:
    lid = ball("lid", "rigid", [0.5, 0.1, 0.2], 0.1)
    plan = kpam.plan(problem(panda, bodies=[table(), lid]), explain=True)
    assert plan.status == "collision"
    assert len(plan.tried_poses) == plan.tried > 0
    assert {pose["status"] for pose in plan.tried_poses} == {"collision"}
    assert all("lid" in pose["reason"] for pose in plan.tried_poses)
    assert kpam.plan(problem(panda)).tried_poses == []


def test_scenes_add_their_keypoints(panda: kpam.Robot) -> None:
    cube = kpam.Body("cube", "rigid", [kpam.Shape.box([0.02] * 3)], np.eye(4), keypoints={"top": [0.0, 0.0, 0.02]})
    scene = kpam.Scene(panda, [table(), cube])
    np.testing.assert_allclose(scene.object_keypoints["cube/top"], [0.0, 0.0, 0.02])
    assert scene.tool_keypoints == {}
    held = scene.attached("cube", Q_START)
    hand = panda.forward_kinematics(Q_START)
    np.testing.assert_allclose(
        hand[:3, :3] @ held.tool_keypoints["cube/top"] + hand[:3, 3], [0.0, 0.0, 0.02], atol=1e-12
    )
    assert held.object_keypoints == {}
