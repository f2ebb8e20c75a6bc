"""Grasps through the Python binding: geometry, plans with a later pose, errors, pickles."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, TOOL, table

Array = npt.NDArray[np.float64]


def at(x: float, y: float, z: float) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = [x, y, z]
    return pose


def block(pose: Array, half: tuple[float, float, float] = (0.015, 0.025, 0.05), name: str = "block") -> kpam.Body:
    return kpam.Body(name, "target", [kpam.Shape.box(half)], pose)


def scene(panda: kpam.Robot, *bodies: kpam.Body) -> kpam.Scene:
    return kpam.Scene(panda, bodies)


@pytest.fixture(scope="module")
def gripper(panda: kpam.Robot) -> kpam.ParallelGripper:
    return kpam.ParallelGripper.of_robot(panda, **TOOL)


def test_the_pandas_gripper_is_read_off_its_fingers(gripper: kpam.ParallelGripper) -> None:
    assert gripper.stroke == pytest.approx((0.0, 0.08), abs=1e-4)
    assert gripper.pad == pytest.approx((0.0175, 0.0185), abs=1e-6)
    # Between the rubber tips, 36 to 54.5 mm below the fingers' joints; the fingers open along the hand's y.
    assert gripper.T_hand_grip[:3, 3] == pytest.approx([0, 0, 0.0584 + 0.04525], abs=1e-6)
    assert gripper.T_hand_grip[:3, 0] == pytest.approx([0, 1, 0], abs=1e-9)


def test_a_gripper_by_numbers_finds_what_the_robots_own_finds(panda: kpam.Robot, gripper: kpam.ParallelGripper) -> None:
    bare = kpam.ParallelGripper(
        [0, 0, 0.10365], TOOL["tool_tail"], [0, 0.05, 0.10365], pad=gripper.pad, stroke=gripper.stroke
    )
    alone = scene(panda, block(at(0.5, 0, 0.05)))
    found, own = alone.grasps("block", bare), alone.grasps("block", gripper)
    assert {round(g.width, 6) for g in found} == {round(g.width, 6) for g in own} == {0.03, 0.05}


def test_grasps_hold_the_block_where_it_stands(panda: kpam.Robot, gripper: kpam.ParallelGripper) -> None:
    pose = at(0.5, 0.1, 0.05)
    found = scene(panda, block(pose), table()).grasps("block", gripper)
    assert len(found) > 20
    assert [g.score for g in found] == sorted((g.score for g in found), reverse=True)
    for grasp in found:
        np.testing.assert_allclose(pose @ grasp.T_object_hand, grasp.T_base_hand, atol=1e-12)
        tips = grasp.T_base_hand @ [0, 0, 0.1129, 1]
        assert tips[2] > 0
        assert grasp.width < grasp.opening <= 0.0801
        np.testing.assert_allclose(grasp.T_base_hand[:3, 2], grasp.approach, atol=1e-9)
        assert set(grasp.quality) == {"friction_margin", "contact", "lever", "clearance", "tilt"}
    # A block is best held at its middle from straight above.
    assert found[0].approach[2] < -0.99
    assert found[0].quality["lever"] < 0.005


def test_the_same_question_has_the_same_answer_and_pickles(panda: kpam.Robot, gripper: kpam.ParallelGripper) -> None:
    whole = scene(panda, block(at(0.5, 0, 0.05)), table())
    first, again = (
        pickle.loads(pickle.dumps(whole)).grasps("block", pickle.loads(pickle.dumps(gripper))) for _ in range(2)
    )
    assert [pickle.dumps(g) for g in first] == [pickle.dumps(g) for g in again]
    assert pickle.loads(pickle.dumps(first[0])).score == first[0].score


def test_a_center_of_mass_draws_the_grasp(panda: kpam.Robot, gripper: kpam.ParallelGripper) -> None:
    rod = scene(panda, block(at(0.5, 0, 0.012), (0.12, 0.012, 0.012)), table())
    middle = rod.grasps("block", gripper)[0]
    heavy = rod.grasps("block", gripper, center_of_mass=[0.1, 0, 0])[0]
    assert abs(middle.T_object_hand[0, 3]) < 0.02
    assert heavy.T_object_hand[0, 3] > 0.06


def walls(x: float, y: float, closing: Array, offset: float, height: float) -> list[kpam.Body]:
    """Two walls across the closing axis, ``offset`` from the middle."""
    half = [0.01, 0.1, height / 2] if abs(closing[0]) > 0.9 else [0.1, 0.01, height / 2]
    places = [np.array([x, y, height / 2]) + side * (offset + 0.01) * closing for side in (-1, 1)]
    return [
        kpam.Body(f"wall {i}", "rigid", [kpam.Shape.box(half)], at(*map(float, place)))
        for i, place in enumerate(places)
    ]


def test_a_later_pose_decides_the_grasp(panda: kpam.Robot, gripper: kpam.ParallelGripper) -> None:
    start, target = at(0.45, -0.15, 0.05), at(0.5, 0.2, 0.053)
    body = block(start, (0.015, 0.015, 0.05))
    found = scene(panda, body, table()).grasps("block", gripper)

    def ask(bodies: list[kpam.Body], targets: list[tuple[Array, Any]]) -> kpam.GraspPlan:
        plan = scene(panda, table(), *bodies, body).plan_grasp("block", gripper, Q_START, found, targets=targets)
        assert plan is not None
        return plan

    free = ask([], [])
    closing = (free.T_object_hand @ gripper.T_hand_grip)[:3, 0]
    # At the target there is no room for fingers on the two sides of the best grasp.
    narrow = walls(0.5, 0.2, closing, 0.023, 0.12)
    led = ask(narrow, [(target, None)])
    assert led.index > free.index
    assert abs((led.T_object_hand @ gripper.T_hand_grip)[:3, 0] @ closing) < 0.1
    assert led.pick.status == "solved"
    [carry] = led.carries
    end = panda.forward_kinematics(carry.trajectory.positions[-1])  # type: ignore[union-attr]
    brought = end @ np.linalg.inv(led.T_object_hand)
    np.testing.assert_allclose(brought[:3, 3], target[:3, 3], atol=1e-3)
    np.testing.assert_allclose(brought[:3, :3], np.eye(3), atol=0.02)
    # With a free yaw the best grasp works: the block arrives turned by a quarter.
    turned = ask(narrow, [(target, [0, 0, 1])])
    assert turned.index < led.index


def test_the_object_is_carried_from_rest_whatever_the_arm_did_at_the_start(
    panda: kpam.Robot, gripper: kpam.ParallelGripper
) -> None:
    body, velocity = block(at(0.45, -0.15, 0.05), (0.015, 0.015, 0.05)), np.zeros(len(Q_START))
    velocity[0] = 0.1
    whole = scene(panda, table(), body)
    plan = whole.plan_grasp(
        "block",
        gripper,
        Q_START,
        whole.grasps("block", gripper),
        targets=[(at(0.5, 0.2, 0.053), None)],
        options={"start_velocity": velocity.tolist(), "limits": "panda"},
    )
    assert plan is not None
    assert plan.pick.trajectory is not None
    np.testing.assert_allclose(plan.pick.trajectory.sample(0.0)[1], velocity, atol=1e-9)
    [carry] = plan.carries
    assert carry.trajectory is not None
    np.testing.assert_allclose(carry.trajectory.sample(carry.trajectory.times[0])[1], 0.0, atol=1e-9)


def test_no_grasp_will_do(panda: kpam.Robot, gripper: kpam.ParallelGripper) -> None:
    whole = scene(panda, block(at(0.5, 0, 0.05)), table())
    found = whole.grasps("block", gripper)[:3]
    out_of_reach = [(at(3.0, 0, 0.05), None)]
    assert whole.plan_grasp("block", gripper, Q_START, found, targets=out_of_reach) is None
    assert whole.plan_grasp("block", gripper, Q_START, []) is None
    wide = scene(panda, block(at(0.5, 0, 0.05), (0.05, 0.05, 0.05)), table())
    assert wide.grasps("block", gripper) == []


def test_only_what_stands_in_the_scene_is_grasped(panda: kpam.Robot, gripper: kpam.ParallelGripper) -> None:
    whole = scene(panda, block(at(0.5, 0, 0.05)), table())
    with pytest.raises(kpam.ProblemError, match="body: 'cup' is not a body".replace("'", '"')):
        whole.grasps("cup", gripper)
    with pytest.raises(kpam.ProblemError, match="is not a body"):
        whole.plan_grasp("cup", gripper, Q_START, [])
    held = whole.attached("block", Q_START)
    with pytest.raises(kpam.ProblemError, match="is already attached to the hand"):
        held.grasps("block", gripper)
    with pytest.raises(kpam.ProblemError, match="is already attached to the hand"):
        held.plan_grasp("block", gripper, Q_START, [])
    # Another object on the hand does not collide with the fixed obstacles.
    other = scene(panda, block(at(0.5, 0, 0.05)), block(at(0.3, 0, 0.5), name="held"), table())
    free = other.attached("held", Q_START).grasps("block", gripper)
    assert [g.score for g in free] == [g.score for g in whole.grasps("block", gripper)]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"count": 0}, "options.count"),
        ({"friction": 0.0}, "options.friction"),
        ({"up": [0, 0, 0]}, "options.up"),
        ({"sample": 3}, "unknown field `sample`"),
    ],
)
def test_bad_options_name_their_field(
    panda: kpam.Robot, gripper: kpam.ParallelGripper, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(kpam.ProblemError, match=words):
        scene(panda, block(at(0.5, 0, 0.05))).grasps("block", gripper, options=options)  # type: ignore[arg-type]


def test_bad_grippers_name_their_field(panda: kpam.Robot) -> None:
    with pytest.raises(kpam.ProblemError, match="tool_keypoints"):
        kpam.ParallelGripper.of_robot(panda, [0, 0, 0.1], [0, 0, 0.05], [0, 0, 0.2])
    with pytest.raises(kpam.ProblemError, match="robot: has no two fingers"):
        kpam.ParallelGripper.of_robot(panda, [0, 0, 0.1], [0, 0, 0.05], [0.05, 0, 0.1])
    with pytest.raises(kpam.ProblemError, match="stroke"):
        kpam.ParallelGripper([0, 0, 0.1], [0, 0, 0], [0.1, 0, 0.1], pad=[0.02, 0.02], stroke=[0.08, 0.0])
    with pytest.raises(kpam.ProblemError, match="pad"):
        kpam.ParallelGripper([0, 0, 0.1], [0, 0, 0], [0.1, 0, 0.1], pad=[0.02, -1], stroke=[0.0, 0.08])
    with pytest.raises(kpam.ProblemError, match=r"targets\[0\]"):
        scene(panda, block(at(0.5, 0, 0.05))).plan_grasp(
            "block", kpam.ParallelGripper.of_robot(panda, **TOOL), Q_START, [], targets=[(np.zeros((4, 4)), None)]
        )
