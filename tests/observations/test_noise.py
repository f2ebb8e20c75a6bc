"""Statistics of the depth noise: what it says of itself is what it does."""

from __future__ import annotations

import numpy as np
import pytest

from gensim2.observations import DepthNoise

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
