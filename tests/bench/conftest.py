"""Problem files and a folder with one object for the benchmark tests: a cabinet with a door, made of boxes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

DOOR_ANGLE = 0.6
Q_CURRENT = [0.0, -0.32, 0.0, -2.61799, 0.0, 2.23, 0.785398, 0.04, 0.04]

URDF = """<robot name="cabinet">
  <link name="base"/>
  <link name="body"><collision><origin xyz="0 0 0"/>
    <geometry><mesh filename="textured_objs/body.obj"/></geometry></collision></link>
  <joint name="fixed" type="fixed"><parent link="base"/><child link="body"/><origin xyz="0 0 0.5" rpy="0 0 0"/></joint>
  <link name="door"><collision><origin xyz="0 0.5 0"/>
    <geometry><mesh filename="textured_objs/door.obj"/></geometry></collision></link>
  <joint name="hinge" type="revolute"><parent link="body"/><child link="door"/>
    <origin xyz="-0.55 -0.5 0"/><axis xyz="0 0 1"/><limit lower="0" upper="1.5"/></joint>
</robot>
"""


def box_obj(size: tuple[float, float, float], offset: int = 0) -> str:
    """Return a box as OBJ text whose vertex indices start after ``offset``."""
    corners = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    quads = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    vertices = [f"v {x * size[0]} {y * size[1]} {z * size[2]}" for x, y, z in corners]
    return "\n".join([*vertices, *("f " + " ".join(str(i + offset) for i in quad) for quad in quads)]) + "\n"


@pytest.fixture(scope="session")
def assets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("assets")
    instance = folder / "articulated_objs" / "cabinet" / "1"
    (instance / "textured_objs").mkdir(parents=True)
    (instance / "mobility.urdf").write_text(URDF)
    (instance / "textured_objs" / "body.obj").write_text(box_obj((1.0, 1.0, 1.0)))
    (instance / "textured_objs" / "door.obj").write_text(box_obj((0.1, 1.0, 1.0)))
    return folder


def make_problem() -> dict[str, Any]:
    """Return a problem in which closed fingertips push the half-open door shut along the base's x axis and then
    retreat.
    """
    scale, root = 0.3, np.array([0.05, 0.0, 0.0])
    base = np.array([-0.615, 0.0, 0.0])
    hinge = root + scale * np.array([-0.55, -0.5, 0.5]) - base
    c, s = np.cos(DOOR_ANGLE), np.sin(DOOR_ANGLE)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    T_base_object = np.eye(4)
    T_base_object[:3, :3], T_base_object[:3, 3] = turn, hinge
    point = hinge + turn @ np.array([-0.05 * scale, 0.8 * scale, 0.2 * scale])
    constraints = [
        {
            "type": "point2point_constraint",
            "keypoint_name": "tool_head",
            "target_keypoint_name": "articulated_object_head",
            "tolerance": 1e-4,
        },
        {
            "type": "frame_axis_parallel",
            "axis_from_keypoint_name": "tool_tail",
            "axis_to_keypoint_name": "tool_head",
            "target_axis": [0, 0, 1.0],
            "target_axis_frame": "world",
            "target_inner_product": -1,
            "tolerance": 0.01,
        },
    ]
    return {
        "id": "CloseCabinet/0",
        "task": "CloseCabinet",
        "objects": {
            "articulated": {
                "cls": "cabinet",
                "id": "1",
                "root_p": root.tolist(),
                "root_q": [1.0, 0.0, 0.0, 0.0],
                "qpos": [DOOR_ANGLE],
                "close_qpos": 0.0,
                "open_qpos": 1.5,
                "scale": scale,
            }
        },
        "config": {
            "task_name": "CloseCabinet",
            "category_name": "Articulated",
            "tool_keypoint_name_list": ["tool_head", "tool_tail", "tool_side"],
            "object_keypoint_name_list": ["articulated_object_head"],
            "constraint_list": constraints,
            "pre_actuation_motions": [["translate_z", -0.08], ["translate_z", -0.05]],
            "post_actuation_motions": ["move-left", ["translate_z", -0.05]],
        },
        "start_time": 0,
        "actuation_time": 24,
        "pre_actuation_times": [16, 20],
        "post_actuation_times": [28, 32],
        "q_current": list(Q_CURRENT),
        "T_world_base": [[1, 0, 0, -0.615], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        "T_base_object": T_base_object.tolist(),
        "tool_keypoints_hand": {
            "tool_head": [0.0, 0.0, 0.105],
            "tool_tail": [0.0, 0.0, 0.075],
            "tool_side": [0.0, 0.045, 0.105],
        },
        "object_keypoints_base": {"articulated_object_head": point.tolist()},
        "object_yaw": 0.2,
        "object_axis": "z",
    }


@pytest.fixture
def problem() -> dict[str, Any]:
    """Return a problem as a dictionary that a test may change."""
    return make_problem()


@pytest.fixture(scope="session")
def problem_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with two problems, of which the second has its door out of reach."""
    far = make_problem()
    far["id"] = "CloseCabinet/far"
    far["object_keypoints_base"]["articulated_object_head"] = [1.6, 0.0, 0.3]
    path = tmp_path_factory.mktemp("problems") / "problems.jsonl"
    path.write_text("".join(json.dumps(each) + "\n" for each in (make_problem(), far)))
    return path


@pytest.fixture
def peers() -> None:
    """Skip the test if the independent libraries are not installed."""
    pytest.importorskip("coal")
    pytest.importorskip("pinocchio")
