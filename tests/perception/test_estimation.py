"""Labelled clouds, the estimator and the planner's scene that is made of its estimates."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import torch
from scipy.spatial.transform import Rotation

import gensim2
from gensim2.cli.main import run as run_command
from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.data.store import TaskStore
from gensim2.objects import ArticulatedObject, open_library
from gensim2.perception import ObservationSpec
from gensim2.perception.cloud import from_steps, to_steps
from gensim2.perception.estimation import PerceivingChain, SceneEstimator, deformation
from gensim2.perception.estimation.bail import raised_bail
from gensim2.perception.estimation.classes import ClassConstants, by_name
from gensim2.perception.estimation.deformation import _stretched_openness, deformed
from gensim2.perception.estimation.episodes import _model, _state
from gensim2.perception.estimation.estimator import (
    ESTIMATOR_JSON,
    JointEstimate,
    ObjectEstimate,
    SceneEstimate,
    squared_value,
    squared_yaw,
)
from gensim2.perception.estimation.examples import (
    SETTINGS,
    STRAY_DISTANCE,
    Cameras,
    LabelledCloud,
    example,
    object_looks,
    stacked,
    training_instances,
)
from gensim2.perception.estimation.goal import DISTRUST, GoalTracker
from gensim2.perception.estimation.measuring import calibrated, figures, measured, row_of
from gensim2.perception.estimation.network import OTHER, STRAY, TARGET, SceneNetwork, features_of, losses
from gensim2.perception.estimation.presence import why_absent
from gensim2.perception.estimation.rigid import RigidEstimate, shape_of
from gensim2.perception.estimation.scene import at_push_height, boxes, planning_scene, scene_object
from gensim2.perception.estimation.tracking import Track
from gensim2.perception.estimation.training import Examples, tensors, train_estimator
from gensim2.perception.noise import DEPLOYED
from gensim2.perception.raycast.observer import Observer
from gensim2.planning import StepPlanner, parse_strategy
from gensim2.robots import robot
from gensim2.rollout.controller_spec import PERCEIVING, ControllerSpec
from gensim2.rollout.record import Cause
from gensim2.scenes.initial_state import PlacedObject
from gensim2.scenes.randomize import placed
from gensim2.tasks.library import load_strategies, load_task
from gensim2.viewing import of_data_set, of_task

from .conftest import SMALL

Array = npt.NDArray[np.float64]
PANDA = robot("panda")
LIBRARY = open_library("builtin")
CLASSES = ("box_rotate", "drawer")


def model_of(asset_class: str) -> ArticulatedObject:
    """Return a generated object."""
    model = LIBRARY.load(asset_class, "7", "default")
    assert isinstance(model, ArticulatedObject)
    return model


def put(model: ArticulatedObject, openness: float, yaw: float = 0.3) -> PlacedObject:
    """Return an object on the table before the robot."""
    position, quaternion = placed(np.asarray(model.placement.position), model.placement.quaternion, 0.02, -0.05, yaw)
    return PlacedObject(model, position, quaternion, yaw, openness)


def look_at(asset_class: str, openness: float, *, noisy: bool = False) -> LabelledCloud:
    """Return a labelled cloud of a generated object."""
    model = model_of(asset_class)
    q = np.array(PANDA.reset_qpos)
    found = Cameras(PANDA, model).look(put(model, openness), q, DEPLOYED if noisy else None, rng(0, "test"))
    assert found is not None
    return found


def truth(look: LabelledCloud, *classes: str) -> ObjectEstimate:
    """Return the estimate of an observer that makes no mistake."""
    arrays = stacked([example(look, classes or CLASSES, PANDA)])
    model = look.placed.model
    assert isinstance(model, ArticulatedObject)
    T = np.linalg.inv(PANDA.T_world_base)
    turn = Rotation.from_quat(look.placed.quaternion, scalar_first=True).as_matrix()
    T_object = np.eye(4)
    T_object[:3, :3] = (
        T[:3, :3] @ turn @ model.joint.T_root_child_at(look.placed.joint_value)[:3, :3] @ model.T_link_object[:3, :3]
    )
    axis, rows = arrays["axis"][0].astype(np.float64), np.flatnonzero(look.group == TARGET)
    lower, upper = map(float, arrays["limits"][0])
    openness = float(arrays["openness"][0])
    joint = JointEstimate(
        model.joint.type,
        axis,
        arrays["origin"][0].astype(np.float64),
        0.01,
        openness,
        0.02,
        lower,
        upper,
        ((axis, 1.0),),
    )
    keypoints = dict(zip(model.keypoints, arrays["keypoints"][0].astype(np.float64), strict=False))
    return ObjectEstimate(
        asset_class=model.asset_class,
        confidence=1.0,
        classes={model.asset_class: 1.0},
        points=rows,
        moving=look.moving[rows],
        yaw=look.placed.yaw,
        T_base_object=T_object,
        joint=joint,
        keypoints=keypoints,
        keypoint_deviations=dict.fromkeys(keypoints, 0.01),
        size=arrays["size"][0],
        object_axis=model.object_axis,
        moving_keypoints=tuple(name for name, point in model.keypoints.items() if point.link == model.joint.child_link),
    )


def test_labels_of_an_exact_cloud_are_those_of_the_geometry() -> None:
    look = look_at("drawer", 0.5)
    assert set(np.unique(look.group)) == {TARGET}
    assert 0.03 < look.moving.mean() < 0.6
    joint = model_of("drawer").joint
    # Opening the drawer by half of its range moves exactly the points that are labelled as moving.
    closed = look_at("drawer", 0.0)
    assert closed.moving.any()
    arrays = example(look, CLASSES, PANDA)
    assert arrays["value"] == pytest.approx(joint.lower + 0.5 * (joint.upper - joint.lower))
    assert np.linalg.norm(arrays["axis"]) == pytest.approx(1.0, abs=1e-5)


def test_strays_of_a_noisy_cloud_are_labelled_and_few_after_outliers_are_dropped() -> None:
    exact, noisy = look_at("box_rotate", 0.6), look_at("box_rotate", 0.6, noisy=True)
    assert 0.0 < (noisy.group == STRAY).mean() < 0.35
    far = np.array([np.linalg.norm(exact.cloud.xyz - point, axis=1).min() for point in noisy.cloud.xyz])
    assert far[noisy.group == STRAY].min() > STRAY_DISTANCE / 2
    assert np.median(far[noisy.group == TARGET]) < STRAY_DISTANCE


def test_the_joint_of_an_example_is_that_of_the_object_in_the_base_frame() -> None:
    look = look_at("box_rotate", 0.4)
    arrays, model = example(look, CLASSES, PANDA), model_of("box_rotate")
    later = stacked([example(look_at("box_rotate", 0.9), CLASSES, PANDA)])
    turned = Rotation.from_rotvec((later["value"][0] - arrays["value"]) * arrays["axis"]).as_matrix()
    for slot, name in enumerate(model.keypoints):
        at = arrays["keypoints"][slot] - arrays["origin"]
        moves = model.keypoints[name].link == model.joint.child_link
        expected = arrays["origin"] + (turned @ at if moves else at)
        assert np.allclose(later["keypoints"][0, slot], expected, atol=1e-4), name


def test_rigid_objects_beside_the_articulated_one_are_labelled() -> None:
    model, other = model_of("drawer"), LIBRARY.load("cracker_box", "0", "default")
    found = Cameras(PANDA, model, other).look(put(model, 0.2), np.array(PANDA.reset_qpos), None, rng(1, "test"))
    assert found is not None
    assert (found.group == OTHER).sum() > 10
    assert not found.moving[found.group == OTHER].any()


def test_looks_follow_from_the_seed() -> None:
    one, same, other = (
        [look.cloud.xyz for look in object_looks(LIBRARY, PANDA, "drawer", "7", 2, rng(seed, "test"))]
        for seed in (0, 0, 1)
    )
    assert all(np.array_equal(a, b) for a, b in zip(one, same, strict=True))
    assert not np.array_equal(one[0], other[0])


def test_training_takes_no_object_that_evaluations_draw() -> None:
    found = training_instances(LIBRARY, dict.fromkeys(CLASSES, 20), 0)
    for name, ids in found.items():
        assert len(ids) == 20
        assert not set(ids) & {*LIBRARY.choose(name, "all"), *LIBRARY.choose(name, "new")}


def test_of_a_folder_of_objects_the_training_split_is_learned() -> None:
    class Folder:
        def source(self, _: str) -> str:
            return "real"

        def choose(self, _: str, which: str) -> tuple[str, ...]:
            return {"train": ("a", "b", "c"), "all": ("a", "b", "c", "d")}[which]

    library: Any = Folder()
    assert training_instances(library, {"door": 2}, 0) == {"door": ("a", "b")}


def test_class_constants_refuse_an_unknown_class() -> None:
    constants = [ClassConstants.of(model_of(name)) for name in CLASSES]
    assert by_name(constants, "drawer") == 1
    with pytest.raises(InputError, match="does not know the class 'door'"):
        by_name(constants, "door")


@pytest.mark.parametrize("angle", [-0.7, -0.1, 0.0, 0.4])
def test_the_yaw_of_a_box_follows_from_its_sides(angle: float) -> None:
    sides = np.repeat([[1.0, 0, 0], [0, -1.0, 0], [-1.0, 0, 0]], 20, axis=0) + 0.05 * rng(0, "n").standard_normal(
        (60, 3)
    )
    normals = Rotation.from_euler("z", angle).apply(sides / np.linalg.norm(sides, axis=1, keepdims=True))
    assert squared_yaw(normals.astype(np.float32), angle + 0.15) == pytest.approx(angle, abs=0.02)
    assert squared_yaw(normals.astype(np.float32), angle + 0.6) == pytest.approx(angle + 0.6)  # too far to be noise


def test_the_yaw_of_a_round_object_stays() -> None:
    around = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    normals = np.column_stack([np.cos(around), np.sin(around), np.zeros(200)]).astype(np.float32)
    assert squared_yaw(normals, 0.3) == 0.3


@pytest.mark.parametrize(
    ("asset_class", "openness"), [("refrigerator", 0.4), ("safe_rotate", 0.7), ("box_rotate", 0.3)]
)
def test_the_angle_of_a_door_or_lid_follows_from_its_surfaces(asset_class: str, openness: float) -> None:
    look = look_at(asset_class, openness)
    arrays = example(look, [asset_class], PANDA)
    normals = features_of(look.cloud.xyz)[look.moving, :3]
    value, axis = float(arrays["value"]), arrays["axis"].astype(np.float64)
    for error in (-0.25, 0.25):
        found = squared_value(normals, axis, look.placed.yaw, value + error)
        assert found == pytest.approx(value, abs=0.08)
    # A correction by more than MOST_TURNED is not made, and a part without flat surfaces gives no angle.
    assert squared_value(normals, axis, look.placed.yaw, value + 0.7) == pytest.approx(value + 0.7)
    around = rng(0, "normals").standard_normal((300, 3))
    around = (around / np.linalg.norm(around, axis=1, keepdims=True)).astype(np.float32)
    assert squared_value(around, axis, 0.3, 0.5) == 0.5


def test_the_order_of_the_points_has_no_say() -> None:
    torch.manual_seed(0)
    network = SceneNetwork(2).eval()
    estimator = SceneEstimator(network, [ClassConstants.of(model_of(name)) for name in CLASSES], PANDA)
    network.groups.bias.data[TARGET] = 100.0
    xyz = look_at("drawer", 0.5).cloud.xyz
    order = rng(0, "order").permutation(len(xyz))
    [one], [other] = (estimator.estimate(points, "drawer").objects for points in (xyz, xyz[order]))
    assert np.allclose(one.joint.axis, other.joint.axis, atol=1e-3)
    assert one.joint.openness == pytest.approx(other.joint.openness, abs=1e-3)


def test_losses_of_a_batch_have_gradients_for_every_weight() -> None:
    looks = [look_at(name, 0.5) for name in CLASSES]
    arrays = stacked([example(look, CLASSES, PANDA) for look in looks])
    arrays["features"] = np.stack([np.rint(127 * features_of(look.cloud.xyz)).astype(np.int8) for look in looks])
    torch.manual_seed(0)
    network = SceneNetwork(2)
    found = losses(network, Examples(arrays).batch(rng(0, "batch"), 4))
    assert all(torch.isfinite(value) for value in found.values())
    sum(found.values(), torch.zeros(())).backward()
    lacking = [name for name, weight in network.named_parameters() if weight.grad is None]
    assert not lacking


def test_a_moved_example_keeps_its_geometry() -> None:
    look = look_at("box_rotate", 0.5)
    arrays = stacked([example(look, CLASSES, PANDA)])
    arrays["features"] = np.rint(127 * features_of(look.cloud.xyz)).astype(np.int8)[None]
    still, moved = (
        tensors(arrays, np.array([turn]), np.array([[shift, 0.0, 0.0]])) for turn, shift in ((0.0, 0.0), (0.3, 0.05))
    )
    for name in ("origin", "keypoints"):
        between = [(each["xyz"] - each[name].reshape(1, -1, 3)[:, :1]).norm(dim=-1) for each in (still, moved)]
        assert torch.allclose(*between, atol=1e-4), name
    angle = [torch.atan2(each["yaw"][0, 1], each["yaw"][0, 0]) for each in (still, moved)]
    assert float(angle[1] - angle[0]) == pytest.approx(0.3, abs=1e-5)


def exact_example(asset_class: str, openness: float) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of an exact cloud, with features."""
    look = look_at(asset_class, openness)
    return example(look, CLASSES, PANDA) | {"features": np.rint(127 * features_of(look.cloud.xyz)).astype(np.int8)}


@pytest.mark.parametrize("name", CLASSES)
def test_labels_of_a_deformed_cloud_move_with_its_points(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deformation, "DEFORMED", 1.0)
    monkeypatch.setattr(deformation, "ADDED", 0.0)
    monkeypatch.setattr(deformation, "REMOVED", 0.0)
    everywhere = replace(SETTINGS, low=(-3.0, -3.0, -3.0), high=(3.0, 3.0, 3.0))
    monkeypatch.setattr(deformation, "SETTINGS", everywhere)
    before = exact_example(name, 0.5)
    # The first points are the keypoints, and further points lie on the joint axis.
    known = int(before["known"].sum())
    on_axis = before["origin"] + np.linspace(-0.2, 0.2, 5)[:, None] * before["axis"]
    marks = np.concatenate([before["keypoints"][:known], on_axis])
    before["points"][: len(marks)] = to_steps(marks.astype(np.float32))
    moved = []
    for seed in range(5):
        after = deformed(before, rng(seed, "deformed"))
        xyz = from_steps(after["points"])
        assert np.allclose(xyz[:known], after["keypoints"][:known], atol=2e-4)
        away = xyz[known : len(marks)] - after["origin"]
        if before["revolute"]:
            away -= (away @ after["axis"])[:, None] * after["axis"]
            assert np.abs(away).max() < 5e-4
        moved.append(np.linalg.norm(xyz - from_steps(before["points"]), axis=1).mean())
        # The normals are those of the deformed surface.
        flat = after["features"][:, 3] < 2
        true = features_of(xyz)[:, :3]
        along = np.abs((true * after["features"][:, :3] / 127).sum(axis=1))
        assert np.median(along[flat]) > 0.98
        assert (after["group"] == before["group"]).all()
    assert max(moved) > 0.02


def test_a_deformed_cloud_may_have_an_added_box_and_a_hole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deformation, "DEFORMED", 1.0)
    before = exact_example("drawer", 0.5)
    found = {}
    for name, added, removed in (("neither", 0.0, 0.0), ("box", 1.0, 0.0), ("hole", 0.0, 1.0)):
        monkeypatch.setattr(deformation, "ADDED", added)
        monkeypatch.setattr(deformation, "REMOVED", removed)
        after = deformed(before, rng(4, "deformed"))
        assert {key: (each.shape, each.dtype) for key, each in after.items()} == {
            key: (each.shape, each.dtype) for key, each in before.items()
        }
        found[name] = len(np.unique(after["points"], axis=0)), set(map(tuple, after["points"].tolist()))
    assert len(found["box"][1] - found["neither"][1]) >= 12
    assert not found["hole"][1] - found["neither"][1]
    assert found["hole"][0] < found["neither"][0] - 3


def test_stretching_changes_the_openness_of_a_joint() -> None:
    # A lid at 45 degrees, hinged along y, is stretched to twice its height.
    lid = {
        "limits": np.array([0.0, 0.5 * np.pi]),
        "openness": np.array(0.5),
        "axis": np.array([0.0, -1.0, 0.0]),
        "origin": np.zeros(3),
        "keypoints": np.array([[0.1, 0.3, 0.1]]),
    }
    found = _stretched_openness(lid, np.diag([1.0, 1.0, 2.0]))
    assert found == pytest.approx(np.arctan(2.0) / (0.5 * np.pi))
    assert _stretched_openness(lid, 1.7 * np.eye(3)) == pytest.approx(0.5)


def test_isolated_fixed_points_beside_the_moving_part_are_no_obstacles() -> None:
    look = look_at("box_rotate", 0.6)
    found = truth(look)
    lid = look.cloud.xyz[found.points[found.moving]]
    high = np.argsort(lid[:, 2])[-2:]
    wrong = found.moving.copy()
    wrong[np.flatnonzero(found.moving)[high]] = False

    def top(each: npt.NDArray[np.bool_]) -> float:
        parts = {body.name: body for body in scene_object("box", replace(found, moving=each), look.cloud.xyz).bodies}
        return max(float(hull[:, 2].max()) for hull in parts["box/base"].hulls)

    assert top(wrong) == pytest.approx(top(found.moving))
    # Points of the fixed part far from the moving part count, also if they are isolated.
    assert top(found.moving) > look.cloud.xyz[~look.moving][:, 2].max() - 0.01


def test_boxes_hold_their_points() -> None:
    points = rng(0, "boxes").uniform(-0.1, 0.1, (30_000, 3)).astype(np.float32)
    found = boxes(points)
    inside = [((points > box.min(0)) & (points < box.max(0))).all(1) for box in found]
    assert np.any(inside, axis=0).mean() > 0.99
    assert boxes(points[:0]) == ()


def test_boxes_parallel_to_a_wall_are_thin() -> None:
    along, up = np.meshgrid(np.arange(0.0, 0.3, 0.005), np.arange(0.0, 0.2, 0.005))
    wall = np.stack([along.ravel(), np.full(along.size, 0.003), up.ravel()], -1)
    frame = np.asarray(Rotation.from_euler("z", 0.6).as_matrix())
    turned = (wall @ frame.T).astype(np.float32)
    thin, thick = ([float(np.ptp(hull @ frame[:, 1])) for hull in boxes(turned, given)] for given in (frame, None))
    assert max(thin) == pytest.approx(0.004, abs=1e-4)
    assert max(thick) > 0.015
    corners = np.concatenate(boxes(turned, frame)) @ frame
    assert corners.min(axis=0) == pytest.approx(wall.min(axis=0) - 0.002, abs=1e-4)
    assert corners.max(axis=0) == pytest.approx(wall.max(axis=0) + 0.002, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "asset_class", "openness"), [("OpenBox", "box_rotate", 0.4), ("CloseBox", "box_rotate", 0.6)]
)
def test_true_estimates_can_be_planned_on(name: str, asset_class: str, openness: float) -> None:
    look, task, strategies = look_at(asset_class, openness), load_task(name), load_strategies(name)
    [role] = task.objects
    q = np.array(PANDA.reset_qpos)
    box = scene_object(role, truth(look), look.cloud.xyz)
    scene = planning_scene({role: box}, look.cloud.xyz[look.group == OTHER], q, PANDA)
    planner, step = StepPlanner(PANDA), task.steps[0]
    plans = [planner.plan(scene, step, parse_strategy(strategies[way], way)) for way in step.strategies]
    assert any(plan.is_solved for plan in plans), [plan.reason for plan in plans]


@pytest.mark.parametrize(
    ("asset_class", "keypoint", "expected"),
    [("drawer", 0.01, 0.03), ("drawer", 0.05, 0.05), ("toaster_press", 0.01, 0.01), ("box_rotate", 0.01, 0.01)],
)
def test_the_hand_pushes_objects_above_the_table(asset_class: str, keypoint: float, expected: float) -> None:
    """The fingers would touch the table lower down. Only joints that slide along the table need this."""
    look = look_at(asset_class, 0.5)
    found = truth(look, asset_class)
    [head, *_] = found.moving_keypoints
    at = np.append(found.keypoints[head][:2], keypoint)
    low = replace(found, keypoints={**found.keypoints, head: at})
    again = at_push_height(low, look.cloud.xyz, PANDA)
    assert again.keypoints[head] == pytest.approx([*at[:2], expected], abs=1e-6)


def test_the_hand_pushes_an_object_far_enough_below_its_top() -> None:
    """The fingers would slip over a rounded top."""
    look = look_at("toaster_move", 0.5)
    found = truth(look, "toaster_move")
    [head] = found.moving_keypoints
    top = look.cloud.xyz[found.points, 2].max()
    for depth, expected in ((0.01, 0.07), (0.09, 0.09)):
        at = np.append(found.keypoints[head][:2], top - depth)
        again = at_push_height(replace(found, keypoints={head: at}), look.cloud.xyz, PANDA)
        assert top - again.keypoints[head][2] == pytest.approx(expected, abs=1e-6)


def test_a_true_estimate_has_no_errors() -> None:
    look = look_at("box_rotate", 0.4)
    arrays = stacked([example(look, CLASSES, PANDA)])
    row = row_of(arrays, 0, truth(look))
    assert max(row["axis_degrees"], row["axis_m"], row["keypoint_m"], row["openness"], row["yaw_degrees"]) < 0.05
    assert row["part_iou"] == 1.0
    missed = row_of(arrays, 0, None)
    assert missed["missed"]
    assert missed["keypoint_m"] > 0.1
    found = figures([{**row, "class": True}, {**missed, "class": False}])
    assert (found["missed"], found["class"], found["part_iou"]) == (1, 0.5, 0.5)


def weights(folder: Path) -> bytes:
    """Return the bytes of an estimator's weights."""
    [file] = folder.glob("weights-*.safetensors")
    return file.read_bytes()


def test_an_interrupted_training_ends_with_the_same_bytes(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import gensim2.perception.estimation.training as module

    count = 0

    def fails(*given: Any) -> Any:
        nonlocal count
        count += 1
        if count == 4:
            raise InputError("stopped")
        return losses(*given)

    monkeypatch.setattr(module, "losses", fails)
    with pytest.raises(InputError, match="stopped"):
        train_estimator(tmp_path / "cut", steps=6, **SMALL)
    assert not (tmp_path / "cut" / ESTIMATOR_JSON).exists()
    monkeypatch.undo()
    with pytest.raises(InputError, match="holds a training"):
        train_estimator(tmp_path / "cut", steps=6, **SMALL)
    with pytest.raises(InputError, match="steps"):
        train_estimator(tmp_path / "cut", steps=7, resume=True, **SMALL)
    train_estimator(tmp_path / "cut", steps=6, resume=True, **SMALL)
    assert weights(tmp_path / "cut") == weights(trained)


def test_a_training_continues_from_the_weights_of_an_estimator(trained: Path, tmp_path: Path) -> None:
    other = {**SMALL, "seed": 4}
    train_estimator(tmp_path / "next", steps=1, start=trained, **other)
    train_estimator(tmp_path / "fresh", steps=1, **other)

    def away(folder: Path) -> float:
        first, last = (SceneEstimator.load(each, PANDA).network.state_dict() for each in (trained, folder))
        return float(np.mean([float((first[name] - last[name]).abs().mean()) for name in first]))

    assert away(tmp_path / "next") < 5e-3 < away(tmp_path / "fresh")


def test_a_class_can_have_more_training_objects(tmp_path: Path) -> None:
    from click.testing import CliRunner

    from gensim2.cli.perceive import perceive

    out = tmp_path / "more"
    result = train_estimator(out, steps=1, objects_of={"drawer": 2}, **SMALL)
    assert result["clouds"] == 3 * SMALL["looks"]
    with pytest.raises(InputError, match="'faucet' is not trained"):
        train_estimator(tmp_path / "other", steps=1, objects_of={"faucet": 2}, **SMALL)
    for text in ("drawer", "drawer=0", "drawer=x"):
        found = CliRunner().invoke(perceive, ["train", "--out", str(out), "--objects-of", text])
        assert found.exit_code != 0
        assert "does not contain a class and a positive count" in str(found.exception) + found.output


def test_classes_with_more_clouds_are_drawn_more_often() -> None:
    looks = [look_at("box_rotate", 0.5), *[look_at("drawer", 0.5)] * 4]
    arrays = dict(stacked([example(look, CLASSES, PANDA) for look in looks]))
    features = [np.rint(127 * features_of(look.cloud.xyz)).astype(np.int8) for look in looks]
    batch = Examples({**arrays, "features": np.stack(features)}).batch(rng(0, "share"), 300)
    # Four times as many clouds double the probability of a class.
    assert float((batch["class"] == CLASSES.index("drawer")).float().mean()) == pytest.approx(2 / 3, abs=0.08)


def test_an_estimator_is_read_as_it_was_written(trained: Path) -> None:
    estimator = SceneEstimator.load(trained, PANDA)
    assert [each.name for each in estimator.classes] == list(CLASSES)
    assert len(weights(trained)) < 10 * 2**20
    xyz = look_at("drawer", 0.5).cloud.xyz
    for each in estimator.estimate(xyz, "drawer").objects:
        assert each.asset_class == "drawer"
        assert sum(each.classes.values()) == pytest.approx(1.0, abs=1e-5)
        assert min(each.joint.openness_deviation, each.joint.origin_deviation) > 0
        assert set(each.keypoints) == set(model_of("drawer").keypoints)


def test_joint_ranges_stay_near_those_of_the_training_objects(trained: Path) -> None:
    estimator = SceneEstimator.load(trained, PANDA)
    joint = model_of("drawer").joint
    span = estimator.classes[1].span
    assert span == pytest.approx((joint.upper - joint.lower,) * 2, abs=0.06)
    estimator.network.groups.bias.data[TARGET] = 100.0
    xyz, ranges = look_at("drawer", 0.5).cloud.xyz, []
    for bounds in ((1.0, 1.0), None):
        estimator.classes = tuple(each.model_copy(update={"span": bounds}) for each in estimator.classes)
        [found] = estimator.estimate(xyz, "drawer").objects
        ranges.append(found.joint.upper - found.joint.lower)
    # The untrained network estimates a range below 0.8 m.
    assert ranges[0] == pytest.approx(0.8)
    assert ranges[1] < 0.8


@pytest.mark.parametrize("count", [0, 5, 20])
def test_a_cloud_of_few_points_shows_no_object(trained: Path, count: int) -> None:
    xyz = rng(0, "few points").uniform(-0.1, 0.1, (count, 3)).astype(np.float32)
    assert SceneEstimator.load(trained, PANDA).estimate(xyz).objects == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda record: record.update(schema_version=9), "schema_version"),
        (lambda record: record.update(sha256="0" * 64), "digest"),
        (lambda record: record.update(classes=record["classes"][:1]), "shape|must be|is "),
        (lambda record: record["classes"][0].update(frame=[[9e9] * 3] * 3), "frame"),
        (lambda record: record.update(file="../weights-0000000000000000.safetensors"), "file"),
    ],
)
def test_a_damaged_estimator_is_refused(trained: Path, tmp_path: Path, change: Any, message: str) -> None:
    for file in (ESTIMATOR_JSON, next(trained.glob("weights-*")).name):
        (tmp_path / file).write_bytes((trained / file).read_bytes())
    record = json.loads((tmp_path / ESTIMATOR_JSON).read_text())
    change(record)
    (tmp_path / ESTIMATOR_JSON).write_text(json.dumps(record))
    with pytest.raises(InputError, match=message):
        SceneEstimator.load(tmp_path, PANDA)


def test_the_commands_measure_an_estimator_and_draw_the_worst(trained: Path, tmp_path: Path) -> None:
    from click.testing import CliRunner
    from PIL import Image

    from gensim2.cli.perceive import perceive

    given = ["--assets", "builtin", "--class", "drawer", "--objects", "1", "--looks", "2"]
    written = tmp_path / "result.json"
    run = CliRunner().invoke(
        perceive,
        ["measure", str(trained), *given, "--out", str(tmp_path), "--json", str(written)],
        catch_exceptions=False,
    )
    assert run.exit_code == 0, run.output
    result = json.loads(written.read_text())
    assert (result["objects"], result["estimated"]["clouds"]) == (1, 2)
    assert list(result["classes"]) == ["drawer"]
    assert np.asarray(Image.open(tmp_path / "worst.png")).std() > 1
    unknown = CliRunner().invoke(perceive, ["measure", str(trained), "--class", "door", "--assets", "builtin"])
    assert isinstance(unknown.exception, InputError)


def test_estimates_of_an_episode_are_shown_beside_the_truth(trained: Path, tmp_path: Path) -> None:
    from PIL import Image

    asked: dict[str, Any] = {"episodes": 1, "engine": "mujoco", "assets": "builtin", "workers": 1}
    gensim2.collect(["CloseBox"], out=tmp_path / "data", **asked)
    shown = of_data_set(tmp_path / "data", None, None)
    [thing] = next(TaskStore(tmp_path / "data" / "CloseBox").rows()).objects.values()
    for index, openness in ((0, thing.openness_start), (shown.recording.steps, thing.openness_end)):
        state, q = _state(shown, _model(shown), index)
        assert state.openness == pytest.approx(openness, abs=1e-3)
        assert state.yaw == pytest.approx(thing.yaw, abs=1e-3)
        assert len(q) == len(PANDA.reset_qpos)
    written = tmp_path / "result.json"
    words = ["perceive", "show", str(tmp_path / "data"), "--estimator", str(trained), "--instants", "3"]
    assert run_command([*words, "--out", str(tmp_path / "shown"), "--json", str(written)]) == 0
    result = json.loads(written.read_text())
    assert (result["class"], result["instants"][0]["step"]) == ("box_rotate", 0)
    assert len(result["instants"]) == 3
    assert np.asarray(Image.open(result["picture"])).std() > 1
    assert run_command([*words[:2], str(tmp_path), *words[3:], "--out", str(tmp_path / "no")]) == 2


def test_calibrated_deviations_hold_two_thirds_of_the_errors(trained: Path) -> None:
    looks = list(object_looks(LIBRARY, PANDA, "drawer", "8", 6, rng(0, "calibration")))
    arrays = stacked([example(look, CLASSES, PANDA) for look in looks])
    estimator = SceneEstimator.load(trained, PANDA)
    estimator.network.groups.bias.data[TARGET] = 100.0
    found = calibrated(estimator, arrays)["within_one_deviation"]
    assert 0.5 <= found["keypoints"] <= 0.85
    again = figures(measured(estimator, arrays, given=True))
    assert again["within_one_deviation"] == found


def test_the_chain_refuses_tasks_that_it_cannot_perceive(trained: Path) -> None:
    for name in ("SecureGoldInSafe", "TurnOnFaucet"):
        with pytest.raises(InputError, match="does not know the class"):
            PerceivingChain(name, str(trained))


def test_an_object_that_is_not_there_is_not_acted_on(trained: Path) -> None:
    model = model_of("drawer")
    chain = PerceivingChain("OpenBox", str(trained))
    chain._goal.estimator.network.groups.bias.data[TARGET] = -100.0
    cameras = Cameras(PANDA, model)
    states = cameras._states(put(model, 0.5), np.array(PANDA.reset_qpos), rng(0, "test"))
    seen = Observer(PANDA, {"object": model}, ObservationSpec.of(chain.observation_spec), 0).observe(states, 0)
    chain.reset(seen, 0)
    assert chain.act(seen) is None
    assert len(chain.looks) == 1
    [event], [record] = chain.events, chain.history
    assert (event.what, event.detail) == (Cause.OBJECT_NOT_SEEN, {"class": "box_rotate"})
    assert (record.name, record.plans) == (event.step, [])


@pytest.mark.parametrize(("odds", "is_refused"), [(0.1, False), (100.0, False), (400.0, True)])
def test_an_object_of_another_class_is_refused(
    trained: Path, monkeypatch: pytest.MonkeyPatch, odds: float, is_refused: bool
) -> None:
    """The task's name makes its class likely, so only clear evidence for another class counts."""
    look = look_at("box_rotate", 0.5)
    seen = Observer(PANDA, {"object": look.placed.model}, ObservationSpec(cloud=SETTINGS), 0).observe(
        Cameras(PANDA, model_of("box_rotate"))._states(look.placed, np.array(PANDA.reset_qpos), rng(0, "test")), 0
    )
    share = 1.0 / (1.0 + odds)
    found = replace(truth(look), confidence=share, classes={"box_rotate": share, "drawer": 1.0 - share})
    chain = PerceivingChain("CloseBox", str(trained))
    monkeypatch.setattr(
        chain._goal.estimator, "estimate", lambda *_: SceneEstimate((found,), np.zeros(0, dtype=np.int64))
    )
    chain.reset(seen, 0)
    events = [(event.what, event.detail["likeliest"]) for event in chain.events]
    assert events == ([(Cause.OBJECT_NOT_SEEN, "drawer")] if is_refused else [])


def test_an_unknown_openness_counts_as_the_start_of_the_motion(trained: Path) -> None:
    """A cloud does not show how far a bag has been pushed along the table."""
    for name, start in (("CloseBox", 1.0), ("OpenBox", 0.0)):
        tracker = GoalTracker(SceneEstimator.load(trained, PANDA), {"box": "box_rotate"}, load_task(name).success)
        look = look_at("box_rotate", 0.4)
        for deviation, openness in ((0.1, 0.4), (0.4, start)):
            tracker.reset()
            seen = SceneEstimate((truth(look).at(0.4, deviation),), np.zeros(0, dtype=np.int64))
            box = tracker.articulated["box"]
            box.take_in(look.cloud.xyz, seen, tracker.rigid)
            assert box.track.found.joint.openness == openness


def test_a_step_is_done_only_beyond_the_doubt_of_the_estimate(trained: Path) -> None:
    look = look_at("box_rotate", 0.15)
    found = truth(look)
    for name, sign in (("CloseBox", 1.0), ("OpenBox", -1.0)):
        goal = GoalTracker(SceneEstimator.load(trained, PANDA), {"box": "box_rotate"}, load_task(name).success)
        goal.looks.append(SceneEstimate((found,), np.zeros(0, dtype=np.int64)))
        box = goal.articulated["box"]
        box.track = Track(found.at(0.15, 0.1), look.cloud.xyz, np.zeros(0, dtype=np.int64))
        for goal.motions, share in ((1, 1.0), (2, 0.5)):
            [openness] = goal.measurement(np.array(PANDA.reset_qpos)).openness.values()
            assert openness == pytest.approx(0.15 + sign * DISTRUST * share * 0.1)
        box.track = replace(box.track, misses=1)
        [openness] = goal.measurement(np.array(PANDA.reset_qpos)).openness.values()
        assert openness == pytest.approx(0.15 + sign * DISTRUST * 0.1)
        # The misses of a step do not count in the next step.
        goal.begin_step((), np.array(PANDA.reset_qpos))
        assert box.track.misses == 0


@pytest.mark.parametrize("is_grasped", [False, True])
def test_the_drawer_moves_a_hidden_object_in_it_unless_the_hand_has_grasped_the_object(
    trained: Path, is_grasped: bool
) -> None:
    look, none = look_at("drawer", 0.8), np.zeros(0, dtype=np.int64)
    goal = GoalTracker(SceneEstimator.load(trained, PANDA), {"drawer": "drawer", "apple": "apple"}, ())
    drawer = goal.articulated["drawer"]
    drawer.track = Track(truth(look), look.cloud.xyz, none)
    shape, T = shape_of("apple"), PANDA.T_world_base
    assert shape is not None
    inside = RigidEstimate(shape, np.ones(3), np.eye(4), 0.0, 0.0)
    points = look.cloud.xyz[look.moving] @ T[:3, :3].T + T[:3, 3]
    inside = inside.moved(0.5 * (points.min(axis=0) + points.max(axis=0)) - inside.center)
    goal.rigid.found["apple"] = inside
    goal.begin_motion()
    elsewhere = inside.moved(np.array([0.0, 0.3, 0.2]))
    if is_grasped:
        goal.hold("apple", elsewhere.T_world_object)
        goal.hold(None)
    wall = np.stack(np.meshgrid([0.5], np.arange(-0.2, 0.2, 0.01), np.arange(0.3, 0.5, 0.01)), -1).reshape(-1, 3)
    goal.rigid.take_in(wall, np.ones(len(wall), dtype=bool))
    assert goal.rigid.is_hidden("apple")
    drawer.carry(-0.1, goal.rigid)
    by = goal.rigid.found["apple"].center - inside.center
    if is_grasped:
        assert by[:2] == pytest.approx([0.0, 0.3])
    else:
        assert by == pytest.approx(-0.1 * T[:3, :3] @ truth(look).joint.axis)


@pytest.mark.parametrize(("openness", "goes_on"), [(0.0, False), (0.5, True)])
def test_the_goal_is_checked_again_after_the_retreat(
    trained: Path, monkeypatch: pytest.MonkeyPatch, openness: float, goes_on: bool
) -> None:
    """The hand covers less of the object after its retreat; then the estimate may differ."""
    look = look_at("box_rotate", openness)
    seen = Observer(PANDA, {"object": look.placed.model}, ObservationSpec(cloud=SETTINGS), 0).observe(
        Cameras(PANDA, model_of("box_rotate"))._states(look.placed, np.array(PANDA.reset_qpos), rng(0, "test")), 0
    )
    chain = PerceivingChain("CloseBox", str(trained))
    estimate = SceneEstimate((truth(look),), np.zeros(0, dtype=np.int64))
    monkeypatch.setattr(chain._goal.estimator, "estimate", lambda *_: estimate)
    chain.reset(seen, 0)
    action, resumed = np.zeros(8, dtype=np.float32), []
    monkeypatch.setattr(chain._chain, "is_finished", True)
    monkeypatch.setattr(chain._chain, "resume", lambda last, *, from_start: resumed.append((last, from_start)))
    monkeypatch.setattr(chain._chain, "act", lambda _: action if resumed or chain._last is None else None)
    assert chain.act(seen) is action
    # The controller repeats its last action while the cameras are read.
    assert chain.act(seen) is action
    assert ObservationSpec.of(chain.observation_spec).cloud is not None
    assert (chain.act(replace(seen, step=2)) is action) == goes_on
    assert [from_start for _, from_start in resumed] == [False] * goes_on
    assert len(chain.looks) == 2
    # An episode may end during a motion, so the next one may begin with an observation without a cloud.
    monkeypatch.undo()
    monkeypatch.setattr(chain._goal.estimator, "estimate", lambda *_: estimate)
    chain.reset(replace(seen, cloud=None), 0)
    assert ObservationSpec.of(chain.observation_spec).cloud is not None
    chain.act(seen)
    assert len(chain.looks) == 1


def test_the_estimator_of_the_package_knows_all_classes_and_estimates_a_new_object() -> None:
    estimator = SceneEstimator.load()
    names = [name for name in LIBRARY.classes() if LIBRARY.kind(name) == "articulated"]
    assert [each.name for each in estimator.classes] == names
    look = look_at("box_rotate", 0.5)
    [found] = estimator.estimate(look.cloud.xyz, "box_rotate").objects
    row = row_of(stacked([example(look, names, PANDA)]), 0, found)
    assert (row["axis_degrees"] < 8, row["keypoint_m"] < 0.05, row["openness"] < 0.15) == (True, True, True)


def test_benchmark_and_demo_plan_on_the_estimates_of_an_estimator(
    trained: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """An estimator after six steps is wrong about the box; the planner that gets its estimate therefore fails."""
    common = ["--engine", "mujoco", "--assets", "builtin", "--workers", "1", "--library", "none"]
    scene = ["--scene", str(trained), "--noise", "deployed"]
    written = tmp_path / "result.json"
    words = ["benchmark", "CloseBox", "TurnOnFaucet", *common, "--runs", "1", "--episodes", "1"]
    assert run_command([*words, *scene, "--out", str(tmp_path / "run"), "--json", str(written)]) == 0
    result = json.loads(written.read_text())
    [task] = result["tasks"]
    assert (task["name"], task["held_mean"]) == ("CloseBox", 0.0)
    assert "does not know the class" in result["skipped"]["TurnOnFaucet"]
    assert (result["arguments"]["scene_source"], result["arguments"]["depth_noise"]) == (str(trained), "deployed")
    capfd.readouterr()
    assert run_command(["demo", "TurnOnFaucet", *common, *scene]) == 2
    assert "does not know the class" in capfd.readouterr().err
    assert run_command([*words, *scene, "--attempts", "2"]) == 2
    assert "cannot be combined with an estimated scene" in capfd.readouterr().err
    assert run_command([*words, "--noise", "deployed"]) == 2
    assert "has no effect, because only an estimated scene" in capfd.readouterr().err


def test_an_episode_on_an_estimated_scene_can_be_viewed(trained: Path, tmp_path: Path) -> None:
    scene: dict[str, Any] = {"engine": "mujoco", "assets": "builtin"}
    found = of_task("CloseBox", 0, scene_source=str(trained), **scene)
    assert (found.plans, found.recording.steps > 0) == ((), True)
    assert len(of_task("CloseBox", 0, **scene).plans) == 1
    with pytest.raises(InputError, match="cannot be read"):
        of_task("CloseBox", 0, scene_source=str(tmp_path), **scene)


def test_what_plans_on_the_true_scene_refuses_an_estimated_one(tmp_path: Path) -> None:
    asked: dict[str, Any] = {"assets": "builtin", "scene_source": "estimator"}
    for call in (
        lambda: gensim2.solve("CloseBox", **asked),
        lambda: gensim2.collect(["CloseBox"], episodes=1, out=tmp_path / "data", **asked),
        lambda: gensim2.run_pipeline(target_task="CloseBox", out=tmp_path / "out", **asked),
    ):
        with pytest.raises(InputError, match="scene_source: is an option of benchmark, demo and view only"):
            call()


def test_a_moved_estimator_and_a_changed_noise_are_told_apart(trained: Path, tmp_path: Path) -> None:
    moved, noise = shutil.copytree(trained, tmp_path / "moved"), tmp_path / "noise.yaml"
    noise.write_text("a: 1")

    def digest(estimator: Path) -> str:
        given = {"task": "CloseBox", "estimator": str(estimator), "noise": str(noise)}
        return ControllerSpec(PERCEIVING, given).digest

    first = digest(trained)
    assert digest(moved) == first
    noise.write_text("a: 2")
    assert digest(moved) != first


def bucket(angle: float, yaw: float) -> tuple[npt.NDArray[np.float32], Array]:
    """Return points of a round bucket with a bail (N, 3), m, and the middle of the bail's arch."""
    draw = rng(0, "bucket")
    around, height = draw.uniform(-np.pi, np.pi, 700), draw.uniform(0.0, 0.2, 700)
    wall = np.stack([0.1 * np.cos(around), 0.1 * np.sin(around), height], axis=1)
    along = np.linspace(0.0, np.pi, 40)
    tilt = Rotation.from_rotvec([angle, 0.0, 0.0]).as_matrix()
    arch = np.stack([0.1 * np.cos(along), np.zeros(40), 0.12 * np.sin(along)], axis=1) @ tilt.T + [0.0, 0.0, 0.19]
    turn = Rotation.from_euler("z", yaw).as_matrix()
    middle = tilt @ [0.0, 0.0, 0.12] + [0.0, 0.0, 0.19]
    return (np.concatenate([wall, arch]) @ turn.T).astype(np.float32), turn @ middle


@pytest.mark.parametrize("angle", [-1.0, -0.3, 0.2, 0.9])
@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_the_bail_of_a_bucket_is_measured(angle: float, yaw: float) -> None:
    points, middle = bucket(angle, yaw)
    axis = Rotation.from_euler("z", yaw).apply([1.0, 0.0, 0.0])
    off = Rotation.from_euler("z", 0.4).apply(axis)
    found = raised_bail(points, off, np.array([0.02, 0.03, 0.19]))
    assert found is not None
    assert np.degrees(np.arccos(found.axis @ axis)) < 3.0
    assert found.angle == pytest.approx(angle, abs=0.06)
    assert np.linalg.norm(found.middle - middle) < 0.012
    assert not found.points[:700].any()
    assert np.linalg.norm(found.origin[:2]) < 0.015
    # The opposite direction of the estimated axis gives the opposite angle.
    opposite = raised_bail(points, -off, np.array([0.0, 0.0, 0.19]))
    assert opposite is not None
    assert opposite.angle == pytest.approx(-angle, abs=0.06)


def test_a_bail_on_the_rim_is_not_measured() -> None:
    points, _ = bucket(1.5, 0.3)
    assert raised_bail(points, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.19])) is None
    assert raised_bail(points[:700], np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.19])) is None


def test_only_buckets_and_bags_have_bails() -> None:
    assert {each.name for each in SceneEstimator.load().classes if each.is_bail} == {"bucket_swing", "bag_swing"}


def test_a_raised_bail_shows_a_bucket_whatever_the_network_says() -> None:
    """The network takes some real buckets for trash cans."""
    [kind] = [each for each in SceneEstimator.load().classes if each.name == "bucket_swing"]
    found = truth(look_at("bucket_swing", 0.5), "bucket_swing")
    found = replace(found, classes={"bucket_swing": 0.003, "trash_can": 0.987})
    for angle, is_absent in ((0.2, False), (1.5, True)):
        points, _ = bucket(angle, 0.0)
        seen = replace(
            found,
            points=np.arange(len(points)),
            joint=replace(found.joint, axis=np.array([1.0, 0.0, 0.0]), origin=np.array([0.0, 0.0, 0.19])),
        )
        assert (why_absent(seen, points, kind) is not None) == is_absent
