"""The episode loop: when an episode is judged, and what counts."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np
import pytest
from jobs import HALFWAY, ROLE, Actions, hold, push

from gensim2.core.errors import InputError
from gensim2.objects.types import Hulls
from gensim2.planning.scene import Scene
from gensim2.rollout.motion import SETTLE_SECONDS
from gensim2.rollout.no_op import NoOpController, NoOpResult, no_op_baseline
from gensim2.rollout.record import Cause, StrictMiss
from gensim2.rollout.run import run
from gensim2.rollout.world import World
from gensim2.sim.headless import HeadlessEnv


@pytest.fixture(scope="module")
def lane() -> HeadlessEnv:
    return HeadlessEnv(HALFWAY, assets="builtin")


def test_an_episode_is_judged_after_the_object_has_settled(lane: HeadlessEnv) -> None:
    controller = Actions(push)
    episode = run(lane, controller, seed=0).episode
    assert episode.held
    assert episode.paper
    assert episode.settled
    assert not episode.truncated
    assert episode.still is False
    assert episode.cause is None
    assert episode.control_steps >= controller.count + lane.profile.steps(SETTLE_SECONDS)
    drawer = episode.objects[ROLE]
    assert drawer.openness_end is not None
    assert drawer.openness_start is not None
    assert drawer.openness_end < 0.3 < drawer.openness_start
    assert [(step.name, step.paper, step.done) for step in episode.steps] == [("act", True, True)]


def test_a_hand_that_leans_against_the_drawer_at_the_end_is_no_strict_success(lane: HeadlessEnv) -> None:
    episode = run(lane, Actions(push), seed=0).episode
    assert episode.held
    assert not episode.strict
    assert {StrictMiss.NOT_LET_GO, StrictMiss.NOT_RETREATED} <= set(episode.strict_misses)
    assert episode.diagnosis[StrictMiss.NOT_LET_GO] == {"touches": [ROLE]}


def test_a_hand_that_backs_off_is_one(lane: HeadlessEnv) -> None:
    def push_and_leave(scene: Scene) -> np.ndarray:
        actions = push(scene)
        back = np.linspace(actions[-1], actions[-20], 15)
        return np.concatenate([actions, back])

    episode = run(lane, Actions(push_and_leave), seed=0).episode
    assert episode.held
    assert episode.strict, episode.strict_misses
    assert episode.strict_misses == []


def test_a_lane_is_a_world(lane: HeadlessEnv) -> None:
    world: World = lane
    assert world.task.max_episode_steps == 120


def test_the_no_op_baseline_fails_where_the_object_stays(lane: HeadlessEnv) -> None:
    result = no_op_baseline(lane, 0, steps=50)
    assert not result.success
    assert result.end.openness[ROLE] == pytest.approx(result.start.openness[ROLE], abs=0.005)
    lane.reset(seed=0)
    assert result.start.openness == lane.measure().openness
    episode = run(lane, NoOpController(lane.profile, 30), seed=0).episode
    assert not episode.held
    assert episode.cause is Cause.NO_CONTACT
    assert episode.still is None  # not computed


def test_an_object_that_moves_by_itself_shows_in_the_no_op_baseline() -> None:
    """The lid of a box without friction falls shut, so closing it does not count."""
    from gensim2.scenes.arguments import as_library

    library = as_library("builtin")

    class Slippery:
        def source(self, asset_class: str, /) -> str:
            return library.source(asset_class)

        def instances(self, asset_class: str, /) -> tuple[str, ...]:
            return library.instances(asset_class)[:1]

        def choose(self, asset_class: str, which: str, /) -> tuple[str, ...]:
            return self.instances(asset_class)

        def load(self, asset_class: str, instance_id: str, hulls: Hulls = "default", /) -> Any:
            instance = library.load(asset_class, instance_id)
            assert instance.joint is not None
            return dataclasses.replace(instance, joint=dataclasses.replace(instance.joint, friction=1e-4, damping=0.0))

    slippery = HeadlessEnv("CloseBox", assets=Slippery())
    assert no_op_baseline(slippery, 1).success
    normal = HeadlessEnv("CloseBox", assets="builtin", instances=[Slippery().instances("box_rotate")[0]])
    assert not no_op_baseline(normal, 1).success
    episode = run(slippery, NoOpController(slippery.profile, 100), seed=1).episode
    assert episode.paper
    assert episode.still
    assert not episode.held
    assert episode.cause is Cause.HAPPENS_BY_ITSELF


def test_the_no_op_baseline_is_asked_for_only_where_the_goal_holds(lane: HeadlessEnv) -> None:
    asked = []

    def still() -> NoOpResult:
        asked.append(True)
        return no_op_baseline(lane, 0)

    run(lane, Actions(hold), seed=0, still=still)
    assert not asked
    assert run(lane, Actions(push), seed=0, still=still).episode.held
    assert asked == [True]


def test_a_passing_success_does_not_count(lane: HeadlessEnv, monkeypatch: pytest.MonkeyPatch) -> None:
    """The drawer is pushed far enough and then pulled out of the goal: only the end counts."""
    controller = Actions(push)
    pushed = False
    original = lane._advance

    def drag_back() -> None:
        nonlocal pushed
        original()
        if lane.elapsed_steps == controller.count + 5:
            part = lane.parts[ROLE]
            pushed = part.openness < 0.3
            joint = part.model.joint
            part.articulation.qpos = np.array([joint.lower + 0.9 * (joint.upper - joint.lower)], dtype=np.float32)

    monkeypatch.setattr(lane, "_advance", drag_back)
    episode = run(lane, controller, seed=0).episode
    assert pushed
    assert episode.paper
    assert not episode.held
    assert episode.cause is Cause.GOAL_UNDONE


def test_an_episode_over_the_limit_is_truncated_and_fails(lane: HeadlessEnv) -> None:
    """A push that ends just before the limit, and one that never ends."""
    limit = lane.task.max_episode_steps
    for extra in (limit - 3, limit + 70):

        def dawdling(scene: Scene, extra: int = extra) -> np.ndarray:
            actions = push(scene)
            return np.concatenate([actions, np.repeat(actions[-1:], extra - len(actions), axis=0)])

        episode = run(lane, Actions(dawdling), seed=0).episode
        assert episode.truncated
        assert episode.paper
        assert not episode.held
        assert episode.cause is Cause.TIME_OVER
        assert episode.control_steps <= limit + lane.profile.steps(SETTLE_SECONDS)


def test_float64_actions_give_the_states_that_a_file_would_replay(lane: HeadlessEnv) -> None:
    double = run(lane, Actions(push), seed=2, record=True)
    single = run(lane, Actions(lambda scene: push(scene).astype(np.float32)), seed=2, record=True)
    assert double.episode == single.episode
    assert double.recording is not None
    assert single.recording is not None
    assert np.array_equal(double.recording.obs, single.recording.obs)


@pytest.mark.parametrize("actions", [np.zeros((5, 7)), np.full((3, 8), np.nan), np.full((3, 8), np.inf)])
def test_bad_actions_are_refused(lane: HeadlessEnv, actions: np.ndarray) -> None:
    with pytest.raises(InputError, match="action: must be 8 finite numbers"):
        run(lane, Actions(lambda scene: actions), seed=0)


def test_a_controller_without_a_first_action_ends_the_episode(lane: HeadlessEnv) -> None:
    result = run(lane, Actions(lambda scene: np.zeros((0, 8))), seed=0, record=True)
    assert result.recording is None
    assert result.episode.control_steps == 0
    assert not result.episode.held
    assert not result.episode.truncated


@pytest.mark.parametrize("value", [1e6, np.nan])
def test_physics_that_blows_up_is_named_and_is_valid_json(
    lane: HeadlessEnv, monkeypatch: pytest.MonkeyPatch, value: float
) -> None:
    original = lane._advance

    def explode() -> None:
        original()
        if lane.elapsed_steps >= 20:
            lane.parts[ROLE].articulation.qpos = np.array([value], dtype=np.float32)

    monkeypatch.setattr(lane, "_advance", explode)
    episode = run(lane, Actions(hold), seed=0).episode
    assert episode.cause is Cause.UNSTABLE
    assert not episode.paper
    assert json.loads(json.dumps(episode.to_dict(), allow_nan=False))["cause"] == "physics became unstable"
