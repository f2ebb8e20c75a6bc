"""Statistics of the depth noise agree with its parameters."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from gensim2.core.errors import InputError
from gensim2.perception import D435, CloudSettings, DepthNoise, ObservationSpec
from gensim2.perception.raycast.observer import Observer
from gensim2.robots import robot

WALL = np.full((200, 200), 0.9, dtype=np.float32)
STEP = np.where(np.arange(200) < 100, 0.5, 1.5).astype(np.float32) * np.ones((200, 1), dtype=np.float32)


def measured(noise: DepthNoise, depth: np.ndarray, seed: int = 0) -> np.ndarray:
    return noise.on(depth, np.random.default_rng(seed))


def test_the_error_grows_with_the_square_of_the_depth() -> None:
    noise = DepthNoise(lost=0.0, disparity_step=0.0)
    for depth in (0.5, 1.0, 2.0):
        errors = measured(noise, np.full((200, 200), depth, dtype=np.float32)) - depth
        expected = depth**2 * noise.disparity_sigma / (noise.focal * noise.baseline)
        assert errors.std() == pytest.approx(expected, rel=0.05)
        assert abs(errors.mean()) < 0.05 * expected


def test_depths_come_in_steps_of_disparity() -> None:
    noise = DepthNoise(lost=0.0, disparity_step=0.25)
    disparity = noise.focal * noise.baseline / measured(noise, WALL).astype(np.float64)
    assert np.abs(disparity / 0.25 - np.round(disparity / 0.25)).max() < 1e-4
    assert len(np.unique(np.round(disparity / 0.25))) > 1


def test_pixels_are_lost_as_often_as_it_says_and_holes_stay_holes() -> None:
    noise = DepthNoise(lost=0.1)
    depth = WALL.copy()
    depth[:50] = 0.0
    found = measured(noise, depth)
    assert (found[:50] == 0).all()
    assert (found[50:] == 0).mean() == pytest.approx(0.1, abs=0.01)


def test_edges_are_lost_or_lie_between_their_sides() -> None:
    noise = DepthNoise(edge_lost=0.3, edge_mixed=0.4, lost=0.0, disparity_sigma=0.0, disparity_step=0.0)
    found = measured(noise, STEP)
    edge, rest = found[:, 99:101], np.delete(found, [99, 100], axis=1)
    assert np.allclose(rest, np.delete(STEP, [99, 100], axis=1), atol=1e-6)
    assert (edge == 0).mean() == pytest.approx(0.3, abs=0.08)
    between = (edge > 0.501) & (edge < 1.499)
    assert between.mean() == pytest.approx(0.4, abs=0.08)


def test_the_same_seed_gives_the_same_noise_and_another_another() -> None:
    assert np.array_equal(measured(DepthNoise(), STEP, 1), measured(DepthNoise(), STEP, 1))
    assert not np.array_equal(measured(DepthNoise(), STEP, 1), measured(DepthNoise(), STEP, 2))


PLAIN = DepthNoise(lost=0.0, edge_lost=0.0, edge_mixed=0.0, disparity_sigma=0.0, disparity_step=0.0)
FOCAL = 200.0


def test_white_noise_draws_what_it_drew_before_there_was_more() -> None:
    """Data sets with this noise must be rendered again byte for byte."""
    one, other = np.random.default_rng(3), np.random.default_rng(3)
    DepthNoise().on(STEP, one, np.zeros((200, 200, 3), np.uint8), FOCAL)
    other.random(STEP.shape, dtype=np.float32)
    other.random(STEP.shape, dtype=np.float32)
    other.standard_normal(STEP.shape, dtype=np.float32)
    assert one.random() == other.random()


@pytest.mark.parametrize("sigma", [1.0, 2.5])
def test_neighbours_err_alike_and_the_error_is_as_strong(sigma: float) -> None:
    noise = replace(PLAIN, disparity_sigma=0.08, correlation=sigma)
    pair = noise.focal * noise.baseline
    error = pair / measured(noise, WALL).astype(np.float64) - pair / 0.9
    assert error.std() == pytest.approx(0.08, rel=0.1)
    shared = (error[:, 1:] * error[:, :-1]).mean() / error.var()
    assert shared == pytest.approx(np.exp(-1.0 / (4.0 * sigma**2)), abs=0.06)


def test_the_shadow_of_a_pair_is_as_wide_as_it_says() -> None:
    noise = replace(PLAIN, shadow=True)
    depth = np.full((10, 300), 2.0, dtype=np.float32)
    depth[:, 150:200] = 0.5
    found = noise.on(depth, np.random.default_rng(0), focal=400.0)
    width = 400.0 * 0.05 * (1 / 0.5 - 1 / 2.0)
    lost = found == 0
    assert lost.sum(axis=1) == pytest.approx(width, abs=1.0)
    assert lost[:, 151 - round(width) : 150].all(), "it lies to the left of the near thing"
    assert not lost[:, 150:].any()


def test_near_things_grow_at_their_edges_and_no_further_than_it_says() -> None:
    found = measured(replace(PLAIN, fattening=3.0), STEP)
    grown = (np.abs(found - 0.5) < 1e-6).sum(axis=1) - 100
    assert grown.max() <= 3
    assert grown.mean() > 0.5
    assert grown.min() >= 0


def test_dark_grazing_and_specular_surfaces_are_lost() -> None:
    colors = np.full((200, 200, 3), 200, np.uint8)
    colors[:100] = 5
    dark = replace(PLAIN, dark=0.1, dark_lost=0.5).on(WALL, np.random.default_rng(0), colors, FOCAL)
    assert (dark[:100] == 0).mean() == pytest.approx(0.5, abs=0.03)
    assert (dark[100:] > 0).all()
    slope = (0.5 + 0.015 * np.arange(200)[None] * np.ones((200, 1))).astype(np.float32)  # at least 75 degrees
    grazed = replace(PLAIN, grazing=0.8, grazing_lost=0.5).on(slope, np.random.default_rng(0), None, FOCAL)
    assert (grazed[2:-2, 2:100] == 0).mean() == pytest.approx(0.5, abs=0.03)
    facing = replace(PLAIN, specular=0.05, specular_lost=0.5)
    assert (measured(facing, WALL)[2:-2, 2:-2] == 0).mean() == pytest.approx(0.5, abs=0.03)
    assert (facing.on(slope, np.random.default_rng(0), None, FOCAL) > 0).all()


def test_episodes_differ_by_as_much_as_it_says() -> None:
    noise = replace(D435, spread=0.3)
    sigmas = [noise.drawn(np.random.default_rng(seed)).disparity_sigma for seed in range(400)]
    assert np.log(sigmas).std() == pytest.approx(0.3, rel=0.15)
    assert replace(D435, spread=0.0).drawn(np.random.default_rng(0)) == replace(D435, spread=0.0)
    wrong = replace(PLAIN, rotation=0.02, translation=0.005, scale=0.01, bias=0.002)
    errors = [wrong.error(np.random.default_rng(seed)) for seed in range(400)]
    shifts = np.array([each.T[:3, 3] for each in errors])
    assert np.sqrt((shifts**2).sum(axis=1).mean()) == pytest.approx(0.005, rel=0.1)
    assert np.std([each.scale for each in errors]) == pytest.approx(0.01, rel=0.15)
    assert errors[0].on(np.array([[0.0, 1.0]], np.float32))[0, 0] == 0.0


@pytest.mark.parametrize("wrong", [{"dark_lost": 1.5}, {"fattening": 50.0}, {"correlation": -1.0}, {"time": np.nan}])
def test_noise_that_cannot_be_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        DepthNoise(**wrong)  # type: ignore[arg-type]


def test_settings_of_before_load_and_all_of_noise_survives_plain_data() -> None:
    before = {"noise": {"focal": 425.0, "baseline": 0.05, "disparity_sigma": 0.08, "lost": 0.005}}
    assert CloudSettings.of(before).noise == DepthNoise()
    settings = CloudSettings(noise=replace(D435, time=0.01, rotation=0.01))
    assert CloudSettings.of(json.loads(json.dumps(settings.to_dict()))) == settings


def test_an_observer_believes_its_cameras_and_its_clock_where_they_err() -> None:
    profile = robot("panda")
    q, v = np.array(profile.reset_qpos), np.full(9, 0.5)
    base = [*profile.base_position, *profile.base_quaternion, *np.zeros(6)]
    states = {"articulations": {profile.agent: np.concatenate([base, q, v])[None].astype(np.float32)}}
    seen = {}
    for name, noise in (
        ("true", PLAIN),
        ("off", replace(PLAIN, rotation=0.05, translation=0.02, bias=0.01, time=0.02)),
    ):
        settings = CloudSettings(points=512, candidates=1024, robot="all", noise=noise)
        spec = ObservationSpec(cameras=("left",), cloud=settings)
        seen[name] = [Observer(profile, {}, spec, seed).observe(states, 0) for seed in (1, 1, 2)]
    late = seen["off"][0].joint_positions - seen["true"][0].joint_positions
    assert np.abs(late[:7]).max() > 1e-4
    np.testing.assert_allclose(late[:7], late[0], rtol=1e-3)  # with the same delay
    clouds = [each.cloud.xyz for each in seen["off"]]
    np.testing.assert_array_equal(clouds[0], clouds[1])
    assert not np.array_equal(clouds[0], clouds[2])
    off = seen["off"][0].cameras["left"].T_base_camera
    assert not np.allclose(off, seen["true"][0].cameras["left"].T_base_camera)
