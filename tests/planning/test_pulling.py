"""Pulls grasp the moving link of an object and move its joint."""

from __future__ import annotations

import numpy as np
import pytest
from table_scenes import placed, table_scene

from gensim2.objects import open_library
from gensim2.planning.pulling import pulls_of
from gensim2.planning.scene import Scene
from gensim2.planning.step_plan import NO_GRASP
from gensim2.planning.steps import StepPlanner
from gensim2.planning.strategies import PullStrategy
from gensim2.robots import robot
from gensim2.tasks.spec import Step

pytest.importorskip("mani_skill")

PANDA = robot("panda")
PULL = PullStrategy(grasp="antipodal", follow_joint_to=0.9)
STEP = Step.model_validate({"name": "open", "object": "drawer", "strategies": ["pull"]})


@pytest.fixture(scope="module")
def scene() -> Scene:
    return table_scene({"drawer": placed(open_library("builtin").load("drawer", "5"), 0.02, 0.02, 0.3)})


def test_a_drawer_is_pulled_by_a_grasp_that_touches_nothing_before(scene: Scene) -> None:
    planned = StepPlanner(PANDA).plan(scene, STEP, PULL)
    assert planned.is_solved, planned.reason
    assert planned.touches is None
    assert planned.picks is None, "what has a joint is not taken along"
    assert planned.after is not None
    joint = planned.after.objects["drawer"].joint
    assert joint is not None
    assert joint.openness == pytest.approx(0.9, abs=1e-6)


def test_the_pads_hold_what_moves_and_those_that_pull_by_themselves_come_first(scene: Scene) -> None:
    planner, drawer = StepPlanner(PANDA), scene.objects["drawer"]
    assert drawer.joint is not None
    gripper = PANDA.gripper.grasping(PANDA.model, PANDA.tool_keypoints)
    found = pulls_of(planner.world.of(scene), scene, drawer, gripper, PULL.model_copy(update={"candidates": 100}))
    assert found
    moving = [body for body in drawer.bodies if body.name in drawer.joint.moves]
    corners = np.concatenate(
        [hull @ b.T_base_body[:3, :3].T + b.T_base_body[:3, 3] for b in moving for hull in b.hulls]
    )
    along = []
    for grasp in found:
        between = (grasp.T_base_hand @ gripper.T_hand_grip)[:3, 3]
        assert (between > corners.min(axis=0) - 0.01).all()
        assert (between < corners.max(axis=0) + 0.01).all()
        closing = (grasp.T_base_hand @ gripper.T_hand_grip)[:3, 0]
        along.append(abs(float(closing @ drawer.joint.axis)) > 0.7)
    assert along == sorted(along, reverse=True)


def test_what_has_no_joint_is_not_pulled() -> None:
    from table_scenes import resting

    alone = table_scene({"drawer": resting(open_library("builtin").load("golf_ball", "0"), -0.2, -0.4)})
    planned = StepPlanner(PANDA).plan(alone, STEP, PULL)
    assert (planned.status, planned.reason) == (NO_GRASP, "drawer has no joint")
