"""A step's motion touches nothing early if that is possible, and reports it otherwise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from constraints import point_to_point, pointing_down
from table_scenes import placed, table_scene

import gensim2_kpam as kpam
from gensim2.objects import open_library
from gensim2.planning.reaching import REACH_CLEARANCES
from gensim2.planning.scene import Scene
from gensim2.planning.step_plan import StepPlan
from gensim2.planning.steps import PLAN_OPTIONS, StepPlanner
from gensim2.planning.strategies import KeypointStrategy, parse_strategy
from gensim2.planning.world import PlanningWorld
from gensim2.robots import robot
from gensim2.tasks.spec import Step

PANDA = robot("panda")
CLOSE = Step(name="close", object="drawer", strategies=("push",))


def push(ahead: float) -> KeypointStrategy:
    """Return a strategy in which closed fingers come down the given distance (m) before the handle and push it in."""
    constraints: list[dict[str, Any]] = [
        point_to_point(
            "tool_head", "articulated_object_head", 0.001, target_offset=[0.0, ahead, 0.0], target_offset_frame="joint"
        ),
        pointing_down(0.1),
    ]
    way = parse_strategy(
        {
            "constraint_list": constraints,
            "pre_actuation_motions": [["translate_z", -0.1]],
            "post_actuation_motions": [["trace_joint_to", 0.0]],
            "gripper": "closed",
        }
    )
    assert isinstance(way, KeypointStrategy)
    return way


@pytest.fixture(scope="module")
def scene() -> Scene:
    drawer = open_library("builtin").load("drawer", "5")
    return table_scene({"drawer": placed(drawer, 0.02, 0.02, 0.5)})


def least_on_the_way(scene: Scene, planned: StepPlan) -> float:
    """Return the smallest distance of robot and drawer before the actuation pose (m)."""
    assert planned.plan is not None
    trajectory = planned.plan.trajectory
    assert trajectory is not None
    [end] = [frame["time"] for frame in planned.plan.keyframes if frame["label"] == "actuation"]
    q = np.array([trajectory.sample(t)[0] for t in np.append(np.arange(0.0, end, 0.02), end)])
    world = PlanningWorld(PANDA).of(scene)
    near = world.check(q, 0.02)
    return min(
        (pair["distance"] for pairs in near for pair in pairs if any("drawer" in body for body in pair["bodies"])),
        default=0.02,
    )


def test_what_can_be_reached_clear_is(scene: Scene) -> None:
    planned = StepPlanner(PANDA).plan(scene, CLOSE, push(0.04))
    assert (planned.status, planned.touches, planned.rank) == ("solved", None, 0), planned.reason
    assert planned.detail() == {}
    assert REACH_CLEARANCES[0] is not None
    assert least_on_the_way(scene, planned) > REACH_CLEARANCES[0] - 2e-4


def test_what_cannot_be_reached_clear_is_touched_and_the_plan_says_what_is_in_the_way(scene: Scene) -> None:
    planned = StepPlanner(PANDA).plan(scene, CLOSE, push(0.0))
    assert planned.status == "solved", planned.reason
    assert planned.rank == 1
    assert planned.touches is not None
    assert "drawer/link_0" in planned.touches
    assert planned.detail() == {"touches": planned.touches}
    assert least_on_the_way(scene, planned) < 0.0


def test_an_option_takes_the_place_of_the_default(scene: Scene) -> None:
    options: kpam.Options = {**PLAN_OPTIONS, "reach_clearance": 0.003}
    strict = StepPlanner(PANDA, options).plan(scene, CLOSE, push(0.0))
    assert strict.status == "collision"
    assert strict.rank == 4
    loose = StepPlanner(PANDA, {**PLAN_OPTIONS, "reach_clearance": None}).plan(scene, CLOSE, push(0.0))
    assert (loose.status, loose.touches) == ("solved", None)
