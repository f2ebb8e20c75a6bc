"""Conventions of rotations: fixed axes in URDF, (w, x, y, z), right-handed about the vertical."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from gensim2.objects.library.prepare import rpy_from_matrix
from gensim2.objects.shapes import rotation
from gensim2.objects.types import Placement


def about(axis: int, angle: float) -> np.ndarray:
    """Return the rotation (3, 3) about x, y or z, written out."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return R


@pytest.mark.parametrize("pitch", [0.0, 0.4, -1.2, np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize(("roll", "yaw"), [(0.0, 0.0), (0.3, -0.7), (-2.5, 3.0)])
def test_roll_pitch_yaw_turn_about_fixed_axes(roll: float, pitch: float, yaw: float) -> None:
    R = about(2, yaw) @ about(1, pitch) @ about(0, roll)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        r, p, y = rpy_from_matrix(R)
    np.testing.assert_allclose(about(2, y) @ about(1, p) @ about(0, r), R, atol=1e-9)


def test_an_axis_may_have_any_length() -> None:
    for axis in range(3):
        np.testing.assert_allclose(rotation(5 * np.eye(3)[axis], 0.7), about(axis, 0.7), atol=1e-15)


def test_placement_has_w_first() -> None:
    placement = Placement(np.zeros(3), 2 * np.array([np.cos(0.3), 0.0, 0.0, np.sin(0.3)]))
    np.testing.assert_allclose(placement.rotation, about(2, 0.6), atol=1e-15)
