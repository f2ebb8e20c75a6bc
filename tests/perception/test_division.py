"""Division of point clouds among the articulated objects of a task and other bodies."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt
import pytest

from gensim2.core.seeding import rng
from gensim2.perception import ObservationSpec
from gensim2.perception.estimation import SceneEstimator
from gensim2.perception.estimation.division import (
    BESIDE,
    CONNECTED,
    FAR_SHARE,
    NOTHING,
    first_division,
    next_division,
    parts,
)
from gensim2.perception.estimation.goal import DENSE, GoalTracker
from gensim2.robots import robot
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_task

from .test_rigid import cloud_of, on_table

Points = npt.NDArray[np.float32]
PANDA = robot("panda")
BOX, DRAWER = "box_rotate", "drawer"


def block(x: float, y: float, z: float = 0.0, side: float = 0.12) -> Points:
    """Return points on a grid in a cube whose lowest corner is at (x, y, z), m."""
    steps = np.arange(0.0, side + 1e-6, 0.02)
    grid = np.stack(np.meshgrid(steps, steps, steps), -1).reshape(-1, 3)
    return (grid + np.array([x, y, z])).astype(np.float32)


def chances_of(*known: tuple[Points, Mapping[str, float]]) -> Callable[[Points, str], float]:
    """Return class probabilities of a cloud. They are those of the ``known`` cloud with the same number of points."""

    def chance(points: Points, name: str) -> float:
        return next((found.get(name, 0.01) for each, found in known if len(each) == len(points)), 0.01)

    return chance


def runs(labels: npt.NDArray[np.int64], clouds: Sequence[Points]) -> list[set[int]]:
    """Return the labels of each of several concatenated clouds."""
    ends = np.cumsum([len(each) for each in clouds])
    return [set(each.tolist()) for each in np.split(labels, ends[:-1])]


def test_bodies_stand_on_the_table_and_what_is_above_them_belongs_to_them() -> None:
    large, small = block(0.0, 0.0), block(0.5, 0.0, side=0.06)
    lid = block(0.02, 0.02, z=0.19, side=0.06)
    high = block(0.0, 0.5, z=0.4, side=0.06)
    cloud = np.concatenate([large, small, lid, high])
    owners = [set(np.searchsorted(np.cumsum([343, 64, 64, 64]), rows, side="right")) for rows in parts(cloud, 0.0)]
    assert owners == [{0, 2}, {1}, {3}]
    # If the table is lower, no cluster reaches down to it, and the clusters stay apart.
    assert len(parts(cloud, -1.0)) == 4


def test_the_first_cloud_is_divided_by_the_classes_of_its_bodies() -> None:
    box, drawer, thing = block(0.0, 0.3), block(0.0, -0.3, side=0.14), block(0.0, 0.0, side=0.08)
    clouds = [thing, drawer, box]
    chances = chances_of((box, {BOX: 0.9, DRAWER: 0.8}), (drawer, {BOX: 0.6, DRAWER: 0.3}), (thing, {}))
    labels = first_division(np.concatenate(clouds), 0.0, [DRAWER, BOX], chances)
    # 0.8 * 0.6 is more than 0.9 * 0.3, although the box has the greatest probability of its own class.
    assert runs(labels, clouds) == [{NOTHING}, {1}, {0}]
    assert runs(first_division(np.concatenate(clouds), 0.0, [BOX], chances), clouds) == [{NOTHING}, {NOTHING}, {0}]
    # A single body is the only object, without a look at its class.
    assert set(first_division(box, 0.0, [DRAWER], chances_of())) == {0}
    # If there are fewer bodies than objects, an object gets no points.
    assert set(first_division(box, 0.0, [DRAWER, BOX], chances)) == {1}
    assert not len(first_division(box[:0], 0.0, [DRAWER, BOX], chances))


@pytest.mark.parametrize(
    ("gap", "chance", "is_part"),
    [(BESIDE - 0.005, 0.7, True), (BESIDE - 0.005, 0.2, False), (BESIDE + 0.02, 0.9, False)],
)
def test_a_body_beside_an_object_is_a_part_of_it_if_the_class_stays_probable(
    gap: float, chance: float, *, is_part: bool
) -> None:
    box, piece = block(0.0, 0.0), block(0.12 + gap, 0.0, side=0.06)
    both = np.concatenate([box, piece])
    labels = first_division(both, 0.0, [BOX], chances_of((box, {BOX: 0.9}), (both, {BOX: chance})))
    assert runs(labels, [box, piece]) == [{0}, {0 if is_part else NOTHING}]


@pytest.mark.parametrize(
    ("gap", "chance", "is_part"), [(FAR_SHARE - 0.05, 0.8, True), (FAR_SHARE - 0.05, 0.3, False), (0.4, 0.8, False)]
)
def test_a_body_farther_from_an_object_is_a_part_of_it_if_it_looks_like_the_object(
    gap: float, chance: float, *, is_part: bool
) -> None:
    """The open door of a refrigerator with two doors looks like a refrigerator."""
    large, door = block(0.0, 0.0, side=0.4), block(0.4 + 0.4 * np.sqrt(3.0) * gap, 0.0, side=0.2)
    both = np.concatenate([large, door])
    known = chances_of((large, {BOX: 0.9}), (door, {BOX: chance}), (both, {BOX: 0.9}))
    assert runs(first_division(both, 0.0, [BOX], known), [large, door]) == [{0}, {0 if is_part else NOTHING}]


def test_a_body_farther_from_an_object_is_a_part_of_it_if_the_class_becomes_more_probable() -> None:
    """The door alone hardly looks like a refrigerator, and neither does the refrigerator without its door."""
    large, door = block(0.0, 0.0, side=0.4), block(0.4 + 2.0 * BESIDE, 0.0, side=0.2)
    both = np.concatenate([large, door])
    for joined, label in ((0.95, 0), (0.65, NOTHING)):
        known = chances_of((large, {BOX: 0.6}), (door, {BOX: 0.01}), (both, {BOX: joined}))
        assert runs(first_division(both, 0.0, [BOX], known), [large, door]) == [{0}, {label}]


@pytest.mark.parametrize(("chance", "is_part"), [(0.0, False), (0.1, True)])
def test_a_body_beside_an_object_that_is_too_small_alone_must_make_its_class_possible(
    chance: float, *, is_part: bool
) -> None:
    box, piece = block(0.0, 0.0), block(0.12 + BESIDE - 0.005, 0.0, side=0.06)
    both = np.concatenate([box, piece])
    labels = first_division(both, 0.0, [BOX], chances_of((box, {BOX: 0.0}), (piece, {BOX: 0.0}), (both, {BOX: chance})))
    assert runs(labels, [box, piece]) == [{0}, {0 if is_part else NOTHING}]


def test_later_clouds_are_divided_by_the_places_of_the_bodies() -> None:
    box, drawer, thing = block(0.0, 0.3), block(0.0, -0.3), block(0.4, 0.3, side=0.06)
    bodies, by = [box, drawer], np.float32([0.0, 0.01, 0.0])
    clouds = [thing + by, drawer + by, box + by]
    divided = runs(next_division(np.concatenate(clouds), bodies, thing, []), clouds)
    assert divided == [{NOTHING}, {1}, {0}]
    # The lid of the box has opened until it is beside the thing: the lid belongs to the box if the motion moved it.
    lid = np.array([[x, 0.36, 0.1] for x in np.arange(0.13, 0.40, 0.01)], dtype=np.float32)
    clouds = [thing, drawer, np.concatenate([box, lid])]
    assert runs(next_division(np.concatenate(clouds), bodies, thing, [0]), clouds)[2] >= {0}
    labels = next_division(np.concatenate(clouds), bodies, thing, [0])
    assert set(labels[-len(lid) :][lid[:, 0] < 0.4 - CONNECTED]) == {0}
    assert set(labels[: len(thing)]) == {NOTHING}
    # An object that was pushed away is found at its new place, even if another object is nearer.
    pushed = drawer + np.float32([0.0, 0.35, 0.0]) + np.float32([0.3, 0.0, 0.0])
    divided = runs(next_division(np.concatenate([pushed, box]), bodies, thing[:0], [1]), [pushed, box])
    assert divided == [{1}, {0}]
    # New points at a place that was empty before belong to the nearest object.
    new = block(0.3, -0.5, side=0.06)
    clouds = [new, drawer, box]
    assert runs(next_division(np.concatenate(clouds), bodies, thing[:0], []), clouds) == [{1}, {1}, {0}]
    assert not len(next_division(box[:0], bodies, thing, []))


def test_two_articulated_objects_are_estimated_apart() -> None:
    name = "CloseLaptopAndCloseBox"
    env = HeadlessEnv(name, assets="builtin", engine="mujoco", instances="new")
    env.reset(3)
    task = load_task(name)
    classes = {each: kind.asset_class for each, kind in task.objects.items()}
    goal = GoalTracker(SceneEstimator.load(), classes, task.success)
    goal.take_in(env.observe(ObservationSpec(cloud=DENSE)).cloud.xyz)
    q, true = np.array(PANDA.reset_qpos), env.measure()
    found = goal.measurement(q)
    for each in classes:
        assert found.openness[each] == pytest.approx(true.openness[each], abs=0.15)
        for key, at in true.keypoints[each].items():
            assert np.linalg.norm(found.keypoints[each][key] - at) < 0.05
    assert list(goal.scene(q).objects) == ["laptop", "box"]
    # Each step judges the joint of its own object.
    goal.begin_step(task.steps[1].done, q)
    assert [each.goal for each in goal.articulated.values()] == [0, -1]
    assert goal.is_displaced(q)


def test_an_object_that_the_task_does_not_name_is_an_obstacle() -> None:
    """A mug and a whole second cabinet stand beside the box; the estimate of the box stays the same."""
    env = HeadlessEnv("CloseBox", assets="builtin", engine="mujoco", instances="new")
    env.reset(1)
    classes, success = {"box": BOX}, load_task("CloseBox").success
    alone, together = (GoalTracker(SceneEstimator.load(), classes, success) for _ in range(2))
    cloud = env.observe(ObservationSpec(cloud=DENSE)).cloud.xyz
    T = np.linalg.inv(PANDA.T_world_base)
    middle = cloud[:, :2].mean(axis=0)
    mug = cloud_of(on_table("mug", 0.0, 0.0)) @ T[:3, :3].T + T[:3, 3]
    mug[:, :2] += np.array([middle[0], cloud[:, 1].max() + 0.15]) - mug[:, :2].mean(axis=0)
    other = HeadlessEnv("OpenDrawer", assets="builtin", engine="mujoco", instances="new")
    other.reset(1)
    cabinet = other.observe(ObservationSpec(cloud=DENSE)).cloud.xyz
    cabinet[:, 1] += cloud[:, 1].min() - 0.12 - cabinet[:, 1].max()
    alone.take_in(cloud)
    things = np.concatenate([mug, cabinet]).astype(np.float32)
    together.take_in(rng(0, "order").permutation(np.concatenate([cloud, things])))
    assert together.is_seen
    q = np.array(PANDA.reset_qpos)
    first, second = (each.measurement(q) for each in (alone, together))
    assert second.openness["box"] == pytest.approx(first.openness["box"], abs=0.02)
    for key, at in first.keypoints["box"].items():
        assert second.keypoints["box"][key] == pytest.approx(at, abs=0.005)
    [_, others] = together.scene(q).fixtures
    corners = np.concatenate(others.hulls)
    assert corners[:, 1].max() == pytest.approx(mug[:, 1].max(), abs=0.01)
    assert corners[:, 1].min() == pytest.approx(cabinet[:, 1].min(), abs=0.01)
