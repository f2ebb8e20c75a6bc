"""The Research 3: the Panda's links, the published limits, and plans that keep them."""

from __future__ import annotations

import limits as judge
import numpy as np
import pytest

pytest.importorskip("mani_skill")

from gensim2.robots import robot
from gensim2.rollout.chain import ChainController
from gensim2.rollout.run import run
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_strategies, load_task

PUBLISHED = judge.PUBLISHED["fr3"]


def test_limits_are_its_own_and_links_are_the_pandas() -> None:
    model, panda = robot("fr3").model, robot("panda").model
    np.testing.assert_array_equal(model.lower[:7], PUBLISHED.lower)
    np.testing.assert_array_equal(model.upper[:7], PUBLISHED.upper)
    np.testing.assert_array_equal(model.velocity[:7], PUBLISHED.velocity)
    np.testing.assert_array_equal(model.effort[:7], [87.0] * 4 + [12.0] * 3)
    draw = np.random.default_rng(4)
    q = np.append(draw.uniform(PUBLISHED.lower, PUBLISHED.upper), [0.02, 0.03])
    np.testing.assert_array_equal(model.forward_kinematics(q), panda.forward_kinematics(q))


def test_the_planner_closes_the_box_within_its_limits() -> None:
    env = HeadlessEnv("CloseBox", assets="builtin", robot="fr3")
    controller = ChainController(load_task("CloseBox"), load_strategies("CloseBox"), env.profile)
    for seed in range(2):
        result = run(env, controller, seed=seed, record=True)
        assert result.episode.held
        assert result.recording is not None
        meant = result.recording.reference
        known = np.isfinite(meant["joint_positions"]).all(axis=1)
        q, v = (meant[name][known].astype(np.float64) for name in ("joint_positions", "joint_velocities"))
        assert np.abs(v).max() > 0.3, "it moves"
        assert (np.abs(v) <= PUBLISHED.fastest(q, v) + 1e-4).all()
