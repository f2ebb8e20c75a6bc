"""Prediction where a released object ends: how far it falls, and whether it ends on or inside its goal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.common.table_scenes import placed, resting, table_scene

from gensim2.objects import open_library
from gensim2.planning import predict
from gensim2.planning.landing import BORDER, fall, misses
from gensim2.planning.scene import Scene, SceneBody
from gensim2.planning.step_plan import StepPlan

LIBRARY = open_library("builtin")


def scene_of(asset_class: str, thing: str = "golf_ball", yaw: float = 0.3) -> Scene:
    """Return a scene with an open container, or with a rigid support, and with a rigid object beside it."""
    goal = LIBRARY.load(asset_class, "0")
    where = resting(goal, 0.0, 0.1, yaw) if asset_class in ("plate", "bowl") else placed(goal, yaw=yaw, openness=1.0)
    return table_scene({"goal": where, "thing": resting(LIBRARY.load(thing, "0"), -0.3, -0.4)})


def above_goal(scene: Scene, right: float = 0.0, up: float = 0.0) -> Scene:
    """Return the scene with the rigid object at a distance (m) from the goal's last keypoint."""
    thing = scene.objects["thing"]
    pose = thing.T_base_object.copy()
    pose[:3, 3] = list(scene.objects["goal"].keypoints.values())[-1] + [0.0, right, up]
    return predict.with_pose(scene, "thing", pose)


def reason(scene: Scene) -> str | None:
    return misses(scene, "thing", scene.objects["goal"])


def test_the_fall_ends_at_the_table_or_at_the_next_body() -> None:
    scene = scene_of("box_rotate")
    assert fall(scene, "thing") == pytest.approx(0.0, abs=1e-3)
    pose = scene.objects["thing"].T_base_object.copy()
    pose[2, 3] += 0.2
    lifted = predict.with_pose(scene, "thing", pose)
    assert fall(lifted, "thing") == pytest.approx(0.2, abs=1e-3)
    low, high = pose[:3, 3] - [0.1, 0.1, 0.12], pose[:3, 3] + [0.1, 0.1, -0.1]
    shelf = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    covered = replace(lifted, fixtures=(*lifted.fixtures, SceneBody("shelf", (shelf,), np.eye(4))))
    radius = pose[2, 3] - 0.2 + scene.T_world_base[2, 3]
    assert fall(covered, "thing") == pytest.approx(0.1 - radius, abs=1e-3)


@pytest.mark.parametrize("name", ["box_rotate", "drawer", "refrigerator", "safe_rotate", "microwave"])
def test_an_object_released_at_the_keypoint_of_a_container_lies_inside_and_one_beside_it_does_not(name: str) -> None:
    scene = scene_of(name)
    assert reason(above_goal(scene)) is None
    beside = reason(above_goal(scene, right=0.4))
    assert beside is not None
    assert "beside goal" in beside


def test_a_center_of_mass_near_the_border_of_a_plate_does_not_count() -> None:
    scene = scene_of("plate")
    radius = 0.5 * float(np.ptp(np.concatenate(scene.objects["goal"].bodies[0].hulls)[:, 0]))
    keypoint = list(scene.objects["goal"].keypoints.values())[-1]
    away = scene.objects["goal"].T_base_object[1, 3] - keypoint[1]
    assert reason(above_goal(scene, right=away, up=0.1)) is None
    assert reason(above_goal(scene, right=away + radius - 0.5 * BORDER, up=0.1)) is not None


def test_an_object_taller_than_the_box_does_not_lie_inside_as_it_stands() -> None:
    small = next(LIBRARY.load("box_rotate", each) for each in map(str, range(99)) if _height(str(each)) < 0.08)
    bottle = LIBRARY.load("bleach_cleanser", "0")
    scene = table_scene({"goal": placed(small, openness=1.0), "thing": resting(bottle, -0.3, -0.4)})
    standing = reason(above_goal(scene, up=0.1))
    assert standing is not None
    assert "too high" in standing
    lying = scene.objects["thing"].T_base_object.copy()
    lying[:3, :3] = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]) @ lying[:3, :3]
    lying[:3, 3] = list(scene.objects["goal"].keypoints.values())[-1]
    assert reason(predict.with_pose(scene, "thing", lying)) is None


def _height(number: str) -> float:
    model = LIBRARY.load("box_rotate", number)
    link = next(each for each in model.hulls if each != model.joint.child_link)
    corners = np.concatenate(model.hulls[link]) @ model.placement.rotation.T
    return float(np.ptp(corners[:, 2]))


def test_an_object_beside_an_object_that_is_no_container_is_not_judged() -> None:
    scene = scene_of("faucet")
    assert reason(above_goal(scene, right=0.4)) is None


def test_plans_are_ranked_by_their_goal_before_their_clearance() -> None:
    schedule = object()
    good = StepPlan("solved", "", None, schedule, None)  # type: ignore[arg-type]
    tight, beside = replace(good, is_tight=True), replace(good, misses="beside")
    part, none = replace(good, status="partial"), replace(good, status="collision", schedule=None)
    assert [each.rank for each in (good, tight, beside, part, none)] == [0, 1, 2, 3, 4]
