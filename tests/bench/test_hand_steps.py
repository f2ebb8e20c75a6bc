"""The original's execution: hand poses by the plan's clock, a screw motion per step, criteria checked at its end."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mani_skill")

from hand_steps import MAX_STEPS, HandStepsController, control_steps
from tests.common.pushing_config import CONFIG

from gensim2.robots import robot
from gensim2.rollout.run import run
from gensim2.rollout.turns import told_turns
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_task

TASK = load_task("PushDrawerClose").model_copy(update={"max_episode_steps": 1000})


@pytest.fixture(scope="module")
def env() -> HeadlessEnv:
    return HeadlessEnv(TASK, assets="builtin", physics="original", robot="panda_long")


def test_the_hand_is_where_the_plan_has_it_after_each_step(env: HeadlessEnv) -> None:
    profile = robot("panda_long")
    controller = HandStepsController(TASK, profile, config=CONFIG)
    found = run(env, controller, seed=5, record=True, every=control_steps(profile))
    assert [plan.status for plan in found.episode.steps[0].plans] == ["solved"]
    assert found.recording is not None
    rotations, times, positions = controller._hand or pytest.fail("no plan")
    actions = found.recording.actions
    for step in range(min(10, len(actions) // control_steps(profile))):
        target = np.append(actions[(step + 1) * control_steps(profile) - 1][:7], [0.04, 0.04]).astype(np.float64)
        at = 0.8 * (step + 1)
        hand = profile.model.forward_kinematics(target)
        wanted = [np.interp(at, times, column) for column in positions.T]
        assert np.abs(hand[:3, 3] - wanted).max() < 1e-3
        assert np.abs(hand[:3, :3] - rotations(at).as_matrix()).max() < 1e-2
    assert found.episode.control_steps >= control_steps(profile)


def test_an_episode_ends_with_the_first_step_at_whose_end_the_goal_holds(env: HeadlessEnv) -> None:
    profile = robot("panda_long")
    steps = control_steps(profile)
    for seed in range(5, 9):
        episode = run(env, HandStepsController(TASK, profile, config=CONFIG), seed=seed, every=steps).episode
        ran = episode.steps[0].plans[0].ran
        assert ran % steps == 0
        assert episode.paper or ran == MAX_STEPS * steps


def test_what_has_no_pose_ends_at_once(env: HeadlessEnv) -> None:
    profile = robot("panda_long")
    far = {**CONFIG["constraint_list"][0], "target_offset": [3.0, 0.0, 0.0]}
    controller = HandStepsController(TASK, profile, config={**CONFIG, "constraint_list": [far]})
    episode = run(env, controller, seed=5).episode
    assert not episode.paper
    assert episode.control_steps == 0


def test_criteria_are_read_every_so_often(env: HeadlessEnv) -> None:
    """The drawer is closed at a single instant between two checks."""
    env.reset(5)
    measured = env.measure()
    name = TASK.steps[0].object
    opened = type(measured)(**{**vars(measured), "openness": {name: 0.9}})
    closed = type(measured)(**{**vars(measured), "openness": {name: 0.1}})
    trace = [opened] * 20 + [closed] + [opened] * 20
    begun = [(TASK.steps[0].name, 0)]
    assert told_turns(TASK, trace, begun)[0].paper
    assert told_turns(TASK, trace, begun, 20)[0].paper
    assert not told_turns(TASK, trace, begun, 17)[0].paper
