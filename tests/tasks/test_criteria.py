"""Success criteria beyond the paper's, on hand-made measurements."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from gensim2.tasks.criteria import (
    ArticulatedBetween,
    ArticulatedClosed,
    ArticulatedOpen,
    Criterion,
    DistanceArticulatedRigid,
    DistanceGripperArticulated,
    DistanceGripperRigid,
    RigidLifted,
    RigidMoved,
    RigidOnRigid,
)
from gensim2.tasks.measurement import Measurement

CRITERIA = (
    ArticulatedOpen(object="door"),
    ArticulatedClosed(object="door"),
    ArticulatedBetween(object="door"),
    RigidLifted(rigid="ball"),
    RigidMoved(rigid="ball", direction="left"),
    RigidOnRigid(rigid="ball", support="plate"),
    DistanceArticulatedRigid(articulated="door", rigid="ball"),
    DistanceGripperRigid(rigid="ball"),
    DistanceGripperArticulated(articulated="door"),
)


def measured(
    at: tuple[float, float, float] = (0.0, 0.0, 0.02), openness: float = 0.5, tool: float = 0.0
) -> Measurement:
    """Return a ball that stood at the origin, 2 cm high, and a plate at (0.3, 0, 0.01)."""
    poses = {"ball": np.array([*at, 1.0, 0, 0, 0]), "plate": np.array([0.3, 0.0, 0.01, 1.0, 0, 0, 0])}
    return Measurement(
        openness={"door": openness},
        joint_speed={"door": 0.0},
        keypoints={"ball": {"middle": np.array(at)}, "door": {"handle": np.array([0.1, 0.1, 0.3])}},
        poses=poses,
        speeds={},
        gripper={"tool_head": np.array([tool, 0.0, 0.2])},
        finger_opening=0.0,
        start_positions={"ball": np.array([0.0, 0.0, 0.02]), "plate": np.array([0.3, 0.0, 0.01])},
    )


@pytest.mark.parametrize(("openness", "ajar"), [(0.1, False), (0.5, True), (0.9, False), (float("nan"), False)])
def test_ajar_is_neither_open_nor_closed(openness: float, ajar: bool) -> None:
    assert ArticulatedBetween(object="door").holds(measured(openness=openness)) is ajar


def test_a_range_that_is_none_is_refused() -> None:
    with pytest.raises(ValidationError, match="low must be less than high"):
        ArticulatedBetween(object="door", low=0.7, high=0.3)


def test_what_is_lifted_is_higher_than_where_it_stood() -> None:
    lifted = RigidLifted(rigid="ball", height=0.06)
    assert lifted.holds(measured((0.1, 0.0, 0.09)))
    assert not lifted.holds(measured((0.0, 0.0, 0.07)))


@pytest.mark.parametrize(
    ("direction", "at"),
    [("away", (0.1, 0, 0.02)), ("closer", (-0.1, 0, 0.02)), ("left", (0, 0.1, 0.02)), ("right", (0, -0.1, 0.02))],
)
def test_what_is_moved_went_that_way_and_hardly_another(direction: str, at: tuple[float, float, float]) -> None:
    moved = RigidMoved(rigid="ball", direction=direction, distance=0.08)  # type: ignore[arg-type]
    assert moved.holds(measured(at))
    assert not moved.holds(measured((-at[0], -at[1], at[2])))
    assert not moved.holds(measured((at[0] + at[1], at[1] + at[0], at[2])))  # inclined


def test_what_is_on_a_plate_is_above_it_and_low() -> None:
    on = RigidOnRigid(rigid="ball", support="plate", threshold=0.08, height=0.05)
    assert on.holds(measured((0.32, 0.03, 0.04)))
    assert not on.holds(measured((0.32, 0.03, 0.2))), "held above it"
    assert not on.holds(measured((0.2, 0.0, 0.02))), "beside it"


def box(x: float, y: float, z: float, half: float = 0.02) -> np.ndarray:
    """Return the corners of a cube with the centre (x, y, z)."""
    middle = np.array([x, y, z])
    return np.stack([middle - half, middle + half])


@pytest.mark.parametrize(
    ("ball", "plate", "on"),
    [
        ((0.3, 0.0, 0.04), (0.3, 0.0, 0.01), True),  # the ball's lowest point is level with the top of the plate
        ((0.3, 0.0, 0.06), (0.3, 0.0, 0.01), False),  # 2 cm above the plate
        ((0.3, 0.0, 0.02), (0.3, 0.0, 0.05), False),  # the plate was put on the ball
    ],
)
def test_an_object_on_a_plate_lies_neither_above_nor_below_it(
    ball: tuple[float, float, float], plate: tuple[float, float, float], on: bool
) -> None:
    criterion = RigidOnRigid(rigid="ball", support="plate", threshold=0.08, height=0.09)
    found = measured(ball)
    poses = {**found.poses, "plate": np.array([*plate, 1.0, 0, 0, 0])}
    bounds = {"ball": box(*ball), "plate": box(*plate, half=0.01)}
    assert criterion.holds(replace(found, poses=poses, bounds=bounds)) is on
    assert (criterion.progress(replace(found, poses=poses, bounds=bounds)) == 1.0) is on


def test_an_object_above_a_container_is_inside_only_for_the_paper() -> None:
    criterion = DistanceArticulatedRigid(articulated="door", rigid="ball")
    above = replace(measured((0.1, 0.1, 0.5)), bounds={"ball": box(0.1, 0.1, 0.5)})
    for contents, inside in (({"door": frozenset({"ball"})}, True), ({"door": frozenset()}, False)):
        assert criterion.holds(replace(above, contents=contents)) is inside
        assert (criterion.progress(replace(above, contents=contents)) == 1.0) is inside
        assert criterion.holds_in_paper(replace(above, contents=contents))


@pytest.mark.parametrize(("height", "under"), [(0.1, True), (0.5, False)])
def test_an_object_at_a_faucet_is_not_above_its_spout(height: float, under: bool) -> None:
    there = replace(measured((0.1, 0.1, height)), bounds={"ball": box(0.1, 0.1, height)})
    assert DistanceArticulatedRigid(articulated="door", rigid="ball").holds(there) is under


@pytest.mark.parametrize(("height", "near"), [(0.14, True), (0.02, False)])
def test_a_hand_high_above_an_object_is_not_at_it(height: float, near: bool) -> None:
    there = replace(measured((0.0, 0.0, height)), bounds={"ball": box(0.0, 0.0, height)})  # the hand is at 0.2
    assert DistanceGripperRigid(rigid="ball").holds(there) is near
    assert DistanceGripperRigid(rigid="ball").holds_in_paper(there)
    assert (DistanceGripperRigid(rigid="ball").progress(there) == 1.0) is near


@pytest.mark.parametrize("criterion", CRITERIA, ids=lambda criterion: criterion.type)
@given(
    at=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    openness=st.floats(-0.1, 1.1) | st.just(math.nan),
    tool=st.floats(-0.3, 0.3),
)
def test_progress_is_a_share_and_whole_where_it_holds(
    criterion: Criterion, at: tuple[float, float, float], openness: float, tool: float
) -> None:
    there = measured(at, openness, tool)
    assert 0.0 <= criterion.progress(there) <= 1.0
    if criterion.holds(there):
        assert criterion.progress(there) == 1.0


def test_progress_rises_towards_where_it_holds() -> None:
    opened = [ArticulatedOpen(object="door").progress(measured(openness=share)) for share in (0.0, 0.2, 0.6, 0.79)]
    assert opened == sorted(opened)
    assert opened[0] == 0.0 < opened[-1] < 1.0
    lifted = [RigidLifted(rigid="ball").progress(measured((0.0, 0.0, z))) for z in (0.0, 0.02, 0.04, 0.06)]
    assert lifted == pytest.approx([0.0, 0.0, 0.4, 0.8])
    away = [DistanceGripperRigid(rigid="ball").progress(measured(tool=x)) for x in (0.5, 0.3, 0.1, 0.06)]
    assert away == sorted(away)
    assert away[-1] < 1.0
