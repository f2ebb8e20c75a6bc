"""Causes in physics that appear only in contact: one scene for each."""

from __future__ import annotations

from typing import Any

import numpy as np
from constraints import point_to_point, pointing_down
from drawer_task import OPEN_DRAWER
from sapien import Pose

from gensim2.rollout.chain import ChainController
from gensim2.rollout.controller import Action, PrivilegedObservation
from gensim2.rollout.disturbance import Disturbed
from gensim2.rollout.record import Cause, Episode
from gensim2.rollout.run import run
from gensim2.sim.headless import HeadlessEnv
from gensim2.sim.parts import RigidPart
from gensim2.tasks.library import load_strategies, load_strategies_beside, load_task, load_task_file
from gensim2.tasks.parse import parse_task

OPEN = load_task_file(OPEN_DRAWER)
PULL = load_strategies_beside(OPEN_DRAWER, OPEN)["pull"]
PUT_AWAY = load_task("PlaceGolfBallIntoDrawer")

TAKE_BALL = parse_task(
    {
        "schema_version": 2,
        "name": "TakeBall",
        "description": "pick up the ball",
        "objects": {"ball": {"class": "golf_ball", "place": {"at": [-0.15, 0.0]}}},
        "steps": [{"name": "grasp", "object": "ball", "strategies": ["grasp"]}],
        "goal": [{"type": "distance_gripper_rigidbody", "rigid": "ball"}],
    }
)


def _open(strategy: dict[str, Any], openness: float) -> Episode:
    lane = HeadlessEnv(OPEN, assets="builtin", instances=["5"])
    controller = ChainController(OPEN, {"pull": strategy}, lane.profile)
    return run(lane, controller, seed=3, options={"openness": openness}).episode


def test_a_drawer_that_is_pushed_instead_of_pulled() -> None:
    episode = _open({**PULL, "post_actuation_motions": [["follow_joint_to", 0.05]]}, openness=0.5)
    assert episode.cause is Cause.WRONG_WAY
    assert episode.diagnosis["travelled"] < -0.3


def test_a_hand_that_leaves_the_handle_and_goes_on() -> None:
    slipping = [["follow_joint_to", 0.35], "move-up", ["follow_joint_to", 1.0]]
    episode = _open({**PULL, "gripper": "open", "post_actuation_motions": slipping}, openness=0.1)
    assert episode.cause is Cause.CONTACT_SLIPPED
    assert 0.1 < episode.diagnosis["travelled"] < 0.6
    assert episode.diagnosis["slip"] > 0.08


def _grasp(target_offset: tuple[float, float, float]) -> dict[str, Any]:
    """Return a grasp straight down on the ball, with a horizontal offset."""
    return {
        "constraint_list": [
            point_to_point(
                "tool_head",
                "rigidbody_object_head",
                0.002,
                target_offset=list(target_offset),
                target_offset_frame="world",
            ),
            pointing_down(0.05),
        ],
        "pre_actuation_motions": ["move-up"],
        "post_actuation_motions": ["move-up"],
        "gripper": "grasp",
    }


def _take(strategy: dict[str, Any]) -> Episode:
    lane = HeadlessEnv(TAKE_BALL, assets="builtin")
    return run(lane, ChainController(TAKE_BALL, {"grasp": strategy}, lane.profile), seed=1).episode


def test_fingers_that_close_beside_the_ball() -> None:
    missed = _take(_grasp((0.07, 0.07, 0.0)))
    assert missed.cause is Cause.GRASP_MISSED
    assert missed.diagnosis["deviations"]
    assert _take(_grasp((0.0, 0.0, 0.0))).held  # without the offset the grasp works


def test_a_ball_that_falls_from_the_hand() -> None:
    lane = HeadlessEnv(PUT_AWAY, assets="builtin", instances=["3"])
    chain = ChainController(PUT_AWAY, load_strategies(PUT_AWAY.name), lane.profile, open_loop=True)
    episode = run(lane, Disturbed(chain, lane, PUT_AWAY, "drop", seed=2), seed=2).episode
    assert episode.cause is Cause.GRASP_LOST
    assert episode.diagnosis["distance"] > 0.03


def test_a_ball_that_is_put_down_beside_the_drawer() -> None:
    beside = {"target_offset": [-0.2, -0.25, 0.05], "target_offset_frame": "world", "tolerance": 0.03}
    strategies = load_strategies(PUT_AWAY.name)
    step = next(step for step in PUT_AWAY.steps if step.name == "place")
    for name in step.strategies:
        first, *others = strategies[name]["constraint_list"]
        strategies[name] = {**strategies[name], "constraint_list": [{**first, **beside}, *others]}
    lane = HeadlessEnv(PUT_AWAY, assets="builtin", instances=["5"])
    episode = run(lane, ChainController(PUT_AWAY, strategies, lane.profile), seed=2).episode
    assert episode.cause is Cause.PLACED_BESIDE
    assert episode.diagnosis["distance"] > 0.1


class _Tossed:
    """A chain that ends with its ball 3 m up and rising; it lands after 2.4 s."""

    def __init__(self, chain: ChainController, lane: HeadlessEnv) -> None:
        self._chain, self._lane = chain, lane

    def __getattr__(self, name: str) -> Any:
        return getattr(self._chain, name)

    def act(self, observation: PrivilegedObservation) -> Action | None:
        action = self._chain.act(observation)
        if action is None:
            part = self._lane.parts["ball"]
            assert isinstance(part, RigidPart)
            x, y, _ = part.entity.pose.p
            part.entity.pose = Pose([x, y, 3.0])
            part.body.linear_velocity = np.array([0.0, 0.0, 11.0], dtype=np.float32)
            part.body.wake_up()
        return action


def test_a_ball_that_still_flies_when_it_is_judged() -> None:
    lane = HeadlessEnv(TAKE_BALL, assets="builtin")
    hover = {**_grasp((0.0, 0.0, 0.03)), "gripper": "open", "post_actuation_motions": []}
    episode = run(lane, _Tossed(ChainController(TAKE_BALL, {"grasp": hover}, lane.profile), lane), seed=1).episode
    assert episode.cause is Cause.GRASP_LOST  # its horizontal position is right, but not its height
    assert not episode.held
