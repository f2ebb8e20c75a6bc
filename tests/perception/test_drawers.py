"""Drawers and cabinets in point clouds: keypoints, floor, displacements, and the objects in a drawer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from gensim2.perception.estimation import SceneEstimator
from gensim2.perception.estimation.door import FORWARDS, IN_CABINET, in_box, in_cabinet, on_door
from gensim2.perception.estimation.estimator import in_open_drawer
from gensim2.perception.estimation.goal import GoalTracker
from gensim2.perception.estimation.rigid import RigidEstimate, shape_of
from gensim2.perception.estimation.rigid_tracking import RigidTracker
from gensim2.perception.estimation.scene import scene_object
from gensim2.perception.estimation.tracking import Track, displacement
from gensim2.robots import robot
from gensim2.tasks.criteria import DistanceArticulatedRigid

from .test_estimation import look_at, truth
from .test_rigid import cloud_of, floor, lifted_by, nothing_articulated, on_table

Array = npt.NDArray[np.float64]
PANDA = robot("panda")
NONE = np.zeros(0, dtype=np.int64)
HEAD, INSIDE = "articulated_object_head", "articulated_object_inside"
PUT = DistanceArticulatedRigid(articulated="drawer", rigid="apple")


def tracked(openness: float = 0.8) -> GoalTracker:
    """Return a tracker of an apple and of a drawer that is estimated without errors."""
    look = look_at("drawer", openness)
    goal = GoalTracker(SceneEstimator.load(), {"drawer": "drawer", "apple": "apple"}, (PUT,))
    goal.looks.append(goal.estimator.estimate(look.cloud.xyz, "drawer"))
    goal.articulated["drawer"].track = Track(truth(look), look.cloud.xyz, NONE)
    return goal


def apple_at(position: Array) -> RigidEstimate:
    """Return an apple with its centre at a position (3,) in the world, m."""
    shape = shape_of("apple")
    assert shape is not None
    found = RigidEstimate(shape, np.ones(3), np.eye(4), 0.0, 0.002)
    return found.moved(position - found.center)


@pytest.mark.parametrize(("openness", "is_moved"), [(0.8, True), (0.0, False)])
def test_the_keypoint_in_an_open_drawer_follows_from_its_sides_and_its_front(openness: float, is_moved: bool) -> None:
    look = look_at("drawer", openness)
    found = truth(look)
    across = np.array([-found.joint.axis[1], found.joint.axis[0], 0.0])
    by = 0.06 * across - 0.05 * found.joint.axis
    wrong = {HEAD: found.keypoints[HEAD] + 0.02 * across, INSIDE: found.keypoints[INSIDE] + by}
    again = in_open_drawer(wrong, look.cloud.xyz[found.points[found.moving]], found.joint)
    off = again[INSIDE] - found.keypoints[INSIDE]
    assert off @ across == pytest.approx(0.0 if is_moved else 0.06, abs=0.008)
    assert off[2] == pytest.approx(0.0, abs=0.015)
    assert off @ found.joint.axis == pytest.approx(0.0 if is_moved else -0.05, abs=0.02)
    # The handle need not be in the middle, but it is between the sides.
    assert np.array_equal(again[HEAD], wrong[HEAD])
    wrong[HEAD] = found.keypoints[HEAD] + 0.3 * across
    again = in_open_drawer(wrong, look.cloud.xyz[found.points[found.moving]], found.joint)
    assert np.linalg.norm(again[HEAD] - found.keypoints[HEAD]) == pytest.approx(0.0 if is_moved else 0.3, abs=0.008)


@pytest.mark.parametrize("asset_class", ["refrigerator", "safe_rotate", "microwave"])
def test_the_keypoint_in_a_cabinet_follows_from_its_door(asset_class: str) -> None:
    look = look_at(asset_class, 0.9)
    found = truth(look, asset_class)
    inwards, across = np.array([np.cos(0.3), np.sin(0.3), 0.0]), np.array([-np.sin(0.3), np.cos(0.3), 0.0])
    inside = found.keypoints[IN_CABINET]
    for door, aside in ((look.cloud.xyz[found.points[found.moving]], 0.015), (look.cloud.xyz[:0], 0.03)):
        off = in_cabinet(inside + 0.07 * inwards + 0.03 * across, door, found.joint.origin, inwards) - inside
        assert off @ inwards == pytest.approx(0.0, abs=0.015)
        assert off @ across == pytest.approx(aside, abs=0.01)
        assert off[2] == 0.0


def door_at(angle: float, turn: float, handle: float) -> tuple[Array, Array]:
    """Return the points of a door that is 0.3 m wide and 0.4 m high, and the middle of its handle, 4 cm from the front.

    Args:
        angle: angle about the z axis, rad.
        turn: direction in which the door opens about the z axis.
        handle: height of the middle of the handle, m.
    """
    across, up = np.mgrid[0.0:0.3:0.01, -0.2:0.2:0.01].reshape(2, -1)
    panel = np.stack([across, np.zeros_like(up), up], axis=1)
    bar = np.stack([np.full(16, 0.26), np.full(16, 0.04), np.linspace(handle - 0.05, handle + 0.05, 16)], axis=1)
    T = Rotation.from_euler("z", angle).as_matrix() @ np.diag([1.0, turn, 1.0])
    return np.concatenate([panel, bar]) @ T.T, T @ [0.26, 0.04, handle]


@pytest.mark.parametrize(("angle", "turn"), [(0.4, 1.0), (2.0, -1.0)])
def test_the_handle_of_a_door_is_where_points_stand_out_from_its_front(angle: float, turn: float) -> None:
    origin = np.array([0.5, 0.1, 0.3])
    door, handle = door_at(angle, turn, 0.08)
    seen = (door + origin).astype(np.float32)
    for off in ([0.0, 0.0, -0.06], [0.02, -0.02, 0.04]):
        at, deviation = on_door(handle + origin + off, 0.06, seen, origin, turn)
        assert np.linalg.norm(at - handle - origin) < 0.005
        assert deviation < 0.06
    wrong = handle + origin + [0.0, 0.0, -0.06]
    # Neither a certain keypoint nor a keypoint far from the points that stand out is changed, nor one behind the door.
    assert np.array_equal(on_door(wrong, 0.02, seen, origin, turn)[0], wrong)
    far = handle + origin + [0.0, 0.0, -0.2]
    assert np.array_equal(on_door(far, 0.06, seen, origin, turn)[0], far)
    assert np.array_equal(on_door(wrong, 0.06, seen, origin, -turn)[0], wrong)


def test_a_handle_does_not_lie_beyond_the_edge_of_its_door() -> None:
    door, handle = door_at(0.0, 1.0, 0.08)
    beyond = np.array([0.07, 0.0, 0.0])
    at, deviation = on_door(handle + beyond, 0.02, door.astype(np.float32), np.zeros(3), 1.0)
    assert 0.26 < at[0] < 0.285
    assert at[1:] == pytest.approx(handle[1:], abs=0.002)
    assert deviation == 0.02


def test_the_keypoint_in_a_box_with_a_lid_is_shifted_away_from_the_hinge() -> None:
    look = look_at("box_rotate", 0.9)
    found = truth(look)
    inwards = np.array([np.cos(look.placed.yaw), np.sin(look.placed.yaw), 0.0])
    inside = found.keypoints[IN_CABINET]
    again = in_box(inside, found.joint.origin, inwards)
    depth = (found.joint.origin - inside) @ inwards
    assert depth > 0.05
    np.testing.assert_allclose(again - inside, -FORWARDS * depth * inwards, atol=1e-9)


@pytest.mark.parametrize(
    ("is_less_certain", "has_moved", "is_kept"), [(True, False, True), (False, False, False), (True, True, False)]
)
def test_a_keypoint_on_the_fixed_part_is_kept_if_it_was_more_certain(
    is_less_certain: bool, has_moved: bool, is_kept: bool
) -> None:
    """The open lid hides a part of the box, and the new keypoints are wrong. Their old places are right unless the box
    has moved.
    """
    looks = [look_at("box_rotate", openness) for openness in (0.5, 0.9)]
    first, second = (truth(look) for look in looks)
    first = replace(first, keypoint_deviations=dict.fromkeys(first.keypoints, 0.01))
    off = {name: at + np.array([0.0, 0.0, 0.03]) for name, at in second.keypoints.items()}
    doubt = 0.02 if is_less_certain else 0.005
    new = replace(second, keypoints=off, keypoint_deviations=dict.fromkeys(off, doubt))
    cloud = looks[1].cloud.xyz + has_moved * np.float32([0.03, 0.03, 0.0])
    found = Track(first, looks[0].cloud.xyz, NONE).after(new, cloud, NONE, 1).found
    expected = first.keypoints if is_kept else off
    assert np.array_equal(found.keypoints[IN_CABINET], expected[IN_CABINET])
    assert np.array_equal(found.keypoints[HEAD], off[HEAD])


def test_the_keypoints_of_an_open_drawer_count_after_it_was_closed() -> None:
    """The closed drawer looks like the other drawers, so its keypoints are wrong, and the network is not sure."""
    looks = [look_at("drawer", openness) for openness in (0.8, 0.1, 0.1)]
    first, second, third = (truth(look) for look in looks)
    off = {name: at + np.array([0.0, 0.0, 0.09]) for name, at in second.keypoints.items()}
    unsure = replace(second, keypoints=off, keypoint_deviations=dict.fromkeys(off, 0.1))
    track = Track(first, looks[0].cloud.xyz, NONE).after(unsure, looks[1].cloud.xyz, NONE, -1)
    for name, at in track.found.keypoints.items():
        assert np.linalg.norm(at - second.keypoints[name]) < 0.012
    # A further motion does not move the drawer.
    again = track.after(unsure, looks[2].cloud.xyz, NONE, -1)
    for name, at in again.found.keypoints.items():
        assert np.linalg.norm(at - third.keypoints[name]) < 0.012
    # If the network is sure, its new keypoints count.
    sure = replace(unsure, keypoint_deviations=dict.fromkeys(off, 0.002))
    new = Track(first, looks[0].cloud.xyz, NONE).after(sure, looks[1].cloud.xyz, NONE, -1)
    assert np.array_equal(new.found.keypoints[INSIDE], off[INSIDE])


def test_a_motion_that_should_not_move_the_drawer_moves_it_only_if_the_points_show_it() -> None:
    """While the hand grasps another object, it hides a part of the drawer, and the estimated handle shifts."""
    look = look_at("drawer", 0.8)
    found = truth(look)
    along = look.cloud.xyz @ found.joint.axis
    shown = np.flatnonzero(~look.moving | (along < np.quantile(along[look.moving], 0.5)))
    cloud = look.cloud.xyz[shown]
    kept = np.isin(found.points, shown)
    shifted = {name: at - 0.04 * found.joint.axis for name, at in found.keypoints.items()}
    hidden = replace(
        found,
        points=np.searchsorted(shown, found.points[kept]),
        moving=found.moving[kept],
        keypoints=shifted,
    )
    assert displacement(found, look.cloud.xyz, hidden, cloud).value == pytest.approx(-0.04)
    assert displacement(found, look.cloud.xyz, hidden, cloud, is_expected=False).value == 0.0
    # A drawer that the hand has really displaced is still noticed.
    moved = look_at("drawer", 0.3)
    by = displacement(found, look.cloud.xyz, truth(moved), moved.cloud.xyz, is_expected=False)
    span = found.joint.upper - found.joint.lower
    assert by.value == pytest.approx(-0.5 * span, abs=0.06 * span)


def test_a_drawer_that_the_network_sees_open_is_not_closed_by_a_standstill() -> None:
    looks = [look_at("drawer", openness) for openness in (0.9, 0.5, 0.5)]
    first, second, third = (truth(look) for look in looks)
    track = Track(first.at(0.9, 0.1), looks[0].cloud.xyz, NONE).after(second.at(0.5, 0.1), looks[1].cloud.xyz, NONE, -1)
    seen = track.after(third.at(0.5, 0.1), looks[2].cloud.xyz, NONE, -1)
    assert seen.found.joint.openness == pytest.approx(0.5, abs=0.1)
    assert seen.misses == 1
    # A second standstill shows it even if the network is sure, unless the drawer is too far from its end.
    assert seen.after(third.at(0.5, 0.1), looks[2].cloud.xyz, NONE, -1).found.joint.openness > 0.4
    assert seen.after(third.at(0.5, 0.1), looks[2].cloud.xyz, NONE, -1).misses == 2
    # If the network is not sure, the standstill shows that the drawer is closed, but only if the drawer has resisted:
    # otherwise the hand may have missed it.
    near = look_at("drawer", 0.2)
    begun = Track(first.at(0.9, 0.1), looks[0].cloud.xyz, NONE).after(
        truth(near).at(0.3, 0.1), near.cloud.xyz, NONE, -1
    )
    for is_pressed in (False, None, True):
        ended = begun.after(truth(near).at(0.3, 0.15), near.cloud.xyz, NONE, -1, is_pressed=is_pressed)
        assert (ended.found.joint.openness == 0.0) == (is_pressed is not False)
    nearly = track.after(truth(near).at(0.2, 0.05), near.cloud.xyz, NONE, -1)
    assert nearly.found.joint.openness > 0.0
    again = nearly.after(truth(near).at(0.2, 0.05), near.cloud.xyz, NONE, -1)
    assert again.found.joint.openness > 0.0
    assert again.after(truth(near).at(0.2, 0.05), near.cloud.xyz, NONE, -1).found.joint.openness == 0.0


def test_the_planner_gets_the_floor_of_a_drawer() -> None:
    look = look_at("drawer", 0.8)
    found = truth(look)
    moving = look.cloud.xyz[found.points[found.moving]]
    height = float(moving[:, 2].min())
    scene = scene_object("drawer", found, look.cloud.xyz, floor=height)
    [*_, slab] = next(body for body in scene.bodies if body.name == "drawer/moving").hulls
    # The slab lies below the middle of the opening, which no camera may see.
    middle = found.keypoints[HEAD] - 0.06 * found.joint.axis
    local = (slab - middle) @ found.joint.axis
    assert local.min() < 0 < local.max()
    assert slab[:, 2] == pytest.approx(height, abs=0.003)
    without = scene_object("drawer", found, look.cloud.xyz)
    assert sum(len(body.hulls) for body in scene.bodies) == 1 + sum(len(body.hulls) for body in without.bodies)


def test_a_hidden_object_rests_on_the_floor_of_the_drawer_and_moves_with_it() -> None:
    goal = tracked()
    T, drawer = PANDA.T_world_base, goal.articulated["drawer"]
    track = drawer.track
    assert track is not None
    assert drawer.has_floor
    points = track.cloud[track.found.points[track.found.moving]] @ T[:3, :3].T + T[:3, 3]
    drawer._floors.append(float(points[:, 2].mean()))
    assert drawer.floor is not None
    above = 0.5 * (points.min(axis=0) + points.max(axis=0)) + np.array([0.0, 0.0, 0.15])
    apple = apple_at(above)
    goal.rigid.found["apple"] = apple
    goal.hold("apple", apple.T_world_object)
    goal.hold(None)
    # The cloud shows neither the apple nor the floor of the drawer.
    wall = np.stack(np.meshgrid([0.5], np.arange(-0.2, 0.2, 0.01), np.arange(0.3, 0.5, 0.01)), -1).reshape(-1, 3)
    goal.rigid.take_in(wall, np.ones(len(wall), dtype=bool))
    assert goal.rigid.found["apple"].bounds[0, 2] == pytest.approx(0.0, abs=0.002)
    q = np.array(PANDA.reset_qpos)
    assert goal.measurement(q).contents == {"drawer": frozenset()}
    drawer.rest_on_floor(goal.rigid)
    resting = goal.rigid.found["apple"]
    assert resting.bounds[0, 2] == pytest.approx(drawer.floor, abs=0.002)
    assert goal.measurement(q).contents == {"drawer": frozenset({"apple"})}
    goal.begin_motion()
    drawer.carry(-0.1, goal.rigid)
    assert goal.rigid.found["apple"].center - resting.center == pytest.approx(-0.1 * T[:3, :3] @ track.found.joint.axis)
    # The front of the closed drawer does not show that the apple is behind it, but the apple is still there.
    drawer.track = replace(track, found=replace(track.found, moving=np.zeros_like(track.found.moving)))
    goal.begin_motion()
    assert set(drawer.carried) == {"apple"}


def test_a_knob_is_not_taken_for_an_object_in_the_drawer() -> None:
    """After the drawer was closed, it hides the ball, and its knob, which is as large as the ball, has moved to within
    8 cm of the ball.
    """
    ball = on_table("golf_ball", 0.0, 0.0).moved(np.array([0.0, 0.0, 0.1]))
    knob = cloud_of(ball.moved(np.array([-0.08, 0.0, 0.02])))
    background = floor(0.05)
    for carried, is_hidden in ((("ball",), True), ((), False)):
        tracker = RigidTracker({"ball": ball.shape})
        seen = np.concatenate([cloud_of(ball), background])
        tracker.take_in(seen, nothing_articulated(seen))
        before = tracker.found["ball"]
        seen = np.concatenate([knob, background])
        tracker.take_in(seen, nothing_articulated(seen), carried)
        assert tracker.is_hidden("ball") == is_hidden
        assert (tracker.found["ball"] is before) == is_hidden


def test_a_released_object_that_has_tilted_and_slipped_upwards_is_found() -> None:
    _, tracker, lifted = lifted_by("cracker_box", (0.3, 0.0, 0.1), floor(0.05))
    tracker.hold(None)
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("y", 25, degrees=True).as_matrix()
    turn[:3, 3] = lifted.center + np.array([0.01, 0.0, 0.03]) - turn[:3, :3] @ lifted.center
    rest = lifted.at(turn @ lifted.T_world_object)
    low = rest.bounds[0, 2] + 0.05
    shown = rest.samples[rest.samples[:, 2] > low]
    seen = np.concatenate([shown, floor(0.05)])
    tracker.take_in(seen, np.ones(len(seen), dtype=bool))
    assert not tracker.is_hidden("cracker_box")
    np.testing.assert_allclose(tracker.found["cracker_box"].center, rest.center, atol=0.012)


def test_a_dropped_object_is_found_on_the_table_even_if_the_network_takes_it_for_a_part() -> None:
    true, tracker, _ = lifted_by("mug", (0.2, 0.0, 0.15), np.zeros((0, 3)))
    tracker.hold(None)
    rest = true.moved(np.array([0.05, -0.3, 0.0]))
    seen = cloud_of(rest)
    tracker.take_in(seen, np.ones(len(seen), dtype=bool))
    assert not tracker.is_hidden("mug")
    np.testing.assert_allclose(tracker.found["mug"].center, rest.center, atol=0.006)
