"""Rigid objects that the hand has not taken along, that lie on each other, or that cannot be grasped again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gensim2.perception.estimation.chain import SLACK, _Chain
from gensim2.perception.estimation.rigid import RigidEstimate
from gensim2.perception.estimation.rigid_tracking import RigidTracker
from gensim2.perception.estimation.scene import BEYOND, DEVIATIONS, scene_object
from gensim2.planning.strategies import CENTERED, KeypointStrategy, centered
from gensim2.robots import robot
from gensim2.rollout.record import Cause
from gensim2.tasks.criteria import NEAR
from gensim2.tasks.library import load_strategies, load_task
from gensim2.tasks.measurement import Measurement

from .test_estimation import look_at, truth
from .test_rigid import cloud_of, floor, lifted_by, nothing_articulated, on_table


def take_in(tracker: RigidTracker, *parts: np.ndarray) -> None:
    points = np.concatenate(parts)
    tracker.take_in(points, nothing_articulated(points))


@pytest.mark.parametrize("by", [(0.0, 0.0, 0.0), (0.023, 0.023, 0.0), (0.0, 0.12, 0.0)])
def test_a_grasped_object_that_the_hand_has_left_behind_is_found_on_the_table(by: tuple[float, float, float]) -> None:
    """The fingers have missed the cup, or have pushed it aside. The next cloud shows it, although they are closed."""
    true, tracker, lifted = lifted_by("cup", (0.0, 0.0, 0.12), floor(0.0) + np.array([0.5, 0.0, 0.0]))
    stays = true.moved(np.array(by))
    take_in(tracker, cloud_of(stays), floor(0.0) + np.array([0.5, 0.0, 0.0]))
    tracker.hold("cup", lifted.T_world_object)
    np.testing.assert_allclose(tracker.found["cup"].center, stays.center, atol=0.006)
    tracker.hold(None)
    take_in(tracker, cloud_of(stays), floor(0.0) + np.array([0.5, 0.0, 0.0]))
    np.testing.assert_allclose(tracker.found["cup"].center, stays.center, atol=0.006)
    assert not tracker.is_hidden("cup")


def test_an_object_in_the_hand_is_not_left_behind() -> None:
    _, tracker, lifted = lifted_by("cup", (0.0, 0.0, 0.12), floor(0.0) + np.array([0.5, 0.0, 0.0]))
    take_in(tracker, cloud_of(lifted), floor(0.0) + np.array([0.5, 0.0, 0.0]))
    tracker.hold("cup", lifted.T_world_object)
    np.testing.assert_allclose(tracker.found["cup"].center, lifted.center, atol=1e-9)


def test_a_lost_object_is_found_in_the_cloud_after_the_next_one() -> None:
    """A cloud shows the cup while it counts as held. The points stay new until the cup is found."""
    true, tracker, _ = lifted_by("cup", (0.1, 0.0, 0.02), floor(0.0) + np.array([0.5, 0.0, 0.0]))
    stays = true.moved(np.array([0.12, 0.1, 0.0]))
    half = cloud_of(stays)
    take_in(tracker, half[half[:, 0] > stays.center[0] + 0.02], floor(0.0) + np.array([0.5, 0.0, 0.0]))
    tracker.hold(None)
    take_in(tracker, cloud_of(stays), floor(0.0) + np.array([0.5, 0.0, 0.0]))
    np.testing.assert_allclose(tracker.found["cup"].center, stays.center, atol=0.008)


def test_a_plate_under_a_drill_stays_where_it_is() -> None:
    plate, drill = on_table("plate", 0.0, 0.0), on_table("power_drill", 0.4, 0.0)
    tracker = RigidTracker({"plate": plate.shape, "drill": drill.shape})
    take_in(tracker, cloud_of(plate, 600), cloud_of(drill))
    laid = drill.moved(np.array([-0.4, 0.0, plate.bounds[1, 2] - 0.004]))
    tracker.hold("drill", laid.T_world_object)
    tracker.hold(None)
    under = cloud_of(plate, 600)
    under = under[np.abs(under[:, 1]) > 0.04]
    for _ in range(3):
        take_in(tracker, under, cloud_of(laid))
        np.testing.assert_allclose(tracker.found["plate"].center, plate.center, atol=0.004)
        np.testing.assert_allclose(tracker.found["drill"].center, laid.center, atol=0.012)


def test_a_released_block_keeps_its_known_orientation() -> None:
    """Both ends of the block look alike, but its keypoints are at one end."""
    true, tracker, lifted = lifted_by("wood_block", (0.4, 0.0, 0.1), floor(0.0) + np.array([0.8, 0.0, 0.0]))
    T = lifted.T_world_object.copy()
    T[:3, :3] = Rotation.from_euler("y", 90, degrees=True).as_matrix() @ T[:3, :3]
    lying = true.at(T)
    lying = lying.moved(np.array([0.0, 0.0, -lying.bounds[0, 2]]))
    tracker.hold("wood_block", lying.moved(np.array([0.0, 0.0, 0.03])).T_world_object)
    tracker.hold(None)
    take_in(tracker, cloud_of(lying), floor(0.0) + np.array([0.8, 0.0, 0.0]))
    for name, at in lying.keypoints.items():
        np.testing.assert_allclose(tracker.found["wood_block"].keypoints[name], at, atol=0.012)


def dropped(shown: RigidEstimate, background: np.ndarray, lowest: float) -> RigidEstimate:
    """Return the estimate of a ball that was released 30 cm above the table, if new points show ``shown``."""
    _, tracker, lifted = lifted_by("golf_ball", (0.3, 0.0, 0.3), background)
    tracker.hold(None)
    points = np.concatenate([cloud_of(shown), background])
    tracker.take_in(points, nothing_articulated(points), floors={"golf_ball": lowest})
    assert lifted.bounds[0, 2] > 0.25
    return tracker.found["golf_ball"]


@pytest.mark.parametrize("lowest", [0.0, 0.2])
def test_a_ball_in_a_drawer_is_not_sought_below_the_floor_of_the_drawer(lowest: float) -> None:
    """A knob below the drawer looks like the ball, but it touches the cabinet, so it does not stand apart."""
    background = floor(0.0) + np.array([0.8, 0.0, 0.0])
    knob = on_table("golf_ball", 0.34, 0.0).moved(np.array([0.0, 0.0, 0.08]))
    found = dropped(knob, background, lowest)
    assert (np.linalg.norm(found.center - knob.center) < 0.01) == (lowest == 0.0)


def test_a_few_new_points_do_not_show_a_large_object() -> None:
    _, tracker, lifted = lifted_by("mug", (0.3, 0.0, 0.2), floor(0.0) + np.array([0.8, 0.0, 0.0]))
    tracker.hold(None)
    near = lifted.center + np.array([0.05, 0.0, -0.02])
    few = near + np.stack(np.meshgrid(*[np.arange(3) * 0.008] * 2, [0.0]), -1).reshape(-1, 3)
    take_in(tracker, few, floor(0.0) + np.array([0.8, 0.0, 0.0]))
    assert tracker.is_hidden("mug")


@pytest.mark.parametrize("asset_class", ["box_rotate", "drawer"])
def test_uncertain_joints_are_moved_further(asset_class: str) -> None:
    look = look_at(asset_class, 0.5)
    found = truth(look)
    span = found.joint.upper - found.joint.lower
    for deviation in (0.01, 0.2):
        joint = replace(found.joint, openness_deviation=deviation)
        planned = scene_object("object", replace(found, joint=joint), look.cloud.xyz).joint
        assert planned is not None
        beyond = max(BEYOND[joint.type], DEVIATIONS * deviation * span)
        assert (planned.lower, planned.upper) == pytest.approx((joint.lower - beyond, joint.upper + beyond))


def test_strategies_without_a_point_are_not_changed() -> None:
    given = KeypointStrategy(load_strategies("StoreBlockInBox")["lay_on_floor_of_box"])
    rest = [each for each in given.config["constraint_list"] if each["type"] != "point2point_constraint"]
    free = KeypointStrategy({**given.config, "constraint_list": rest})
    assert centered(free) is free


def test_objects_in_a_shut_drawer_are_not_sought() -> None:
    """New points with the shape of the ball, such as a knob, lie where the drawer has carried the ball."""
    true, tracker, lifted = lifted_by("golf_ball", (0.3, 0.0, 0.1), floor(0.0) + np.array([0.8, 0.0, 0.0]))
    tracker.hold(None)
    take_in(tracker, cloud_of(lifted), floor(0.0) + np.array([0.8, 0.0, 0.0]))
    points = np.concatenate(
        [cloud_of(lifted.moved(np.array([0.04, 0.0, 0.0]))), floor(0.0) + np.array([0.8, 0.0, 0.0])]
    )
    for is_shut in (True, False):
        tracker.take_in(points, nothing_articulated(points), carried=["golf_ball"], shut=["golf_ball"] * is_shut)
        assert tracker.is_hidden("golf_ball") == is_shut
    assert true.shape is lifted.shape


def test_tolerances_of_points_shrink_to_the_middle() -> None:
    given = KeypointStrategy(load_strategies("StoreBlockInBox")["lay_on_floor_of_box"])
    before, after = given.config["constraint_list"], centered(given).config["constraint_list"]
    assert [each.get("tolerance") for each in after] == [
        CENTERED * each["tolerance"] if each["type"] == "point2point_constraint" else each.get("tolerance")
        for each in before
    ]


@pytest.mark.parametrize(("away", "is_left"), [(NEAR + 0.5 * SLACK, True), (NEAR + 1.5 * SLACK, False)])
def test_an_object_near_its_goal_that_cannot_be_grasped_again_is_left_there(away: float, is_left: bool) -> None:
    task = load_task("StoreBlockInBox")
    chain = _Chain(task, load_strategies(task.name), robot("panda"))
    chain.left, chain._grasped, chain._at, chain._trigger = set(), {"block"}, 1, Cause.GRASP_LOST.value
    measured = Measurement(
        openness={"box": 1.0},
        joint_speed={"box": 0.0},
        keypoints={"box": {"inside": np.zeros(3)}, "block": {"end": np.array([away, 0.0, 0.0])}},
        poses={"block": np.array([away, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])},
        speeds={"block": np.zeros(2)},
        gripper={},
        finger_opening=0.08,
        start_positions={"block": np.zeros(3)},
        bounds={},
        contents={"box": frozenset({"block"})},
    )
    for unplaced in (replace(measured, contents={"box": frozenset()}), replace(measured, contents={})):
        assert not chain._leaves_placed(unplaced)
    assert chain._leaves_placed(measured) == is_left
    assert chain.left == ({"block"} if is_left else set())
    assert chain.step.name == ("close" if is_left else "grasp")
    # An object that the hand has never held is not left behind.
    chain._grasped, chain._at = set(), 1
    assert not chain._leaves_placed(measured)
