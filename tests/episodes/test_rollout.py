"""What counts as a success, and what does not."""

from __future__ import annotations

import numpy as np
import pytest
from gensim2.demos.rollout import SETTLE_STEPS, check_actions, run_episode, still_arm
from jobs import HALFWAY, hold, push

from gensim2.errors import InputError
from gensim2.sim.lane import Lane


@pytest.fixture(scope="module")
def lane() -> Lane:
    return Lane(HALFWAY, assets="builtin")


def test_an_episode_is_judged_after_the_object_has_settled(lane: Lane) -> None:
    lane.reset(seed=0)
    actions = push(lane.scene_state())
    result = run_episode(lane, actions)
    assert result.success
    assert result.settled
    assert not result.truncated
    assert result.steps >= len(actions) + SETTLE_STEPS
    assert result.openness_end < 0.3 < result.openness_start
    assert result.openness_end == pytest.approx(lane.openness)


def test_a_still_arm_fails_where_the_object_stays(lane: Lane) -> None:
    result = still_arm(lane, 0, 50)
    assert not result.success
    assert result.openness_end == pytest.approx(result.openness_start, abs=0.005)
    lane.reset(seed=0)
    assert result.openness_start == lane.openness


def test_an_object_that_moves_by_itself_shows_with_a_still_arm() -> None:
    """The lid of a box without friction falls shut: closing it would count for nothing."""
    import dataclasses

    from gensim2.objects import open_library
    from gensim2.objects.types import Instance

    library = open_library("builtin")

    class Slippery:
        def instances(self, asset_class: str, /) -> tuple[str, ...]:
            return library.instances(asset_class)[:1]

        def choose(self, asset_class: str, which: str, /) -> tuple[str, ...]:
            return self.instances(asset_class)

        def load(self, asset_class: str, instance_id: str, /) -> Instance:
            instance = library.load(asset_class, instance_id)
            return dataclasses.replace(instance, joint=dataclasses.replace(instance.joint, friction=1e-4, damping=0.0))

    slippery = Lane("CloseBox", assets=Slippery())
    assert still_arm(slippery, 1).success
    normal = Lane("CloseBox", assets="builtin", instances=slippery.instance_ids)
    assert not still_arm(normal, 1).success


def test_a_passing_success_does_not_count(lane: Lane, monkeypatch: pytest.MonkeyPatch) -> None:
    """The drawer is pushed far enough, then dragged out of the goal by hand: only the end is judged."""
    lane.reset(seed=0)
    actions = push(lane.scene_state())
    pushed = False

    original = lane._advance

    def drag_back() -> None:
        nonlocal pushed
        original()
        if lane.elapsed_steps == len(actions) + 5:
            pushed = lane.openness < 0.3
            joint = lane.instance.joint
            lane._object.qpos = np.array([joint.lower + 0.9 * (joint.upper - joint.lower)], dtype=np.float32)

    monkeypatch.setattr(lane, "_advance", drag_back)
    result = run_episode(lane, actions)
    assert pushed
    assert result.success_once
    assert not result.success


def test_an_episode_over_the_limit_is_truncated_and_fails(lane: Lane) -> None:
    lane.reset(seed=0)
    actions = push(lane.scene_state())
    result = run_episode(lane, np.concatenate([actions, np.repeat(actions[-1:], 70, axis=0)]))
    assert result.steps > lane.max_episode_steps
    assert result.truncated
    assert result.success_once
    assert not result.success


def test_float64_actions_give_the_states_that_a_file_would_replay(lane: Lane) -> None:
    lane.reset(seed=2)
    actions = push(lane.scene_state())
    double = run_episode(lane, actions, seed=2)
    single = run_episode(lane, actions.astype(np.float32), seed=2)
    assert double == single


@pytest.mark.parametrize(
    "actions",
    [np.zeros((0, 8)), np.zeros((5, 7)), np.zeros(8), np.full((3, 8), np.nan), np.full((3, 8), np.inf)],
)
def test_bad_actions_are_refused(actions: np.ndarray) -> None:
    with pytest.raises(InputError, match="actions: must be"):
        check_actions(actions)


def test_an_episode_begins_with_a_reset(lane: Lane) -> None:
    run_episode(lane, hold(), seed=0)
    with pytest.raises(InputError, match="already begun"):
        run_episode(lane, hold())
    with pytest.raises(InputError, match="need a seed"):
        run_episode(lane, hold(), options={"openness": 0.5})
