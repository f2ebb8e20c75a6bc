"""Causes in physics: a scene in which one certain thing goes wrong, and the episode's diagnosis names it."""

from __future__ import annotations

from typing import Any

import pytest
from drawer_task import OPEN_DRAWER

from gensim2.rollout.chain import ChainController
from gensim2.rollout.record import Cause, Episode
from gensim2.rollout.run import run
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_strategies, load_strategies_beside, load_task, load_task_file
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec

OPEN = load_task_file(OPEN_DRAWER)
PULL = load_strategies_beside(OPEN_DRAWER, OPEN)["pull"]


def _lane(task: TaskSpec = OPEN) -> HeadlessEnv:
    return HeadlessEnv(task, assets="builtin", instances=["5"])


def _open(strategy: dict[str, Any], **options: Any) -> Episode:
    lane = _lane()
    controller = ChainController(OPEN, {"pull": strategy}, lane.profile)
    return run(lane, controller, seed=3, options=options or None).episode


def test_a_strategy_that_does_not_fit_the_object() -> None:
    other = [{**c, "target_keypoint_name": "articulated_object_lid"} for c in PULL["constraint_list"][:1]]
    names = ["articulated_object_lid"]
    episode = _open({**PULL, "constraint_list": other, "object_keypoint_name_list": names})
    assert episode.cause is Cause.INVALID_PROBLEM
    assert "articulated_object_lid" in episode.diagnosis["reason"]
    assert episode.control_steps == 0


def test_an_object_out_of_reach() -> None:
    episode = _open(PULL, pose=[1.5, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0])
    assert episode.cause is Cause.NO_ACTUATION_POSE
    assert episode.diagnosis["plan"]["residuals"]


def test_an_object_under_the_table() -> None:
    episode = _open(PULL, pose=[0.1, 0.0, -0.06, 1.0, 0.0, 0.0, 0.0])
    assert episode.cause is Cause.COLLISION_ON_THE_WAY
    assert any("table" in pair["bodies"] for pair in episode.diagnosis["plan"]["collisions"])


def test_a_motion_that_leads_beyond_the_arms_reach() -> None:
    episode = _open({**PULL, "gripper": "open", "post_actuation_motions": [["translate_z", -1.5]]})
    assert episode.cause is Cause.KEYFRAME_OUT_OF_REACH
    assert episode.diagnosis["plan"]["unreached"] == "post_0"


def test_a_motion_that_is_too_short() -> None:
    episode = _open({**PULL, "post_actuation_motions": [["follow_joint", 0.03]]}, openness=0.2)
    assert episode.cause is Cause.STOPPED_SHORT
    assert 0.05 < episode.diagnosis["travelled"] < 0.6


def test_a_ball_that_nobody_can_grasp() -> None:
    task = parse_task(
        {
            "schema_version": 2,
            "name": "LiftFarBall",
            "description": "pick up the ball",
            "objects": {"ball": {"class": "golf_ball"}},
            "steps": [{"name": "grasp", "object": "ball", "strategies": ["grasp"]}],
            "goal": [{"type": "distance_gripper_rigidbody", "rigid": "ball"}],
        }
    )
    lane = HeadlessEnv(task, assets="builtin")
    controller = ChainController(task, {"grasp": {"grasp": "antipodal"}}, lane.profile)
    far = {"pose": [0.6, 0.6, 0.03, 1.0, 0.0, 0.0, 0.0]}
    episode = run(lane, controller, seed=0, options=far).episode
    assert episode.cause is Cause.NO_GRASP


@pytest.mark.parametrize("open_loop", [True, False])
def test_a_ball_that_is_shoved_before_it_is_grasped(open_loop: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without feedback the hand goes to the ball's old place; the chain with observations plans again."""
    task = load_task("PlaceGolfBallIntoDrawer")
    lane = HeadlessEnv(task, assets="builtin", instances=["3"])
    controller = ChainController(task, load_strategies(task.name), lane.profile, open_loop=open_loop)
    advance = lane._advance

    def shove() -> None:
        advance()
        if controller.turn == "grasp" and not shoved:
            shoved.append(lane.elapsed_steps)
            lane.nudge("ball", dx=-0.08)

    shoved: list[int] = []
    monkeypatch.setattr(lane, "_advance", shove)
    episode = run(lane, controller, seed=2).episode
    assert shoved
    if open_loop:
        assert episode.cause is Cause.OBJECT_DRIFTED
        assert episode.diagnosis["step"] == "grasp"
        assert episode.diagnosis["distance"] == pytest.approx(0.08, abs=0.005)
        assert not episode.replans, "other strategies at the start are no new look"
    else:
        assert episode.replans
        assert Cause.OBJECT_DRIFTED in {event.what for event in controller.events}
        grasp = next(step for step in episode.steps if step.name == "grasp")
        assert grasp.done  # corrected
