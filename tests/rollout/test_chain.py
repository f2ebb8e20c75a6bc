"""Reactions of a chain of steps to deviations, on a table without physics, where deviations can be arranged."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from drawer_task import STRATEGIES, TASK
from table_scenes import placed, resting, table_scene

from gensim2.objects import open_library
from gensim2.planning.predict import with_joint
from gensim2.planning.scene import Scene
from gensim2.planning.step_plan import StepPlan
from gensim2.planning.steps import StepPlanner
from gensim2.rollout.chain import MAX_ROUNDS, ChainController
from gensim2.tasks.criteria import DistanceGripperRigid, all_hold
from gensim2.tasks.spec import TaskSpec

from .kinematic_world import PANDA, KinematicWorld

pytest.importorskip("mani_skill")

WIDTH = 0.034


@pytest.fixture(scope="module")
def scene() -> Scene:
    drawer = open_library("builtin").load_articulated("drawer", "5")
    ball = open_library("builtin").load_rigid("golf_ball")
    return table_scene({"drawer": placed(drawer, 0.02, 0.02, 0.2), "ball": resting(ball, -0.2, -0.4)})


@pytest.fixture
def world(scene: Scene) -> KinematicWorld:
    return KinematicWorld(scene, "ball", WIDTH)


def chain(open_loop: bool = False, task: TaskSpec = TASK, **strategies: Any) -> ChainController:
    return ChainController(task, {**STRATEGIES, **strategies}, PANDA, open_loop=open_loop)


def triggers(controller: ChainController) -> list[tuple[str, str]]:
    return [(turn.name, plan.trigger) for turn in controller.history for plan in turn.plans if plan.ran]


@pytest.mark.parametrize("open_loop", [False, True])
def test_where_nothing_deviates_every_step_is_planned_once(world: KinematicWorld, open_loop: bool) -> None:
    controller = chain(open_loop)
    world.run(controller)
    assert triggers(controller) == [(name, "start") for name in ("open", "grasp", "place", "close")]
    assert all_hold(TASK.success, world.measure())
    assert [event.what for event in controller.events] == ["actuation"] * 4
    assert all(
        set(plan.detail) <= {"touches"} for turn in controller.history for plan in turn.plans if plan.status == "solved"
    )


def grasping(world: KinematicWorld) -> bool:
    """Return whether the hand is on its way to the ball, with the drawer open."""
    return world.measure().openness["drawer"] > 0.9 and not world.holds


def test_an_object_that_is_pushed_is_planned_for_again(world: KinematicWorld) -> None:
    def push(world: KinematicWorld) -> None:
        if grasping(world) and world.tip()[2] < 0.2 and np.linalg.norm((world.tip() - world.center())[:2]) < 0.12:
            world.shift(0.03, 0.0)
            world.mischief = lambda _: None

    world.mischief = push
    controller = chain()
    world.run(controller)
    assert ("grasp", "object drifted") in triggers(controller)
    assert all_hold(TASK.success, world.measure())
    assert "object drifted" in [event.what for event in controller.events]


def test_what_cannot_be_planned_under_way_is_planned_from_rest(
    world: KinematicWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    def push(world: KinematicWorld) -> None:
        if grasping(world) and world.tip()[2] < 0.2 and np.linalg.norm((world.tip() - world.center())[:2]) < 0.12:
            world.shift(0.03, 0.0)
            world.mischief = lambda _: None

    plan = StepPlanner.plan
    refused: list[float] = []

    def only_from_rest(planner: StepPlanner, scene: Scene, *args: Any, **options: Any) -> StepPlan:
        speed = float(np.abs(scene.qvel).max())
        if speed > 0.05:
            refused.append(speed)
            return StepPlan("cannot_stop", "it is too fast", plan=None, schedule=None, after=None)
        return plan(planner, scene, *args, **options)

    monkeypatch.setattr(StepPlanner, "plan", only_from_rest)
    world.mischief = push
    controller = chain()
    world.run(controller)
    assert refused
    assert ("grasp", "object drifted") in triggers(controller)
    assert all_hold(TASK.success, world.measure())


def test_without_looking_the_pushed_object_is_missed(world: KinematicWorld) -> None:
    def push(world: KinematicWorld) -> None:
        if grasping(world):
            world.shift(0.03, 0.0)
            world.mischief = lambda _: None

    world.mischief = push
    controller = chain(open_loop=True)
    world.run(controller)
    assert not all_hold(TASK.success, world.measure())
    assert {trigger for _, trigger in triggers(controller)} == {"start"}


def losing(world: KinematicWorld, lose: Callable[[KinematicWorld], None]) -> ChainController:
    """Run an episode in which the hand loses the object and notices it."""
    world.mischief = lose
    controller = chain()
    world.run(controller)
    assert "grasp lost" in [event.what for event in controller.events]
    return controller


def test_what_is_lost_on_the_way_is_taken_up_again(world: KinematicWorld) -> None:
    def lose(world: KinematicWorld) -> None:
        if world.holds and world.center()[2] > 0.1 and world.measure().openness["drawer"] > 0.9:
            world.holds = False
            pose = world.scene.objects["ball"].T_base_object.copy()
            pose[:3, 3] = pose[0, 3], pose[1, 3], WIDTH / 2
            world.put(pose)
            world.mischief = lambda _: None

    controller = losing(world, lose)
    assert [name for name, _ in triggers(controller)].count("grasp") == 2
    assert all_hold(TASK.success, world.measure())


def test_what_is_lost_where_it_is_to_go_is_left_there(world: KinematicWorld) -> None:
    def lose(world: KinematicWorld) -> None:
        inside = world.measure().point("drawer")
        away = world.scene.T_world_base[:3, :3] @ world.center() + world.scene.T_world_base[:3, 3] - inside
        if world.holds and np.linalg.norm(away[:2]) < 0.06:
            pose = world.scene.objects["ball"].T_base_object.copy()
            pose[:3, 3] -= world.scene.T_world_base[:3, :3].T @ np.add(away, [0.0, 0.0, 0.03])
            world.holds = False
            world.put(pose)
            world.mischief = lambda _: None

    controller = losing(world, lose)
    assert [name for name, _ in triggers(controller)] == ["open", "grasp", "place", "close"]
    assert all_hold(TASK.success, world.measure())


def test_fingers_that_close_on_nothing_open_and_try_again(world: KinematicWorld) -> None:
    controller = chain()

    def snatch(world: KinematicWorld) -> None:
        if [event.step for event in controller.events] == ["open", "grasp"]:  # the hand will close now
            world.shift(-0.05, 0.0)
            world.mischief = lambda _: None

    world.mischief = snatch
    world.run(controller)
    assert ("grasp", "grasp missed") in triggers(controller)
    assert all_hold(TASK.success, world.measure())


def test_a_strategy_that_cannot_be_planned_is_recorded_and_the_next_one_taken(world: KinematicWorld) -> None:
    far = {**STRATEGIES["place"]}
    far["constraint_list"] = [{**far["constraint_list"][0], "target_offset": [5.0, 0.0, 0.0]}]
    fields = TASK.model_dump(mode="json")
    fields["steps"][2]["strategies"] = ["far", "place"]
    controller = chain(task=TaskSpec.model_validate(fields), far=far)
    world.run(controller)
    place = next(turn for turn in controller.history if turn.name == "place")
    assert [(plan.strategy, plan.status) for plan in place.plans[:1]] == [("far", "actuation_infeasible")]
    assert place.plans[0].ran == 0
    assert place.plans[0].detail["residuals"][0]["residual"] > 1.0
    assert place.plans[-1].strategy == "place"
    assert all_hold(TASK.success, world.measure())


def test_what_never_comes_true_ends_with_its_budget(world: KinematicWorld) -> None:
    stuck = {**STRATEGIES["open"], "post_actuation_motions": []}
    controller = chain(open=stuck)
    world.run(controller)
    assert [turn.name for turn in controller.history] == ["open"]
    assert triggers(controller) == [("open", "start"), ("open", "not done")]
    assert len(controller.history[0].plans) <= MAX_ROUNDS


def test_a_ball_out_of_reach_is_no_motion(scene: Scene) -> None:
    world = KinematicWorld(scene, "ball", WIDTH)
    world.shift(-3.0, 0.0)
    controller = chain()
    world.run(controller)
    grasp = controller.history[-1]
    assert grasp.name == "grasp"
    assert grasp.plans[-1].status == "no_grasp"


def test_what_a_grasp_foresees_is_tried_first_in_the_next_step(
    world: KinematicWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    formers: dict[str, list[Any]] = {}
    plan = StepPlanner.plan

    def noted(self: StepPlanner, scene: Scene, step: Any, strategy: Any, **given: Any) -> StepPlan:
        formers.setdefault(step.name, []).append(given["warm_start"])
        return plan(self, scene, step, strategy, **given)

    monkeypatch.setattr(StepPlanner, "plan", noted)
    controller = chain()
    world.run(controller)
    foreseen = [planned.foreseen for _, planned in controller.plans if planned.foreseen is not None]
    assert [(each.step, each.strategy) for each in foreseen] == [("place", 0)]
    assert formers["place"] == [foreseen[0].plan]
    assert formers["open"] == formers["close"] == [None]


@pytest.mark.parametrize("start", [0.2, 1.0])
def test_what_bars_a_grasp_is_moved_away_first(scene: Scene, start: float) -> None:
    """The ball is under the open drawer and free when it is closed."""
    closed = with_joint(scene, "drawer", at(scene, 0.2))
    front = with_joint(scene, "drawer", at(scene, 1.0)).objects["drawer"].keypoints["articulated_object_head"]
    x, y = (scene.T_world_base @ np.append(front, 1.0))[:2]
    drawer = open_library("builtin").load_articulated("drawer", "5")
    ball = open_library("builtin").load_rigid("golf_ball")
    below = table_scene({"drawer": placed(drawer, 0.02, 0.02, 0.2), "ball": resting(ball, x + 0.02, y)})
    world = KinematicWorld(with_joint(below, "drawer", at(closed, start)), "ball", WIDTH)
    step = TASK.steps[1].model_copy(
        update={
            "strategies": ("push", "grasp"),
            "done": (DistanceGripperRigid(type="distance_gripper_rigidbody", rigid="ball"),),
        }
    )
    controller = chain(
        task=TASK.model_copy(update={"steps": (step,)}), push={**STRATEGIES["close"], "makes_room": "drawer"}
    )
    world.run(controller)
    plans = [(plan.strategy, plan.status) for plan in controller.history[0].plans]
    made = [("grasp", "no_grasp"), ("push", "solved")] if start == 1.0 else []
    assert plans == [*made, ("grasp", "solved")]
    assert ["makes_room" in plan.detail for plan in controller.history[0].plans] == [
        name == "push" for name, _ in plans
    ]
    assert world.holds


def at(scene: Scene, openness: float) -> float:
    joint = scene.objects["drawer"].joint
    assert joint is not None
    return joint.lower + openness * (joint.upper - joint.lower)
