"""Scenes drawn from wider ranges: the values reach physics, the record and a replay."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from gensim2.data.trajectory import env_kwargs
from gensim2.robots import robot
from gensim2.rollout.no_op import NoOpController
from gensim2.rollout.run import run
from gensim2.scenes.config import SceneOptions
from gensim2.sim.headless import HeadlessEnv
from gensim2.sim.parts import ArticulatedPart, Part
from gensim2.sim.registration import env_id
from gensim2.tasks.presets import PRESET_NAMES

TASK = "PlaceGolfBallIntoDrawer"
PANDA = robot("panda")


def _weights(part: Part) -> np.ndarray:
    """Return mass and inertia (N, 4) of each body."""
    bodies = part.articulation.links if isinstance(part, ArticulatedPart) else [part.body]
    return np.array([[body.mass, *body.inertia] for body in bodies], dtype=np.float64)


def _frictions(part: Part) -> np.ndarray:
    """Return static and dynamic friction and restitution (N, 3) of each shape."""
    bodies = part.articulation.links if isinstance(part, ArticulatedPart) else [part.body]
    materials = [shape.physical_material for body in bodies for shape in body.collision_shapes]
    return np.array([[each.static_friction, each.dynamic_friction, each.restitution] for each in materials])


def _resistance(part: Part) -> float:
    assert isinstance(part, ArticulatedPart)
    (joint,) = part.articulation.active_joints
    return float(joint.friction) or float(joint.force_limit)


@pytest.mark.parametrize("physics", ["default", "original"])
def test_what_is_drawn_reaches_physics(physics: str) -> None:
    plain, wide = (
        HeadlessEnv(TASK, assets="builtin", physics=physics, randomization=name) for name in ("paper", "wide")
    )
    seen = set()
    for seed in range(3):
        plain.reset(seed)
        wide.reset(seed)
        assert plain.initial_state.start == PANDA.reset_qpos
        assert wide.q == pytest.approx(wide.initial_state.start, abs=1e-6)
        assert np.abs(wide.q - plain.q)[:7].max() > 0.01
        for name, part in wide.parts.items():
            before, factors = plain.parts[name], part.thing.factors
            assert part.model.id == before.model.id
            assert _weights(part) == pytest.approx(factors.mass * _weights(before), rel=1e-5)
            expected = _frictions(before) * [factors.contact_friction, factors.contact_friction, 1.0]
            assert _frictions(part) == pytest.approx(expected, rel=1e-5)
            seen.add(factors)
        drawer = wide.parts["drawer"].thing.factors
        joint = drawer.joint_friction * (drawer.mass if physics == "default" else 1.0)
        assert _resistance(wide.parts["drawer"]) == pytest.approx(joint * _resistance(plain.parts["drawer"]), rel=1e-5)
    assert len(seen) == 6


def test_no_preset_shifts_what_another_draws() -> None:
    lanes = {name: HeadlessEnv(TASK, assets="builtin", randomization=name) for name in PRESET_NAMES}
    for seed in range(5):
        for lane in lanes.values():
            lane.reset(seed)
        paper, half = (lanes[name].initial_state for name in ("paper", "paper-half"))
        if (paper.draws, half.draws) != (1, 1):
            continue
        for name, thing in paper.objects.items():
            assert half.objects[name].yaw == pytest.approx(thing.yaw / 2)
            assert lanes["wide"].initial_state.objects[name].model.id == thing.model.id


def test_the_record_tells_every_draw() -> None:
    lane = HeadlessEnv("OpenDrawer", assets="builtin", randomization="wide")
    episode = run(lane, NoOpController(PANDA, 2), seed=3).episode
    thing, record = lane.initial_state.objects["drawer"], episode.objects["drawer"]
    assert (episode.randomization, tuple(episode.start)) == ("wide", lane.initial_state.start)
    assert (record.id, record.yaw, record.pose[:3]) == (thing.model.id, thing.yaw, list(thing.position))
    assert record.openness_start == pytest.approx(thing.openness, abs=1e-6)
    told = (record.mass_factor, record.contact_friction_factor, record.joint_friction_factor)
    assert told == (thing.factors.mass, thing.factors.contact_friction, thing.factors.joint_friction)
    assert 1.0 not in told


def test_a_wide_scene_is_replayed_by_what_travels_with_a_trajectory() -> None:
    environment: dict[str, Any] = SceneOptions("builtin", randomization="wide").environment
    assert environment == {"randomization": "wide"}
    lane = HeadlessEnv(TASK, assets="builtin", randomization="wide")
    moves = np.random.default_rng(0).normal(0.0, 0.2, (40, 8)).astype(np.float32)
    for seed in (1, 2):
        lane.reset(seed)
        ids = {name: [thing.model.id] for name, thing in lane.initial_state.objects.items()}
        env = gym.make(env_id(lane.task), **env_kwargs(lane.task, "builtin", ids, environment))
        observed, _ = env.reset(seed=seed, options={"instance": {name: each for name, (each,) in ids.items()}})
        assert np.array_equal(observed[0].numpy(), lane.observation())
        for move in moves:
            action = np.append(lane.initial_state.start[:7], 1.0).astype(np.float32) + move
            observed, *_ = env.step(action)
            lane.step(action)
        assert np.array_equal(observed[0].numpy(), lane.observation())
        assert repr(lane.measure()) == repr(env.unwrapped.measure())
        env.close()


def test_without_the_arm_the_hand_counts_as_standing_at_the_drawn_start() -> None:
    lane = HeadlessEnv("OpenDrawer", assets="builtin", randomization="wide")
    lane.reset(5)
    hand = dict(lane.measure().gripper)
    lane.reset(5, robot=False)
    for name, point in lane.measure().gripper.items():
        assert point == pytest.approx(hand[name], abs=1e-5)
