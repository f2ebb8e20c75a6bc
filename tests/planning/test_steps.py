"""Steps planned in scenes of several objects: predicted positions, held objects, and grasps that suit later steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from constraints import point_to_point
from drawer_task import STRATEGIES, TASK
from table_scenes import placed, resting, table_scene

import gensim2_kpam as kpam
from gensim2.objects import open_library
from gensim2.planning import predict
from gensim2.planning.scene import Scene, SceneBody
from gensim2.planning.step_plan import INVALID, NO_GRASP, StepPlan
from gensim2.planning.steps import StepPlanner
from gensim2.planning.strategies import PullStrategy, parse_strategy
from gensim2.planning.world import PlanningWorld, carried_by
from gensim2.robots import robot
from gensim2.tasks.spec import Step

pytest.importorskip("mani_skill")

PANDA = robot("panda")
STEPS = {step.name: step for step in TASK.steps}
WAYS = {name: parse_strategy(data) for name, data in STRATEGIES.items()}


@pytest.fixture(scope="module")
def scene() -> Scene:
    drawer = open_library("builtin").load("drawer", "5")
    ball = open_library("builtin").load("golf_ball", "0")
    return table_scene({"drawer": placed(drawer, 0.02, 0.02, 0.2), "ball": resting(ball, -0.2, -0.4)})


def test_every_step_is_planned_on_what_the_one_before_foresees(scene: Scene) -> None:
    planner = StepPlanner(PANDA)
    opened = planner.plan(scene, STEPS["open"], WAYS["open"])
    assert opened.is_solved, opened.reason
    assert opened.after is not None
    joint = opened.after.objects["drawer"].joint
    assert joint is not None
    assert joint.openness == pytest.approx(1.0)
    assert opened.after.held is None

    taken = planner.plan(opened.after, STEPS["grasp"], WAYS["grasp"], following=[(STEPS["place"], [WAYS["place"]])])
    assert taken.is_solved, taken.reason
    assert taken.after is not None
    assert (taken.picks, taken.after.held) == ("ball", "ball")
    assert taken.width == pytest.approx(0.034, abs=0.003)
    tip = PANDA.model.forward_kinematics(taken.after.q) @ np.append(PANDA.tool_keypoints["tool_head"], 1.0)
    np.testing.assert_allclose(taken.after.objects["ball"].T_base_object[:3, 3], tip[:3], atol=0.02)
    raised = taken.after.objects["ball"].T_base_object[2, 3] - scene.objects["ball"].T_base_object[2, 3]
    assert raised == pytest.approx(0.12, abs=0.01)

    left = planner.plan(taken.after, STEPS["place"], WAYS["place"])
    assert left.is_solved, left.reason
    assert left.after is not None
    assert left.after.held is None
    away = left.after.objects["ball"].T_base_object[:3, 3]
    away = away - left.after.objects["drawer"].keypoints["articulated_object_inside"]
    assert np.hypot(*away[:2]) < 0.05
    assert carried_by(left.after, "ball") == "drawer"

    shut = planner.plan(left.after, STEPS["close"], WAYS["close"])
    assert shut.is_solved, shut.reason
    assert shut.after is not None
    gone = shut.after.objects["ball"].T_base_object[:3, 3] - left.after.objects["ball"].T_base_object[:3, 3]
    drawer = shut.after.objects["drawer"].joint
    assert drawer is not None
    assert drawer.openness == pytest.approx(0.0)
    np.testing.assert_allclose(gone, (drawer.lower - drawer.upper) * drawer.axis, atol=1e-9)


def test_a_world_that_is_moved_is_the_one_built_where_things_stand(scene: Scene) -> None:
    world = PlanningWorld(PANDA)
    world.of(scene)
    shifted = predict.with_joint(scene, "drawer", 0.02)
    pose = shifted.objects["ball"].T_base_object.copy()
    pose[:3, 3] = shifted.objects["drawer"].keypoints["articulated_object_inside"]
    shifted = predict.with_pose(shifted, "ball", pose)
    moved, built = world.of(shifted), PlanningWorld(PANDA).of(shifted)
    assert [body.name for body in moved.bodies] == [body.name for body in built.bodies]
    for one, other in zip(moved.bodies, built.bodies, strict=True):
        np.testing.assert_allclose(one.pose, other.pose, atol=1e-9)
    assert moved.joints[0].moves == built.joints[0].moves == ["drawer/link_0", "ball"]
    assert moved.joints[0].value == pytest.approx(0.02)


def test_what_is_held_is_named_with_and_without_its_owner(scene: Scene) -> None:
    held = replace(scene, held="ball")
    config = {"constraint_list": [point_to_point("rigidbody_object_head", "drawer/articulated_object_inside", 0.03)]}
    planner = StepPlanner(PANDA)
    way = parse_strategy(config)
    problem = planner.problem(held, STEPS["place"], way)  # type: ignore[arg-type]
    assert any(body.name == "ball" and body.role == "attached" for body in problem.scene.bodies)
    bare = Step(name="place", object="drawer", strategies=("place",))
    with pytest.raises(Exception, match="rigidbody_object_head"):
        planner.problem(held, bare, way)  # type: ignore[arg-type]


def test_a_grasp_is_one_with_which_the_next_step_can_be_done() -> None:
    # Head ahead, hand down, its side to the left: of a grasp and the same with swapped fingers, one is possible.
    def along(start: str, end: str, axis: list[float]) -> dict[str, object]:
        ends = {"axis_from_keypoint_name": start, "axis_to_keypoint_name": end}
        target = {"target_axis": axis, "target_axis_frame": "world", "target_inner_product": 1.0, "tolerance": 0.5}
        return {"type": "frame_axis_parallel", **ends, **target}

    constraints = [
        along("rigidbody_object_tail", "rigidbody_object_head", [1.0, 0.0, 0.0]),
        along("tool_head", "tool_side", [0.0, 1.0, 0.0]),
        along("tool_tail", "tool_head", [0.0, 0.0, -1.0]),
    ]
    way = parse_strategy({"constraint_list": constraints, "gripper": "hold"})
    grasp = Step(name="grasp", object="spoon", strategies=("grasp",))
    use = Step(name="turn", object="spoon", tool="spoon", strategies=("turn",))
    spoon, planner, blind = open_library("builtin").load("spoon", "0"), StepPlanner(PANDA), []
    for yaw in (0.0, np.pi):
        scene = table_scene({"spoon": resting(spoon, -0.1, 0.1, yaw)})
        first = planner.plan(scene, grasp, WAYS["grasp"])
        chosen = planner.plan(scene, grasp, WAYS["grasp"], following=[(use, [way])])
        assert first.after is not None
        assert chosen.after is not None
        assert planner.plan(chosen.after, use, way).is_solved, chosen.reason
        blind.append(planner.plan(first.after, use, way).is_solved)
    assert not all(blind)


def test_a_patient_planner_tries_every_grasp_and_another_gives_up_after_some() -> None:
    ends = {"axis_from_keypoint_name": "rigidbody_object_tail", "axis_to_keypoint_name": "rigidbody_object_head"}
    constraints = [
        {
            "type": "frame_axis_parallel",
            **ends,
            "target_axis": [0.0, 0.0, up],
            "target_axis_frame": "world",
            "target_inner_product": 1.0,
            "tolerance": 0.1,
        }
        for up in (1.0, -1.0)  # impossible for the spoon
    ]
    way = parse_strategy({"constraint_list": constraints, "gripper": "hold"})
    grasp = Step(name="grasp", object="spoon", strategies=("grasp",))
    use = Step(name="turn", object="spoon", tool="spoon", strategies=("turn",))
    scene = table_scene({"spoon": resting(open_library("builtin").load("spoon", "0"), -0.1, 0.1, 0.0)})
    tried = []
    for patience in (None, 2):
        chosen = StepPlanner(PANDA, patience=patience).plan(scene, grasp, WAYS["grasp"], following=[(use, [way])])
        assert chosen.status == "partial"
        words = chosen.reason.split()
        assert words[:3] == ["with", "none", "of"]
        tried.append(int(words[3]))
    assert tried[1] == 2 < tried[0]


def test_what_lies_under_something_is_drawn_out_before_it_is_lifted() -> None:
    bar, planner = open_library("builtin").load("gold_bar", "0"), StepPlanner(PANDA)
    grasp = Step(name="grasp", object="gold", strategies=("grasp",))
    way = parse_strategy({"grasp": "antipodal", "tilt": 1.6, "candidates": 60})
    scene = table_scene({"gold": resting(bar, -0.1, -0.2)})
    above = np.array([[x, y, z] for x in (-0.09, 0.2) for y in (-0.5, 0.1) for z in (0.055, 0.075)])
    plate = SceneBody("plate", (above,), np.linalg.inv(scene.T_world_base))
    free, barred = (planner.plan(each, grasp, way) for each in (scene, with_fixture(scene, plate)))
    assert (free.status, barred.status) == ("solved", "solved"), barred.reason
    ends = [foreseen_position(each, "gold") for each in (free, barred)]
    rise, drawn = ends[0][2] - ends[1][2], ends[0][:2] - ends[1][:2]
    assert abs(rise) < 0.02  # at the same height
    assert np.linalg.norm(drawn) > 0.05  # at another place


def with_fixture(scene: Scene, body: SceneBody) -> Scene:
    return replace(scene, fixtures=(*scene.fixtures, body))


def foreseen_position(plan: StepPlan, name: str) -> np.ndarray:
    """Return the predicted position (3,) of an object after a step, base frame."""
    assert plan.after is not None
    return plan.after.objects[name].T_base_object[:3, 3]


def test_what_has_a_joint_or_lies_out_of_reach_is_not_grasped(scene: Scene) -> None:
    planner = StepPlanner(PANDA)
    handle = planner.plan(scene, Step(name="grasp", object="drawer", strategies=("grasp",)), WAYS["grasp"])
    assert (handle.status, handle.schedule) == (NO_GRASP, None)
    assert "has a joint" in handle.reason
    pose = scene.objects["ball"].T_base_object.copy()
    pose[0, 3] -= 3.0
    far = planner.plan(predict.with_pose(scene, "ball", pose), STEPS["grasp"], WAYS["grasp"])
    assert (far.status, far.schedule) == (NO_GRASP, None)


@pytest.mark.parametrize("way", ["grasp", "pull"])
def test_a_grasp_or_pull_that_poses_no_problem_is_invalid(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    planner = StepPlanner(PANDA)

    def refuse(*_: object, **__: object) -> None:
        raise kpam.ProblemError("names a keypoint that there is not")

    for name in ("posed", "of_step"):
        monkeypatch.setattr(planner._problems, name, refuse)
    step, strategy = STEPS["grasp"], WAYS["grasp"]
    if way == "pull":
        step, strategy = STEPS["open"], PullStrategy(grasp="antipodal", follow_joint_to=0.9)
    planned = planner.plan(scene, step, strategy)
    assert (planned.status, planned.schedule) == (INVALID, None)
    assert planned.reason == "names a keypoint that there is not"
