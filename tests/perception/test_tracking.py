"""Displacements of a joint between two clouds, and the openness after the motions of an episode."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gensim2.perception.estimation import SceneEstimator
from gensim2.perception.estimation.estimator import MEASURED_OPENNESS, SceneEstimate
from gensim2.perception.estimation.goal import GoalTracker
from gensim2.perception.estimation.tracking import (
    LEAST_RANGE,
    LEAST_SHIFT,
    SHORT,
    UNCERTAIN,
    UNKNOWN,
    Track,
    displacement,
)
from gensim2.tasks.library import load_task

from .test_estimation import PANDA, look_at, truth


@pytest.mark.parametrize(("asset_class", "first", "last"), [("box_rotate", 0.3, 0.7), ("drawer", 0.8, 0.1)])
def test_the_displacement_of_a_joint_is_measured(asset_class: str, first: float, last: float) -> None:
    before, after = look_at(asset_class, first), look_at(asset_class, last)
    estimates = truth(before), truth(after)
    joint = estimates[0].joint
    span = joint.upper - joint.lower
    found = displacement(estimates[0], before.cloud.xyz, estimates[1], after.cloud.xyz)
    assert found.value == pytest.approx((last - first) * span, abs=0.06 * span)
    assert found.contradicts(0.0)
    assert not found.contradicts(found.value)
    assert displacement(estimates[0], before.cloud.xyz, estimates[0], before.cloud.xyz).value == 0.0
    # The estimated parts may be wrong. Then the points without a counterpart show the displacement.
    unknown = [replace(each, moving=np.zeros_like(each.moving)) for each in estimates]
    again = displacement(unknown[0], before.cloud.xyz, unknown[1], after.cloud.xyz)
    assert again.value == pytest.approx(found.value, abs=0.05 * span)
    assert displacement(unknown[0], before.cloud.xyz, unknown[0], before.cloud.xyz) is None


@pytest.mark.parametrize(("asset_class", "first", "last"), [("box_rotate", 0.3, 0.7), ("drawer", 0.8, 0.1)])
def test_the_displacement_of_a_button_is_not_measured(asset_class: str, first: float, last: float) -> None:
    before, after = truth(look_at(asset_class, first)), truth(look_at(asset_class, last))
    clouds = [look_at(asset_class, each).cloud.xyz for each in (first, last)]
    joint = before.joint
    short = replace(before, joint=replace(joint, upper=joint.lower + 0.9 * LEAST_RANGE[joint.type]))
    assert displacement(before, clouds[0], after, clouds[1])
    assert displacement(short, clouds[0], after, clouds[1]) is None


@pytest.mark.parametrize(("asset_class", "first", "last"), [("box_rotate", 0.3, 0.7), ("drawer", 0.8, 0.1)])
def test_the_keypoints_show_a_displacement_that_the_points_do_not_show(
    asset_class: str, first: float, last: float
) -> None:
    before, after = look_at(asset_class, first), look_at(asset_class, last)
    span = truth(before).joint.upper - truth(before).joint.lower
    # The second cloud does not show the new place of the moving part, for example because the part is too small.
    estimates = [replace(truth(look), points=np.flatnonzero(~look.moving)) for look in (before, after)]
    estimates = [replace(each, moving=np.zeros(len(each.points), dtype=bool)) for each in estimates]
    found = displacement(estimates[0], before.cloud.xyz, estimates[1], after.cloud.xyz)
    assert found.value == pytest.approx((last - first) * span, abs=0.01 * span)
    # A small displacement of the keypoints can be an error of the estimates.
    axis, by = estimates[0].joint.axis, 0.5 * LEAST_SHIFT["prismatic"]
    if estimates[0].joint.type == "prismatic":
        keypoints = {name: at + by * axis for name, at in estimates[0].keypoints.items()}
        near = replace(estimates[0], keypoints=keypoints)
        assert displacement(estimates[0], before.cloud.xyz, near, before.cloud.xyz) is None


def test_after_a_miss_the_handle_is_sought_at_the_nearest_points() -> None:
    look, none = look_at("drawer", 0.4), np.zeros(0, dtype=np.int64)
    found = truth(look).at(0.4, 0.1)
    [head, *_] = found.moving_keypoints
    off = found.keypoints[head] + 0.03 * found.joint.axis
    wrong = replace(found, keypoints={**found.keypoints, head: off})
    first = Track(wrong, look.cloud.xyz, none)
    second = first.after(wrong, look.cloud.xyz, none, 1)
    assert second.misses == 1
    assert np.linalg.norm(second.to_plan.keypoints[head] - found.keypoints[head]) < 0.02
    # The next attempt uses the estimated keypoint again, and nothing that was seen makes the openness more certain.
    third = second.after(wrong, look.cloud.xyz, none, 1)
    assert third.misses == 2
    assert np.array_equal(third.to_plan.keypoints[head], off)
    assert third.found.joint.openness_deviation == pytest.approx(0.1)
    # The same holds for motions that should not move the joint, such as the grasp of another object.
    without_goal = first.after(wrong, look.cloud.xyz, none, 0)
    assert without_goal.misses == 0
    assert without_goal.found.joint.openness_deviation == pytest.approx(0.1)
    # A motion that moves the joint ends the series.
    moved = look_at("drawer", 0.9)
    assert third.after(truth(moved), moved.cloud.xyz, none, 1).misses == 0


def test_the_openness_after_a_motion_follows_from_the_displacement() -> None:
    looks = [look_at("box_rotate", openness) for openness in (0.6, 0.1, 0.1)]
    none = np.zeros(0, dtype=np.int64)
    first, *rest = (truth(look) for look in looks)
    # The network is sure about the first cloud and has no idea of the openness in the other clouds.
    track = Track(first.at(0.6, 0.02), looks[0].cloud.xyz, none)
    second = track.after(rest[0].at(0.5, 0.4), looks[1].cloud.xyz, none, -1)
    assert second.found.joint.openness == pytest.approx(0.1, abs=0.06)
    assert second.found.joint.openness_deviation < 0.15
    turned = second.found.T_base_object[:3, :3] @ rest[0].T_base_object[:3, :3].T
    assert np.degrees(Rotation.from_matrix(turned).magnitude()) < 8
    # A lid that has moved and does not move any more is at the end of its range.
    third = second.after(rest[1].at(0.5, 0.4), looks[2].cloud.xyz, none, -1, is_pressed=True)
    assert third.found.joint.openness == 0.0
    assert second.after(rest[1].at(0.5, 0.4), looks[2].cloud.xyz, none, 0).found.joint.openness > 0.0
    # A lid that the motion has moved back does not stand still at the end of its range.
    back = second.after(first.at(0.6, 0.05), looks[0].cloud.xyz, none, -1)
    assert back.found.joint.openness == pytest.approx(0.6, abs=0.06)
    # Before the first displacement, a standstill means that the hand has missed.
    missed = track.after(first.at(0.6, 0.02), looks[0].cloud.xyz, none, -1)
    assert missed.found.joint.openness == pytest.approx(0.6, abs=0.01)


@pytest.mark.parametrize(("asset_class", "first", "last"), [("box_rotate", 0.6, 0.02), ("drawer", 0.8, 0.02)])
def test_an_openness_that_the_clouds_refute_is_discarded(asset_class: str, first: float, last: float) -> None:
    looks, none = [look_at(asset_class, openness) for openness in (first, last)], np.zeros(0, dtype=np.int64)
    before, after = (truth(look) for look in looks)
    track = Track(before.at(first, 0.05), looks[0].cloud.xyz, none)
    # The network sees no displacement, and finds neither the moving part nor a keypoint.
    lost = {name: at + 0.2 for name, at in after.keypoints.items()}
    wrong = replace(after, keypoints=lost, moving=np.zeros_like(after.moving)).at(first, 0.2)
    found = track.after(wrong, looks[1].cloud.xyz, none, -1).found
    assert found.joint.openness == pytest.approx(last, abs=0.06)
    for name, at in found.keypoints.items():
        assert np.linalg.norm(at - after.keypoints[name]) < 0.02
    # New points near the displaced old part count as points of the moving part.
    assert (found.moving & after.moving).sum() > 0.9 * after.moving.sum()


def test_a_joint_that_resists_after_it_has_moved_is_at_the_end_of_its_range() -> None:
    looks, none = [look_at("drawer", openness) for openness in (0.8, 0.0)], np.zeros(0, dtype=np.int64)
    before, after = (truth(look) for look in looks)
    track, unsure = Track(before.at(0.9, 0.2), looks[0].cloud.xyz, none), after.at(0.15, 0.2)
    assert track.after(unsure, looks[1].cloud.xyz, none, -1).found.joint.openness > 0.05
    assert track.after(unsure, looks[1].cloud.xyz, none, -1, is_pressed=True).found.joint.openness == 0.0
    # Far from the end, a single resistance may come from a push in a wrong direction; a second one ends the range.
    part = look_at("drawer", 0.35)
    halfway = truth(part)
    pressed = track.after(halfway, part.cloud.xyz, none, -1, is_pressed=True)
    assert pressed.found.joint.openness > 0.2
    assert pressed.after(halfway, part.cloud.xyz, none, -1, is_pressed=True).found.joint.openness == 0.0
    assert pressed.after(halfway, part.cloud.xyz, none, -1, is_pressed=False).found.joint.openness > 0.2
    # An openness that the new cloud does not show is no evidence against the end.
    vague = Track(before.at(0.9, 0.4), looks[0].cloud.xyz, none)
    ended = vague.after(after.at(0.5, 1.5 * UNKNOWN), looks[1].cloud.xyz, none, -1, is_pressed=True).found.joint
    assert ended.openness == 0.0
    # Resistance says nothing about the joint if nothing has moved.
    assert track.after(before, looks[0].cloud.xyz, none, -1, is_pressed=True).found.joint.openness > 0.7


def test_resistance_does_not_count_after_the_joint_has_moved_back(trained: Path) -> None:
    goal = GoalTracker(SceneEstimator.load(trained, PANDA), {"box": "box_rotate"}, load_task("CloseBox").success)
    box = goal.articulated["box"]
    for number, (openness, most) in enumerate(((0.6, 0.7), (0.02, 0.0), (0.2, 0.3))):
        look = look_at("box_rotate", openness)
        seen = SceneEstimate((truth(look).at(openness, 0.08),), np.zeros(0, dtype=np.int64))
        box.take_in(look.cloud.xyz, seen, goal.rigid, is_pressed=number > 0)
        assert box.track is not None
        assert box.track.found.joint.openness <= most
        if number == 0:
            goal.begin_motion()
    assert box.track.found.joint.openness > 0.1


def test_a_part_that_no_camera_sees_any_more_is_at_the_end_of_its_range() -> None:
    """The handle of a bucket that lies on its rim is often hidden, and the network then guesses its place."""
    look, none = look_at("box_rotate", 0.5), np.zeros(0, dtype=np.int64)
    before = truth(look).at(0.5, 0.1)
    rest = look.cloud.xyz[~look.moving]
    guess = replace(before, points=np.arange(len(rest)), moving=np.zeros(len(rest), dtype=bool)).at(0.8, 0.1)
    track = Track(before, look.cloud.xyz, none)
    for goal, openness in ((-1, 0.0), (1, 1.0)):
        gone = track.after(guess, rest, none, goal)
        assert gone.found.joint.openness == openness
        assert goal * gone.moved > 0.0
        # A cloud after a second motion that does not show the part changes nothing.
        again = track.after(before, look.cloud.xyz, none, goal).after(guess, rest, none, goal)
        assert again.found.joint.openness == openness
        few = rest[: len(rest) // 2]
        short = replace(guess, points=np.arange(len(few)), moving=np.zeros(len(few), dtype=bool))
        assert again.after(short, few, none, goal).found.points.max() < len(few)
    assert track.after(guess, rest, none, 0).found.joint.openness not in (0.0, 1.0)
    assert track.after(before, look.cloud.xyz, none, -1).found.joint.openness == pytest.approx(0.5, abs=0.01)


def test_an_object_that_moves_as_a_whole_is_at_its_end_when_it_moves_no_further() -> None:
    """The cloud of a bucket does not show how high the bucket can be lifted."""
    looks, none = [look_at("bucket_lift", openness) for openness in (0.0, 0.3)], np.zeros(0, dtype=np.int64)
    low, high = (truth(look, "bucket_lift") for look in looks)
    assert low.moving.all()
    lifted = Track(low.at(0.0, 0.1), looks[0].cloud.xyz, none).after(high.at(0.1, 0.1), looks[1].cloud.xyz, none, 1)
    assert 0.1 < lifted.found.joint.openness < 0.4

    def again(track: Track, is_pressed: bool, moving: bool = True) -> Track:
        seen = high if moving else replace(high, moving=np.arange(len(high.moving)) > 2)
        return track.after(seen.at(0.1, 0.1), looks[1].cloud.xyz, none, 1, is_pressed=is_pressed)

    assert again(lifted, True).found.joint.openness == 1.0
    # A fixed part shows the range of the joint.
    assert again(lifted, True, moving=False).found.joint.openness < 0.5
    # Without resistance, the hand may have missed the object.
    assert again(lifted, False).found.joint.openness < 0.5
    assert again(again(lifted, False), False).found.joint.openness == 1.0


@pytest.mark.parametrize(("openness", "deviation", "is_end"), [(0.7, 0.2, True), (0.7, 0.05, False), (0.3, 0.2, False)])
def test_a_part_that_resists_twice_is_at_the_end_if_the_estimate_allows_this(
    openness: float, deviation: float, *, is_end: bool
) -> None:
    """The displacement of a toaster's lever is often not seen."""
    look, none = look_at("drawer", openness), np.zeros(0, dtype=np.int64)
    found = truth(look).at(openness, deviation)
    once = Track(found, look.cloud.xyz, none).after(found, look.cloud.xyz, none, 1, is_pressed=True)
    assert once.found.joint.openness == pytest.approx(openness)
    twice = once.after(found, look.cloud.xyz, none, 1, is_pressed=True)
    assert (twice.found.joint.openness == 1.0) == is_end


def test_a_joint_that_moved_until_it_resisted_is_at_its_end_although_the_network_is_sure_that_it_is_not() -> None:
    """The network underestimates the range of some real boxes by a fifth."""
    looks, none = [look_at("box_rotate", openness) for openness in (0.4, 0.8)], np.zeros(0, dtype=np.int64)
    before, after = (truth(look) for look in looks)
    track = Track(before, looks[0].cloud.xyz, none)
    sure = after.at(0.82, 0.01)
    assert track.after(sure, looks[1].cloud.xyz, none, 1, is_pressed=True).found.joint.openness == 1.0
    assert track.after(sure, looks[1].cloud.xyz, none, 1, is_pressed=False).found.joint.openness < 0.9
    far = after.at(0.7, 0.01)
    assert track.after(far, looks[1].cloud.xyz, none, 1, is_pressed=True).found.joint.openness < 0.9


@pytest.mark.parametrize(("first", "is_end"), [(0.35, True), (0.1, False)])
def test_an_object_that_moves_as_a_whole_until_it_resists_is_at_its_end_if_it_moved_far(
    first: float, *, is_end: bool
) -> None:
    """The cloud of a toaster does not show how far the toaster can be pushed."""
    looks, none = [look_at("bucket_lift", openness) for openness in (0.0, 0.3)], np.zeros(0, dtype=np.int64)
    low, high = (truth(look, "bucket_lift") for look in looks)
    track = Track(low.at(first, 0.1), looks[0].cloud.xyz, none)
    unsure = high.at(0.1, 1.5 * UNKNOWN)
    pushed = track.after(unsure, looks[1].cloud.xyz, none, 1, is_pressed=True)
    assert (pushed.found.joint.openness == 1.0) == is_end
    # The hand may slip off the object, so one standstill far from the end is not enough.
    slipped = track.after(unsure, looks[1].cloud.xyz, none, 1).after(
        unsure, looks[1].cloud.xyz, none, 1, is_pressed=True
    )
    assert (slipped.found.joint.openness == 1.0) == is_end


@pytest.mark.parametrize(("deviation", "is_end"), [(0.2, True), (0.1, False)])
def test_a_part_that_stands_still_twice_is_at_its_end_if_its_openness_is_uncertain(
    deviation: float, *, is_end: bool
) -> None:
    """The clouds hardly show the lever of a toaster."""
    looks, none = [look_at("drawer", openness) for openness in (0.2, 0.6)], np.zeros(0, dtype=np.int64)
    before, after = (truth(look).at(openness, deviation) for look, openness in zip(looks, (0.2, 0.6), strict=True))
    track = Track(before, looks[0].cloud.xyz, none)
    for _ in range(3):
        track = track.after(after, looks[1].cloud.xyz, none, 1, is_pressed=False)
    assert (track.found.joint.openness == 1.0) == is_end


@pytest.mark.parametrize(
    ("asset_class", "by", "stays"), [("drawer", 0.0, True), ("box_rotate", 0.0, True), ("drawer", 0.02, False)]
)
def test_keypoints_stay_if_a_cloud_shows_no_more_of_an_object(asset_class: str, by: float, stays: bool) -> None:
    """The arm hides a quarter of the object, so the new estimate is worse. A pushed object has other points."""
    look, none = look_at(asset_class, 0.9), np.zeros(0, dtype=np.int64)
    true = truth(look)
    shift = np.array([by, by, 0.0], dtype=np.float32)
    kept = np.sort(np.argsort(look.cloud.xyz[true.points, 1])[len(true.points) // 4 :])
    worse = {name: at + np.array([0.03, 0.0, 0.0]) for name, at in true.keypoints.items()}
    partly = replace(true, points=true.points[kept], moving=true.moving[kept], keypoints=worse)
    track = Track(true, look.cloud.xyz, none).after(partly, look.cloud.xyz + shift, none, 0, is_expected=False)
    expected = true.keypoints if stays else worse
    for name, at in track.found.keypoints.items():
        np.testing.assert_allclose(at, expected[name], atol=1e-9)


def test_a_bail_that_is_not_measured_any_more_lies_on_the_rim_if_its_middle_has_moved() -> None:
    looks, none = [look_at("bucket_swing", openness) for openness in (0.3, 0.0)], np.zeros(0, dtype=np.int64)
    raised, lowered = (replace(truth(look, "bucket_swing"), is_bail=True) for look in looks)
    first = Track(raised.at(0.3, MEASURED_OPENNESS), looks[0].cloud.xyz, none)
    unsure = replace(lowered, keypoints=raised.keypoints).at(0.4, UNKNOWN + 0.01)
    second = first.after(unsure, looks[1].cloud.xyz, none, -1)
    assert second.found.joint.openness == 0.0
    assert second.moved < 0.0
    # Without a measurement, a bail that is still where it was has not moved.
    still = raised.at(0.4, UNKNOWN + 0.01)
    second = first.after(still, looks[0].cloud.xyz, none, -1)
    assert second.found.joint.openness == pytest.approx(0.3, abs=0.02)
    assert second.misses == 1


def test_two_measured_bails_need_no_comparison_of_clouds() -> None:
    looks, none = [look_at("bucket_swing", openness) for openness in (0.3, 0.7)], np.zeros(0, dtype=np.int64)
    first, second = (replace(truth(look, "bucket_swing"), is_bail=True) for look in looks)
    span = first.joint.upper - first.joint.lower
    track = Track(first.at(0.3, MEASURED_OPENNESS), looks[0].cloud.xyz, none)
    # The cloud of the second look is the first one, so a comparison would show no displacement.
    found = track.displacement(second.at(0.7, MEASURED_OPENNESS), looks[0].cloud.xyz, 1)
    assert found is not None
    assert found.value == pytest.approx(0.4 * span)
    found = track.displacement(first.at(0.7, MEASURED_OPENNESS + 0.01), looks[0].cloud.xyz, 1)
    assert found is None or found.value == 0.0


@pytest.mark.parametrize("is_certain", [False, True])
def test_a_sliding_part_may_move_farther_than_an_uncertain_range(is_certain: bool) -> None:
    """The range of a short part, such as the lever of a toaster, is often estimated too small."""
    before, after = look_at("drawer", 0.3), look_at("drawer", 0.6)
    first, second = truth(before), truth(after)
    way = 0.3 * (first.joint.upper - first.joint.lower)
    assert 0.03 < way < SHORT
    short = replace(first, joint=replace(first.joint, upper=first.joint.lower + LEAST_RANGE["prismatic"]))
    short = short.at(0.0, 0.9 * UNCERTAIN if is_certain else 0.2)
    found = displacement(short, before.cloud.xyz, second, after.cloud.xyz, goal=1)
    assert found is not None
    assert (found.value == pytest.approx(way, abs=0.01)) != is_certain
