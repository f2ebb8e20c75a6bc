"""Rigid objects in point clouds: clusters, shapes, and the tracking of grasped, released and hidden objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import gensim2
from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.perception import ObservationSpec
from gensim2.perception.estimation import PerceivingChain, SceneEstimator
from gensim2.perception.estimation.estimator import SceneEstimate
from gensim2.perception.estimation.goal import DENSE, GoalTracker
from gensim2.perception.estimation.rigid import (
    LEAST_IN_CLUSTER,
    RigidEstimate,
    assigned,
    clusters,
    fitted,
    found_inside,
    rectangle,
    shape_of,
)
from gensim2.perception.estimation.rigid_tracking import RigidTracker
from gensim2.robots import robot
from gensim2.rollout.record import Cause
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.criteria import DistanceArticulatedRigid, RigidLifted, RigidOnRigid
from gensim2.tasks.library import load_task

Array = npt.NDArray[np.float64]
PANDA = robot("panda")


def on_table(name: str, x: float, y: float, yaw: float = 0.0) -> RigidEstimate:
    """Return a true object of a class in its usual pose on the table."""
    shape = shape_of(name)
    assert shape is not None
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("z", yaw).as_matrix() @ shape.rotation
    found = RigidEstimate(shape, np.ones(3), T, yaw, 0.0)
    low, high = found.bounds
    return found.moved(np.array([x, y, 0.0]) - [*(0.5 * (low + high)[:2]), low[2]])


def cloud_of(thing: RigidEstimate, count: int = 200) -> Array:
    """Return random points on the surface of an object, except the lowest centimetre."""
    points = thing.samples[rng(0, "test").choice(len(thing.samples), count, replace=False)]
    return points[points[:, 2] > thing.bounds[0, 2] + 0.01]


def nothing_articulated(points: Array) -> npt.NDArray[np.bool_]:
    return np.zeros(len(points), dtype=bool)


def lifted_by(name: str, by: Sequence[float], background: Array) -> tuple[RigidEstimate, RigidTracker, RigidEstimate]:
    """Return an object on the table, a tracker that has seen it before a background, and the object in the hand, ``by``
    (3,) away, m."""
    true = on_table(name, 0.0, 0.0)
    tracker = RigidTracker({name: true.shape})
    points = np.concatenate([cloud_of(true), background])
    tracker.take_in(points, nothing_articulated(points))
    lifted = tracker.found[name].moved(np.array(by))
    tracker.hold(name, lifted.T_world_object)
    return true, tracker, lifted


def test_clusters_are_separated_by_gaps_and_strays_are_left_out() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(5) * 0.015] * 2, [0.0]), -1).reshape(-1, 3)
    points = np.concatenate([grid[:10], grid + np.array([0.2, 0.0, 0.0]), [[1.0, 1.0, 1.0]] * (LEAST_IN_CLUSTER - 1)])
    found = clusters(points)
    assert [rows.tolist() for rows in found] == [list(range(10, 35)), list(range(10))]
    assert clusters(points[:2]) == []


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.2])
def test_the_smallest_rectangle_turns_with_its_points(yaw: float) -> None:
    corners = np.array([[0.0, 0.0], [0.3, 0.0], [0.3, 0.1], [0.0, 0.1], [0.1, 0.05]])
    turned = corners @ np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    assert rectangle(turned) == pytest.approx((0.3, 0.1))


@pytest.mark.parametrize("name", ["cracker_box", "mug", "lemon", "gold_bar", "wood_block"])
def test_a_shape_is_fitted_to_its_cloud(name: str) -> None:
    true = on_table(name, -0.1, 0.2, yaw=0.5)
    found = fitted(true.shape, cloud_of(true))
    np.testing.assert_allclose(found.bounds, true.bounds, atol=0.006)
    np.testing.assert_allclose(found.center, true.center, atol=0.004)
    assert found.scale == pytest.approx(np.ones(3), abs=0.08)


def test_the_dimensions_of_a_larger_object_are_fitted() -> None:
    true = replace(on_table("wood_block", 0.0, 0.0), scale=np.full(3, 1.15))
    true = true.moved(np.array([0.0, 0.0, -true.bounds[0, 2]]))
    assert fitted(true.shape, cloud_of(true)).scale == pytest.approx(np.full(3, 1.15), abs=0.05)


def test_clusters_are_assigned_by_their_dimensions_and_a_stranger_is_left_over() -> None:
    things = [on_table(name, 0.0, 0.0) for name in ("plate", "apple", "cracker_box")]
    candidates = [cloud_of(each) for each in things]
    shapes = {"crackers": things[2].shape, "fruit": things[1].shape}
    found = assigned(shapes, candidates, [0.0] * 3)
    assert {name: column for name, (column, _) in found.items()} == {"crackers": 2, "fruit": 1}
    assert "fruit" not in assigned(shapes, [candidates[0], candidates[2]], [0.0] * 2)


def test_an_object_that_is_partly_hidden_keeps_its_pose() -> None:
    true = on_table("cracker_box", 0.0, 0.0)
    tracker = RigidTracker({"crackers": true.shape})
    points = cloud_of(true)
    own = tracker.take_in(points, nothing_articulated(points))
    assert (own == 0).all()
    before = tracker.found["crackers"]
    half = points[points[:, 1] > 0.01]
    tracker.take_in(half, nothing_articulated(half))
    assert tracker.found["crackers"] is before
    assert not tracker.is_hidden("crackers")
    elsewhere = half + np.array([0.5, 0.0, 0.0])
    tracker.take_in(elsewhere[:3], nothing_articulated(elsewhere[:3]))
    assert tracker.found["crackers"] is before
    assert tracker.is_hidden("crackers")


def test_a_pushed_object_is_found_again() -> None:
    true = on_table("mug", 0.0, 0.0)
    tracker = RigidTracker({"mug": true.shape})
    for thing in (true, true.moved(np.array([0.1, 0.03, 0.0]))):
        points = cloud_of(thing)
        tracker.take_in(points, nothing_articulated(points))
        np.testing.assert_allclose(tracker.found["mug"].center, thing.center, atol=0.005)
    np.testing.assert_allclose(tracker.start["mug"], true.T_world_object[:3, 3], atol=0.005)


def floor(height: float) -> Array:
    """Return points of a square floor around (0.3, 0), m."""
    at = np.arange(-0.1, 0.1001, 0.01)
    return np.stack(np.meshgrid(0.3 + at, at, [height]), -1).reshape(-1, 3)


@pytest.mark.parametrize("is_shown", [True, False])
def test_a_grasped_object_follows_the_hand_and_is_found_where_it_was_dropped(is_shown: bool) -> None:
    """The apple falls 10 cm onto a floor 5 cm above the table, and rolls 2 cm. Points of the same shape above the place
    of the release, which the hand has hidden before, show something else.
    """
    _, tracker, lifted = lifted_by("apple", (0.3, 0.0, 0.15), floor(0.05))
    held = np.concatenate([cloud_of(lifted), floor(0.05)])
    own = tracker.take_in(held, nothing_articulated(held))
    assert (own[: len(cloud_of(lifted))] == 0).all(), "the points of the grasped object are no obstacle"
    assert (own[len(cloud_of(lifted)) :] == -1).all()
    tracker.hold(None)
    rest = lifted.moved(np.array([0.02 * is_shown, 0.0, 0.05 - lifted.bounds[0, 2]]))
    seen = np.concatenate([cloud_of(rest), floor(0.05)]) if is_shown else floor(0.05)
    seen = np.concatenate([seen, cloud_of(lifted.moved(np.array([0.05, 0.05, 0.1])))])
    tracker.take_in(seen, np.ones(len(seen), dtype=bool))
    np.testing.assert_allclose(tracker.found["apple"].center, rest.center, atol=0.006)
    assert tracker.is_hidden("apple") != is_shown


def test_a_released_object_is_found_above_the_place_where_it_was_assumed() -> None:
    """The first cloud after the release shows neither the apple nor the floor below it, so the apple counts as lying on
    the table. The second cloud shows the apple on a floor 8 cm above the table.
    """
    true = on_table("apple", 0.0, 0.0)
    tracker = RigidTracker({"apple": true.shape})
    lifted = true.moved(np.array([0.3, 0.0, 0.15]))
    rest = true.moved(np.array([0.3, 0.0, 0.08]))
    above = cloud_of(lifted.moved(np.array([0.0, 0.03, 0.05])))
    elsewhere = floor(0.0) + np.array([0.0, 0.4, 0.0])
    tracker.take_in(cloud_of(true), nothing_articulated(cloud_of(true)))
    tracker.hold("apple", lifted.T_world_object)
    tracker.hold(None)
    tracker.take_in(elsewhere, np.ones(len(elsewhere), dtype=bool))
    assert tracker.is_hidden("apple")
    assert tracker.found["apple"].bounds[0, 2] == pytest.approx(0.0, abs=0.003)
    for seen, is_hidden in ((above, True), (cloud_of(rest), False)):
        points = np.concatenate([elsewhere, seen])
        tracker.take_in(points, np.ones(len(points), dtype=bool))
        assert tracker.is_hidden("apple") == is_hidden
    np.testing.assert_allclose(tracker.found["apple"].center, rest.center, atol=0.006)


def test_a_cluster_and_a_part_of_it_do_not_show_two_objects() -> None:
    """The network considers one point of the only apple a part of the articulated object."""
    true = on_table("apple", 0.0, 0.0)
    tracker = RigidTracker({"first": true.shape, "second": true.shape})
    points = cloud_of(true)
    tracker.take_in(points, np.arange(len(points)) == 0)
    assert list(tracker.found) == ["first"]
    assert tracker.missing == ["second"]
    # Two apples are found as two objects.
    other = true.moved(np.array([0.0, 0.3, 0.0]))
    tracker.reset()
    points = np.concatenate([points, cloud_of(other)])
    tracker.take_in(points, np.arange(len(points)) == 0)
    centers = sorted(each.center[1] for each in tracker.found.values())
    assert centers == pytest.approx([true.center[1], other.center[1]], abs=0.005)


def test_a_class_that_neither_the_estimator_nor_the_library_knows_is_refused() -> None:
    with pytest.raises(InputError, match="does not know the class 'spaceship'"):
        GoalTracker(SceneEstimator.load(), {"box": "box_rotate", "thing": "spaceship"}, load_task("OpenBox").success)


def test_a_missing_rigid_object_is_named_and_nothing_moves() -> None:
    env = HeadlessEnv("CloseBox", assets="builtin", engine="mujoco")
    env.reset(0)
    chain = PerceivingChain("PlaceGolfBallIntoBox")
    seen = env.observe(ObservationSpec.of(chain.observation_spec))
    chain.reset(seen, 0)
    assert chain.act(seen) is None
    [event] = chain.events
    assert (event.what, event.detail) == (Cause.OBJECT_NOT_SEEN, {"object": "ball", "class": "golf_ball"})
    assert [(each.name, each.plans) for each in chain.history] == [("open", [])]
    assert (chain.reference, chain.plans) == (None, [])
    assert ObservationSpec.of(chain.observation_spec).cloud is not None


def test_a_rigid_object_is_found_in_a_noisy_cloud() -> None:
    env = HeadlessEnv("DropAppleIntoBox", assets="builtin", engine="mujoco", instances="new")
    env.reset(2)
    chain = PerceivingChain("DropAppleIntoBox", noise="deployed")
    chain.reset(env.observe(ObservationSpec.of(chain.observation_spec)), 0)
    found, true = chain._goal.rigid.found["apple"], env.measure().poses["apple"][:3]
    np.testing.assert_allclose(found.T_world_object[:3, 3], true, atol=0.01)


@pytest.mark.parametrize("seed", [1703387623, 2059687159])
def test_a_small_object_beside_a_large_one_is_found(seed: int) -> None:
    """The refrigerator fills two thirds of the pixels, and its door hides a part of the cracker box. With the second
    seed, points on a slanting face of the cracker box are more than 3 cm apart.
    """
    env = HeadlessEnv("PlaceCrackerBoxIntoRefrigerator", assets="builtin", engine="mujoco", instances="new")
    env.reset(seed)
    goal = GoalTracker(SceneEstimator.load(), {"refrigerator": "refrigerator", "crackers": "cracker_box"}, ())
    goal.take_in(env.observe(ObservationSpec(cloud=DENSE)).cloud.xyz)
    found, true = goal.rigid.found["crackers"], env.measure().poses["cracker_box"][:3]
    np.testing.assert_allclose(found.T_world_object[:3, 3], true, atol=0.006)


def test_criteria_of_rigid_objects_are_judged_by_estimates() -> None:
    env = HeadlessEnv("DropAppleIntoBox", assets="builtin", engine="mujoco")
    env.reset(3)
    inside = DistanceArticulatedRigid(articulated="box", rigid="apple")
    goal = GoalTracker(SceneEstimator.load(), {"box": "box_rotate", "apple": "apple"}, (inside,))
    goal.take_in(env.observe(ObservationSpec(cloud=DENSE)).cloud.xyz)
    q, true = np.array(PANDA.reset_qpos), env.measure()
    found = goal.measurement(q)
    np.testing.assert_allclose(found.poses["apple"][:3], true.poses["apple"][:3], atol=0.006)
    np.testing.assert_allclose(found.bounds["apple"], true.bounds["apple"], atol=0.01)
    assert list(goal.scene(q).objects) == ["box", "apple"]
    assert goal.is_displaced(q)
    apple, middle = goal.rigid.found["apple"], found.point("box") - true.poses["apple"][:3]
    lifted = RigidLifted(rigid="apple")
    for height, is_held, is_inside in ((0.3, False, False), (0.0, True, False), (0.0, False, True)):
        T = apple.moved(middle + np.array([0.0, 0.0, height - middle[2]])).T_world_object
        goal.hold("apple", T)
        if not is_held:
            goal.hold(None)
        measured = goal.measurement(q)
        assert lifted.holds(measured) == (height > 0)
        assert ("apple" in measured.contents.get("box", ())) == is_inside
    assert not goal.is_displaced(q)
    # The apple stays at its goal although the next estimate has the goal elsewhere.
    box, track = goal.articulated["box"], goal.articulated["box"].track
    assert track is not None
    off = {name: at + np.array([0.2, 0.0, 0.0]) for name, at in track.found.keypoints.items()}
    shifted = replace(track, found=replace(track.found, keypoints=off))
    box.track = shifted
    assert goal.is_displaced(q)
    assert not goal.is_reached(q)
    box.track = track
    goal.begin_step((), q)
    box.track = shifted
    assert not goal.is_displaced(q)
    assert goal.is_reached(q)
    # A cloud that shows the apple on the table shows that it has left its goal.
    goal.begin_motion()
    goal.take_in(env.observe(ObservationSpec(cloud=DENSE)).cloud.xyz)
    assert goal.is_displaced(q)


def open_box(wall: float = 0.006) -> Array:
    """Return points of the floor and the walls of a box of 0.2 m, whose floor is as high as a ``wall`` is thick, m."""
    steps = np.arange(-0.1, 0.1001, 0.005)
    floor = np.stack(np.meshgrid(steps, steps, [wall]), -1).reshape(-1, 3)
    up = np.arange(0.01, 0.1, 0.005)
    sides = [np.stack(np.meshgrid([x], steps, up), -1).reshape(-1, 3) for x in (-0.1, 0.1)]
    return np.concatenate([floor, *sides, *(each[:, [1, 0, 2]] for each in sides)])


@pytest.mark.parametrize("name", ["rubiks_cube", "golf_ball", "lemon"])
def test_an_object_in_a_box_is_found_among_the_points_of_the_box(name: str) -> None:
    box, true = open_box(), on_table(name, 0.02, 0.01, 0.3).moved(np.array([0.0, 0.0, 0.006]))
    inside = true.samples[true.samples[:, 2] > 0.02]
    hidden = cKDTree(true.samples).query(box)[0] < 0.012
    points = np.concatenate([box[~hidden], inside])
    assert len(clusters(points)) == 1
    tracker, within = RigidTracker({name: true.shape}), np.ones(len(points), dtype=bool)
    tracker.take_in(points, within)
    assert tracker.missing == [name]
    tracker.reset()
    own = tracker.take_in(points, within, containers={name: within})
    assert np.linalg.norm(tracker.found[name].center - true.center) < 0.008
    assert (own[-len(inside) :] == 0).mean() > 0.9
    assert (own[: -len(inside)] == 0).mean() < 0.05
    # In the next cloud it is still there, although points of the box are near it.
    tracker.take_in(points, within)
    assert not tracker.is_hidden(name)


def test_a_box_without_the_object_does_not_show_it() -> None:
    points = open_box()
    for name in ("rubiks_cube", "golf_ball", "lemon", "baseball"):
        shape = shape_of(name)
        assert shape is not None
        assert found_inside(shape, points) is None


@pytest.mark.parametrize(("is_handled", "is_on"), [(True, True), (False, False)])
def test_an_object_that_was_put_into_a_bowl_is_above_its_bottom(*, is_handled: bool, is_on: bool) -> None:
    """The cube lies in the bowl, but its estimate is a millimetre lower than the bottom of the bowl."""
    on = RigidOnRigid(rigid="cube", support="bowl", threshold=0.064, height=0.086)
    goal = GoalTracker(SceneEstimator.load(), {"bowl": "bowl", "cube": "rubiks_cube"}, (on,))
    bowl = on_table("bowl", 0.0, 0.0)
    cube = on_table("rubiks_cube", 0.01, 0.0).moved(np.array([0.0, 0.0, -0.001]))
    goal.rigid.found |= {"bowl": bowl, "cube": cube}
    goal.looks.append(SceneEstimate((), np.zeros(0, dtype=np.int64)))
    if is_handled:
        goal.hold("cube", cube.T_world_object)
        goal.hold(None)
    assert on.holds(goal.measurement(np.array(PANDA.reset_qpos))) == is_on


@pytest.mark.parametrize("task", ["DropAppleIntoBox", "CloseLaptopAndCloseBox"])
def test_an_episode_with_two_objects_succeeds_on_an_estimated_scene(task: str) -> None:
    result = gensim2.benchmark(
        [task],
        runs=1,
        episodes=1,
        workers=1,
        assets="builtin",
        instances="new",
        engine="mujoco",
        scene_source="perceived",
    )
    [row] = result.rows
    [episode] = row.episodes
    assert episode.held
    assert not episode.truncated, "the controller ends the episode"
