"""Rotation of a placement, compared with scipy for any placement."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.robots import robot
from gensim2.scenes.randomize import (
    START_SPREAD,
    Draw,
    Factors,
    draw_factors,
    draw_object,
    draw_start,
    openness_at_reset,
    placed,
    redraw_placement,
)
from gensim2.tasks.library import load_task
from gensim2.tasks.presets import PRESET_NAMES, preset
from gensim2.tasks.spec import Randomization

_number = st.floats(-2, 2, allow_nan=False)


@given(st.tuples(_number, _number, _number), st.integers(0, 2**32 - 1), _number, _number, _number)
def test_a_placement_turns_about_the_vertical_through_its_own_position(
    position: tuple[float, float, float], seed: int, x: float, y: float, yaw: float
) -> None:
    before = Rotation.random(random_state=seed)
    moved, quaternion = placed(np.array(position), before.as_quat(scalar_first=True), x, y, yaw)
    assert moved == pytest.approx([position[0] + x, position[1] + y, position[2]])
    expected = Rotation.from_euler("z", yaw) * before
    assert (Rotation.from_quat(quaternion, scalar_first=True) * expected.inv()).magnitude() < 1e-9


@given(st.floats(0, 1), st.floats(-0.15, 0.15))
def test_openness_at_reset_stays_in_range(default: float, offset: float) -> None:
    ranges = load_task("OpenDrawer").objects["drawer"].randomization
    value = openness_at_reset(ranges, Draw("0", 0, 0, 0, offset), default)
    assert value == pytest.approx(min(max(default + offset, 0.0), 1.0))


def test_a_task_may_set_the_mean_openness() -> None:
    ranges = load_task("OpenDrawer").objects["drawer"].randomization.model_copy(update={"openness_mean": 0.1})
    assert openness_at_reset(ranges, Draw("0", 0, 0, 0, 0.05), 0.5) == pytest.approx(0.15)


LONG = Randomization(x=(-0.05, 0.05), y=(0.0, 0.05), openness_mean=0.5)
"""The paper's ranges for the receiving objects of its long tasks."""


def _by_hand(seed: int, ranges: Randomization, scale: float, either_way: bool = False) -> Draw:
    """Five numbers from 0 to 1, in the original's order: instance, x, y, yaw (its sign from y), openness."""
    which, x, y, yaw, spread = rng(seed, "Any").random(5)
    x, y = (scale * (low + (high - low) * at) for (low, high), at in ((ranges.x, x), (ranges.y, y)))
    most = scale * ranges.yaw
    turn = abs(most) * (2 * yaw - 1) if either_way else most * yaw * (1 if y > 0 else -1)
    return Draw("abc"[int(3 * which)], x, y, turn, scale * ranges.openness_spread * (2 * spread - 1))


@pytest.mark.parametrize("ranges", [Randomization(), LONG, Randomization(yaw=-0.5, openness_spread=0.0)])
@pytest.mark.parametrize(
    ("name", "scale", "either_way"), [("paper", 1, False), ("paper-half", 0.5, False), ("wide", 1.5, True)]
)
def test_a_preset_draws_the_same_numbers_from_its_own_ranges(
    name: str, scale: float, either_way: bool, ranges: Randomization
) -> None:
    for seed in range(200):
        drawn, expected = (
            draw_object(rng(seed, "Any"), ranges, preset(name), "abc"),
            _by_hand(seed, ranges, scale, either_way),
        )
        assert drawn.instance == expected.instance
        for field in ("x", "y", "yaw", "openness_offset"):
            assert getattr(drawn, field) == pytest.approx(getattr(expected, field), abs=1e-15)


def test_the_ranges_of_a_task_that_says_nothing_are_the_papers() -> None:
    drawn = [draw_object(rng(seed, "Any"), Randomization(), preset("paper"), "a") for seed in range(2000)]
    for field, bound in (("x", 0.1), ("y", 0.1), ("yaw", np.pi / 6), ("openness_offset", 0.15)):
        values = np.array([getattr(each, field) for each in drawn])
        assert (values.min(), values.max()) == pytest.approx((-bound, bound), rel=0.01)
        assert values.mean() == pytest.approx(0.0, abs=0.05 * bound)
    assert all(each.yaw * each.y >= 0 for each in drawn)


def test_a_negative_yaw_turns_to_the_other_side() -> None:
    for seed in range(100):
        one, other = (
            draw_object(rng(seed, "Any"), Randomization(yaw=yaw), preset("paper"), "a") for yaw in (0.5, -0.5)
        )
        assert (one.x, one.y, one.yaw, one.openness_offset) == (other.x, other.y, -other.yaw, other.openness_offset)


def test_what_is_placed_again_is_the_same_object() -> None:
    for name in PRESET_NAMES:
        generator = rng(0, "Any")
        first = draw_object(generator, LONG, preset(name), "abc")
        again = redraw_placement(generator, LONG, preset(name), first)
        assert (again.instance, again.openness_offset) == (first.instance, first.openness_offset)
        assert again.x != first.x


def test_wide_scenes_vary_physics_and_the_robots_start() -> None:
    drawn = [draw_factors(rng(seed, "Any"), has_joint=True) for seed in range(2000)]
    for field, low, high in (("mass", 0.5, 2.0), ("contact_friction", 0.5, 2.0), ("joint_friction", 0.8, 2.0)):
        values = np.array([getattr(each, field) for each in drawn])
        assert (values.min(), values.max()) == pytest.approx((low, high), rel=0.01)
        assert np.median(values) == pytest.approx(np.sqrt(low * high), rel=0.05)
    both = draw_factors(rng(0, "Any"), has_joint=True), draw_factors(rng(0, "Any"), has_joint=False)
    assert both[1] == Factors(both[0].mass, both[0].contact_friction, 1.0)
    for name in ("panda", "fetch"):
        profile = robot(name)
        starts = np.array([draw_start(rng(seed, "Any"), profile) for seed in range(500)])
        size, rest = profile.arm_size, np.array(profile.reset_qpos)
        assert np.abs(starts - rest)[:, :size].max() == pytest.approx(START_SPREAD, rel=0.01)
        assert np.array_equal(starts[:, size:], np.tile(rest[size:], (500, 1)))
        assert np.all((starts >= profile.model.lower - 1e-12) & (starts <= profile.model.upper + 1e-12))


def test_a_preset_that_there_is_not_is_refused() -> None:
    with pytest.raises(InputError, match="one of paper, paper-half, wide"):
        preset("narrow")
