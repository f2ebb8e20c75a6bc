"""Turning a placement: against scipy, for any placement."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gensim2.sim.randomize import Draw, openness_at_reset, placed
from gensim2.tasks.library import load_task

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
