"""Released objects that have fallen over, or that the cloud does not show."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gensim2.perception.estimation.rigid import RigidEstimate
from gensim2.perception.estimation.rigid_tracking import FARTHEST_DROP

from .test_left_behind import take_in
from .test_rigid import cloud_of, floor, lifted_by

BACKGROUND = floor(0.0) + np.array([0.8, 0.0, 0.0])


def turned(thing: RigidEstimate, axis: str, angle: float) -> RigidEstimate:
    """Return an object that is turned about a world axis by an angle (rad)."""
    T = thing.T_world_object.copy()
    T[:3, :3] = Rotation.from_euler(axis, angle).as_matrix() @ T[:3, :3]
    return thing.at(T)


@pytest.mark.parametrize("angles", [(0.9, 0.6), (1.5, 0.3), (0.7, -1.2)])
def test_a_bottle_that_has_fallen_over_in_a_drawer_is_found(angles: tuple[float, float]) -> None:
    """The points of the slanting bottle have another bounding box than the upright bottle."""
    _, tracker, lifted = lifted_by("bleach_cleanser", (0.3, 0.0, 0.2), BACKGROUND)
    tracker.hold(None)
    lies = turned(turned(lifted, "y", angles[0]), "z", angles[1]).moved(np.array([0.03, 0.02, 0.0]))
    lies = lies.moved(np.array([0.0, 0.0, 0.1 - lies.bounds[0, 2]]))
    take_in(tracker, cloud_of(lies), BACKGROUND)
    assert not tracker.is_hidden("bleach_cleanser")
    np.testing.assert_allclose(tracker.found["bleach_cleanser"].center, lies.center, atol=0.012)


@pytest.mark.parametrize(("name", "is_found"), [("cracker_box", True), ("golf_ball", False), ("cup", False)])
def test_a_long_object_may_fall_farther_than_a_ball_or_a_cup(name: str, is_found: bool) -> None:
    _, tracker, lifted = lifted_by(name, (0.3, 0.0, 0.1), BACKGROUND)
    tracker.hold(None)
    fallen = lifted.moved(np.array([FARTHEST_DROP + 0.015, 0.0, -0.03]))
    take_in(tracker, cloud_of(fallen), BACKGROUND)
    assert tracker.is_hidden(name) is not is_found


@pytest.mark.parametrize("angle", [1.2, -1.2, 1.57, -1.57])
def test_the_upper_end_of_a_box_that_has_tipped_over_is_known(angle: float) -> None:
    """The points of the lying box fit both directions. The box has tipped over an edge of its underside."""
    _, tracker, lifted = lifted_by("cracker_box", (0.3, 0.0, 0.1), BACKGROUND)
    tracker.hold(None)
    low, high = lifted.bounds
    edge = np.array([high[0] if angle > 0.0 else low[0], 0.0, low[2]])
    tipped = turned(lifted, "y", angle)
    turn = Rotation.from_euler("y", angle).as_matrix()
    lies = tipped.at(
        np.vstack([np.c_[tipped.T_world_object[:3, :3], edge + turn @ (lifted.center - edge)], [0, 0, 0, 1]])
    )
    lies = lies.moved(np.array([0.01, 0.01, 0.06 - lies.bounds[0, 2]]))
    take_in(tracker, cloud_of(lies), BACKGROUND)
    found = tracker.found["cracker_box"].keypoints
    for name, at in lies.keypoints.items():
        np.testing.assert_allclose(found[name], at, atol=0.012)


def test_an_object_does_not_lie_on_its_own_points() -> None:
    """The new points fit no pose of the mug, so it counts as hidden. It has fallen to the table."""
    _, tracker, lifted = lifted_by("mug", (0.3, 0.0, 0.2), BACKGROUND)
    tracker.hold(None)
    few = lifted.center + np.array([0.0, 0.0, -0.1]) + np.stack(np.meshgrid(*[np.arange(3) * 0.008] * 2, 0.0), -1)
    take_in(tracker, few.reshape(-1, 3), BACKGROUND)
    assert tracker.is_hidden("mug")
    assert tracker.found["mug"].bounds[0, 2] == pytest.approx(0.0, abs=0.003)
