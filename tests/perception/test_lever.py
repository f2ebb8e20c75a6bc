"""The lever on the side of a toaster is measured in a cloud."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from gensim2.perception.estimation.lever import lever_near
from gensim2.perception.estimation.scene import scene_object

from .test_estimation import look_at, truth

Array = npt.NDArray[np.float64]
END, KNOB = np.array([-0.12, 0.02, 0.13]), np.array([-0.115, 0.02, 0.03])


def toaster(yaw: float) -> tuple[Array, Array, Array]:
    """Return the points of a toaster, 0.2 m long, 0.14 m wide and 0.2 m high, with a lever and a knob on one side, the
    upper end of the lever, and the normal of the other side.
    """
    long, wide, high = (np.arange(-each, each + 1e-9, 0.005) for each in (0.1, 0.07, 0.1))
    front = np.stack(np.meshgrid([-0.1], wide, high + 0.1), axis=-1).reshape(-1, 3)
    top = np.stack(np.meshgrid(long, wide, [0.2]), axis=-1).reshape(-1, 3)
    lever = np.stack([np.full(9, -0.12), np.full(9, 0.02), np.linspace(0.11, 0.13, 9)], axis=1)
    knob = KNOB + np.random.default_rng(0).uniform(-0.004, 0.004, (9, 3))
    turn = Rotation.from_euler("z", yaw).as_matrix()
    return np.concatenate([front, top, knob, lever]) @ turn.T, turn @ END, turn[:, 0]


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
@pytest.mark.parametrize("off", [(0.0, 0.01, -0.04), (0.005, -0.01, 0.03)])
def test_the_lever_is_the_body_on_the_side_that_is_nearest_to_the_estimate(
    yaw: float, off: tuple[float, float, float]
) -> None:
    points, end, forwards = toaster(yaw)
    found = lever_near(end + off, 0.02, points.astype(np.float32), forwards)
    assert found is not None
    assert np.linalg.norm(found.end - end) < 0.003
    assert np.array_equal(np.flatnonzero(found.points), len(points) - 9 + np.arange(9))


def test_an_accurate_estimate_of_the_lever_is_kept() -> None:
    points, end, forwards = toaster(0.3)
    near = end + np.array([0.0, 0.0, 0.01])
    found = lever_near(near, 0.02, points.astype(np.float32), forwards)
    assert found is not None
    assert np.array_equal(found.end, near)
    assert found.points.sum() == 9


def test_no_lever_is_measured_far_from_the_estimate_or_on_a_plain_side() -> None:
    points, end, forwards = toaster(0.3)
    assert lever_near(end, 0.005, points[:-9].astype(np.float32), forwards) is None  # Only the knob is there.
    assert lever_near(end, 0.02, points[:-18].astype(np.float32), forwards) is None
    assert lever_near(end - [0.0, 0.0, 0.04], 0.005, points.astype(np.float32), forwards) is None


def test_a_lever_is_pressed_beyond_its_estimated_range() -> None:
    """The range of real levers is longer than the range of generated ones."""
    look = look_at("toaster_press", 0.2)
    found = truth(look, "toaster_press")
    joint = scene_object("toaster", found, look.cloud.xyz).joint
    assert joint is not None
    assert joint.upper - found.joint.upper >= 0.05
