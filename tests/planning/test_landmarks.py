"""Points that strategies may name: the floor below a keypoint, and where a rigid object stood at the start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from tests.common.table_scenes import resting, table_scene

from gensim2.objects import open_library
from gensim2.planning.landmarks import UPRIGHT, UPRIGHT_HEIGHT, floor
from gensim2.planning.scene import JointState, Scene, SceneBody, SceneObject
from gensim2.planning.world import PlanningWorld
from gensim2.robots import RobotProfile, robot

Array = npt.NDArray[np.float64]


def slab(low: float, high: float, begin: float = -0.1) -> Array:
    return np.array([[x, y, z] for x in (begin, 0.1) for y in (-0.1, 0.1) for z in (low, high)])


def half(hull: Array) -> Array:
    return hull * [1.0, 0.5, 1.0] + [0.0, 0.04, 0.0]


def wall(low: float, high: float) -> Array:
    return slab(low, high) * [0.1, 1.0, 1.0] - [0.03, 0.0, 0.0]


def scene_with(*hulls: Array, keypoint: float) -> Scene:
    """Return a scene with the Panda and a body of these hulls, whose last keypoint has the given height above the
    table.
    """
    empty = table_scene({})
    pose = np.linalg.inv(empty.T_world_base)
    pose[:3, 3] += 0.3, 0.0, 0.0
    joint = JointState("revolute", pose[:3, 3], np.array([0.0, 0.0, 1.0]), 0.0, 0.0, 1.0, ())
    points = {
        "articulated_object_head": pose[:3, 3],
        "articulated_object_inside_base": pose[:3, 3] + [0.0, 0.0, keypoint],
    }
    thing = SceneObject("cabinet", (SceneBody("cabinet/body", hulls, pose),), pose, points, joint)
    return replace(empty, objects={"cabinet": thing})


def height(scene: Scene) -> float:
    return float((scene.T_world_base @ np.append(floor(scene, "cabinet"), 1.0))[2])


@pytest.mark.parametrize(
    ("hulls", "keypoint", "expected"),
    [
        ((slab(0.0, 0.02),), 0.15, 0.02),
        ((slab(0.0, 0.02), slab(0.10, 0.105)), 0.15, 0.105),  # a shelf
        ((slab(0.0, 0.02), slab(0.10, 0.105), slab(0.12, 0.14)), 0.11, 0.02),  # no room on the shelf
        ((slab(0.0, 0.02), slab(0.10, 0.105)), 0.102, 0.105),  # keypoint slightly inside the shelf
        ((slab(0.0, 0.02), slab(0.30, 0.32)), 0.15, 0.02),  # the ceiling is no floor
        ((slab(0.30, 0.32),), 0.15, 0.0),  # only the table
        ((slab(0.0, 0.02), slab(0.10, 0.105, begin=-0.05)), 0.15, 0.105),  # a shelf of some depth
        ((slab(0.0, 0.02), half(slab(0.10, 0.105, begin=-0.01))), 0.15, 0.02),  # its corner
        ((slab(0.0, 0.02), half(slab(0.10, 0.105, begin=-0.01)), wall(0.10, 0.2)), 0.15, 0.105),  # a wall on one side
    ],
)
def test_the_floor_is_the_highest_surface_below_with_room_above(
    hulls: tuple[Array, ...], keypoint: float, expected: float
) -> None:
    assert height(scene_with(*hulls, keypoint=keypoint)) == pytest.approx(expected, abs=1e-6)


def test_what_is_held_knows_how_it_stood(panda: RobotProfile) -> None:
    scene = table_scene({"mug": resting(open_library("builtin").load_rigid("mug"), 0.0, 0.0, 0.4)})
    world = PlanningWorld(panda)
    points = world.of(replace(scene, held="mug")).tool_keypoints
    T_base_hand = panda.model.forward_kinematics(scene.q)
    way = T_base_hand[:3, :3] @ (points[f"mug/{UPRIGHT}"] - points["mug/rigidbody_object_head"])
    np.testing.assert_allclose(way, [0.0, 0.0, UPRIGHT_HEIGHT], atol=1e-9)


@pytest.fixture(scope="module")
def panda() -> RobotProfile:
    return robot("panda")
