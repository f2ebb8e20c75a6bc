"""Objects in the format of the released ones, written for the tests."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

CUBE = """mtllib {name}.mtl
usemtl paint
v {x0} {y0} {z0}
v {x1} {y0} {z0}
v {x1} {y1} {z0}
v {x0} {y1} {z0}
v {x0} {y0} {z1}
v {x1} {y0} {z1}
v {x1} {y1} {z1}
v {x0} {y1} {z1}
f 1 4 3 2
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""


def write_cube(folder: Path, name: str, low: tuple[float, float, float], high: tuple[float, float, float]) -> None:
    """Write a box as OBJ + MTL."""
    corners = {f"{axis}{i}": v[k] for k, axis in enumerate("xyz") for i, v in enumerate((low, high))}
    (folder / f"{name}.obj").write_text(CUBE.format(name=name, **corners))
    (folder / f"{name}.mtl").write_text("newmtl paint\nKd 0.2 0.4 0.6\nd 1\n")


def write_chest(folder: Path, **info: object) -> Path:
    """Write an object like the released ones: a body of five boards, a lid hinged at the back, no effort limits."""
    meshes = folder / "textured_objs"
    meshes.mkdir(parents=True)
    boards = {
        "floor": ((-0.5, -0.3, -0.4), (0.5, -0.25, 0.4)),
        "left": ((-0.5, -0.25, -0.4), (-0.45, 0.2, 0.4)),
        "right": ((0.45, -0.25, -0.4), (0.5, 0.2, 0.4)),
        "back": ((-0.45, -0.25, -0.4), (0.45, 0.2, -0.35)),
        "front": ((-0.45, -0.25, 0.35), (0.45, 0.2, 0.4)),
        "lid": ((-0.5, 0.2, -0.4), (0.5, 0.25, 0.4)),
    }
    for name, (low, high) in boards.items():
        write_cube(meshes, name, low, high)

    def element(kind: str, name: str, shift: str = "0 0 0") -> str:
        return (
            f'<{kind}><origin xyz="{shift}"/><geometry><mesh filename="textured_objs/{name}.obj"/></geometry></{kind}>'
        )

    body = "".join(element(k, n) for n in boards if n != "lid" for k in ("visual", "collision"))
    lid = "".join(element(k, "lid", "0 -0.2 0.4") for k in ("visual", "collision"))
    (folder / "mobility.urdf").write_text(
        '<?xml version="1.0"?><robot name="chest"><link name="base"/>'
        f'<link name="link_0">{lid}</link><link name="link_1">{body}</link>'
        '<joint name="joint_0" type="revolute"><origin xyz="0 0.2 -0.4"/><axis xyz="-1 0 0"/>'
        '<child link="link_0"/><parent link="link_1"/><limit lower="0" upper="2"/></joint>'
        '<joint name="joint_1" type="fixed"><origin rpy="1.570796326794897 0 -1.570796326794897" xyz="0 0 0"/>'
        '<child link="link_1"/><parent link="base"/></joint></robot>'
    )
    value: dict[str, object] = {
        "scale": 0.25,
        "keypoints": {
            "articulated_object_head": [0.0, 0.25, 0.4],
            "articulated_object_tail": [0.0, 0.2, -0.4],
            "articulated_object_inside_base": [-0.1, 0.0, 0.4],
        },
        "keypoint_descriptions": {"articulated_object_head": "the edge"},
        "axis": "x",
        "joint_position_range": [0.0, 1.5],
    }
    value.update(info)
    (folder / "info.json").write_text(json.dumps({k: v for k, v in value.items() if v is not None}))
    return folder


@pytest.fixture(scope="session")
def chest() -> Callable[..., Path]:
    """Return the writer of such an object: ``chest(folder, **info)``."""
    return write_chest


@pytest.fixture(scope="session")
def cube() -> Callable[..., None]:
    """Return the writer of a box as OBJ + MTL: ``cube(folder, name, low, high)``."""
    return write_cube
