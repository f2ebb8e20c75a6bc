"""Room for the hand around the next step's object, after a step has opened something."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawer_task import TASK
from table_scenes import placed, resting, table_scene

from gensim2.objects import open_library
from gensim2.planning.predict import with_joint
from gensim2.planning.scene import Scene
from gensim2.planning.step_plan import StepPlan
from gensim2.rollout.chain_state import ROOM, ChainPlan, best_of, room_for_hand

from .kinematic_world import PANDA

pytest.importorskip("mani_skill")

OPEN, GRASP = TASK.steps[0], TASK.steps[1]


def scene(x: float, y: float, openness: float) -> Scene:
    drawer = open_library("builtin").load_articulated("drawer", "5")
    ball = open_library("builtin").load_rigid("golf_ball")
    found = table_scene({"drawer": placed(drawer, 0.02, 0.02, 0.0), "ball": resting(ball, x, y)})
    joint = found.objects["drawer"].joint
    assert joint is not None
    return with_joint(found, "drawer", joint.lower + openness * (joint.upper - joint.lower))


def front(of: Scene) -> np.ndarray:
    """Return the position (2,) of the drawer's front in the world."""
    points = of.objects["drawer"].keypoints["articulated_object_head"]
    return np.asarray((of.T_world_base @ np.append(points, 1.0))[:2])


def test_a_thing_close_before_what_is_opened_has_little_room() -> None:
    """The ball's radius is 2 cm; its centre is 6 cm, then 8 cm, in front of the open drawer."""
    x, y = front(scene(-0.6, -0.6, 1.0))
    one, other = (room_for_hand(scene(x - by, y, 1.0), OPEN, TASK.steps[1:]) for by in (0.06, 0.08))
    assert other - one == pytest.approx(0.02, abs=2e-3)
    assert one < ROOM
    assert room_for_hand(scene(x - 0.06, y, 0.0), OPEN, TASK.steps[1:]) == ROOM
    assert room_for_hand(scene(x + 0.03, y, 1.0), OPEN, TASK.steps[1:]) < 0


def test_room_is_asked_for_where_the_next_step_takes_a_thing_alone() -> None:
    x, y = front(scene(-0.6, -0.6, 1.0))
    near = scene(x - 0.06, y, 1.0)
    assert room_for_hand(near, OPEN, ()) == ROOM
    assert room_for_hand(near, OPEN, (TASK.steps[3],)) == ROOM  # the step closes the drawer
    assert room_for_hand(near, GRASP, TASK.steps[1:]) == ROOM  # the step moves no joint
    assert room_for_hand(None, OPEN, TASK.steps[1:]) == ROOM


def plan(name: str, status: str, touches: str | None, room: float) -> ChainPlan:
    schedule = object()  # a placeholder whose rows are not used
    planned = replace(StepPlan(status, "", None, None, None), schedule=schedule, touches=touches)
    return ChainPlan(name, planned, scene(-0.6, -0.6, 0.0), 0, "start", PANDA, room)


def test_whole_comes_before_room_and_room_before_gentle() -> None:
    blocked, rough, part = (
        plan("blocked", "solved", None, 0.01),
        plan("rough", "solved", "the handle", ROOM),
        plan("part", "partial", None, ROOM),
    )
    assert best_of([part, blocked, rough]) is rough
    assert best_of([part, blocked]) is blocked
    assert best_of([blocked, plan("roomier", "solved", None, 0.03)]).strategy == "roomier"  # type: ignore[union-attr]
    assert best_of([blocked, plan("again", "solved", None, 0.01)]) is blocked
    assert [each.is_best for each in (blocked, rough, part)] == [False, False, False]
    assert plan("free", "solved", None, ROOM).is_best
