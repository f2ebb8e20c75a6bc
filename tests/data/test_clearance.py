"""Clearances of motions with distances known from the sizes of boxes, for a robot with three prismatic axes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gensim2.data.clearance import FARTHEST, ClearanceMeter
from gensim2.objects import open_library
from gensim2.robots import RobotProfile, robot
from gensim2.robots.profile import RobotFiles
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec

POST, BLOCK = (0.03, 0.03, 0.03), (0.015, 0.015, 0.04)
"""Half lengths, m."""
HOLDING, OPEN = 0.015, 0.03
"""Half lengths of each finger, m."""
UP = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def _link(name: str, size: str, at: str) -> str:
    box = f'<collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></collision>' if size else ""
    return f'<link name="{name}">{box}</link>'


def _slide(name: str, parent: str, child: str, axis: str) -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
    return f'<joint name="{name}" type="prismatic">{ends}<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'


@pytest.fixture
def gantry(tmp_path: Path) -> RobotProfile:
    """Return a robot with a cubic hand of 4 cm at (q0, q1, q2) and below it two fingers of 1 x 1 x 4 cm along z. The
    inner faces are at y = q3 and y = -q4, the tips 6 cm below the middle of the hand.
    """
    (tmp_path / "gantry.urdf").write_text(
        '<robot name="gantry"><link name="base"/><link name="rail"/><link name="bridge"/>'
        + _link("palm", "0.04 0.04 0.04", "0 0 0")
        + _link("left", "0.01 0.01 0.04", "0 0.005 -0.04")
        + _link("right", "0.01 0.01 0.04", "0 -0.005 -0.04")
        + _slide("x", "base", "rail", "1 0 0")
        + _slide("y", "rail", "bridge", "0 1 0")
        + _slide("z", "bridge", "palm", "0 0 1")
        + _slide("l", "palm", "left", "0 1 0")
        + _slide("r", "palm", "right", "0 -1 0")
        + "</robot>"
    )
    pairs = (("palm", "left"), ("palm", "right"), ("left", "right"))
    lines = "".join(f'<disable_collisions link1="{a}" link2="{b}" reason="Never"/>' for a, b in pairs)
    (tmp_path / "gantry.srdf").write_text(f'<robot name="gantry">{lines}</robot>')
    panda = robot("panda")
    return replace(
        panda,
        name="gantry",
        simulation=replace(panda.simulation, agent="gantry"),
        files=lambda: RobotFiles(tmp_path / "gantry.urdf", tmp_path / "gantry.srdf"),
        hand_link="palm",
        arm_joints=("x", "y", "z"),
        gripper=replace(
            panda.gripper, joints=("l", "r"), fingers=("l", "r"), driven=("l", "r"), pads=("left", "right")
        ),
        base_position=(-0.1, 0.0, 0.0),
    )


class Shelf:
    """A library of two boxes and a generated drawer."""

    def kind(self, asset_class: str) -> str:
        return "articulated" if asset_class == "drawer" else "rigid"

    def load(self, asset_class: str, instance: str, hulls: str = "default") -> Any:
        if asset_class == "drawer":
            return open_library("builtin").load(asset_class, instance)
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 3)
        return SimpleNamespace(hulls={"body": (signs * np.array({"post": POST, "block": BLOCK}[asset_class]),)})


def _task(on: str = "table", other: str = "post") -> TaskSpec:
    return parse_task(
        {
            "schema_version": 2,
            "name": "LiftBlock",
            "description": "lift the block",
            "objects": {other: {"class": other}, "block": {"class": "block", "place": {"on": on}}},
            "steps": [{"name": "lift", "object": "block", "strategies": ["lift"]}],
            "goal": [{"type": "rigidbody_lifted", "rigid": "block"}],
        },
        "task.yaml",
    )


def _measured(profile: RobotProfile, task: TaskSpec, q: Any, **states: Any) -> Any:
    """Return the clearance for joints ``q`` (T, 5) and objects at poses (7,) or (T, 7) in the world."""
    joints = np.asarray(q, dtype=np.float64)

    def rows(poses: Any, *columns: Any) -> Any:
        start = np.concatenate([np.broadcast_to(poses, (len(joints), 7)), np.zeros((len(joints), 6))], axis=1)
        return np.concatenate([start, *columns], axis=1).astype(np.float32)

    articulations = {"gantry": rows(UP, joints, np.zeros_like(joints))}
    if "drawer" in states:
        pose, travel = states.pop("drawer")
        articulations["drawer"] = rows(pose, np.asarray(travel)[:, None], np.zeros((len(joints), 1)))
    env_states = {"articulations": articulations, "actors": {name: rows(pose) for name, pose in states.items()}}
    recording: Any = SimpleNamespace(env_states=env_states, instances=dict.fromkeys(task.objects, "0"))
    return ClearanceMeter(profile, task, Shelf()).of(recording)  # type: ignore[arg-type]


def _at(x: float, y: float, z: float) -> Any:
    return np.array([x, y, z, 1.0, 0.0, 0.0, 0.0])


FAR = _at(0.0, 0.6, 0.03)


def test_the_table_is_as_near_as_the_lowest_finger_tip(gantry: RobotProfile) -> None:
    q = [[0.3, 0.0, height, OPEN, OPEN] for height in (0.5, 0.16, 0.1, 0.3)]
    found = _measured(gantry, _task(), q, post=FAR, block=FAR)
    assert (found.distance, found.to) == (pytest.approx(0.04, abs=1e-6), "table")


def test_what_a_step_acts_on_may_be_touched_and_what_none_acts_on_counts_where_it_is_by_then(
    gantry: RobotProfile,
) -> None:
    q = [[x, 0.0, 0.36, OPEN, OPEN] for x in (0.1, 0.2, 0.3)]
    post = [_at(0.4, 0.0, 0.36), _at(0.4, 0.0, 0.36), _at(0.35, 0.0, 0.36)]  # the post approaches like the robot
    found = _measured(gantry, _task(), q, post=post, block=_at(0.2, 0.0, 0.36))  # world = base - 0.1 in x
    assert (found.distance, found.to) == (pytest.approx(0.35 - 0.2 - 0.03 - 0.02, abs=1e-6), "post")
    assert _measured(gantry, _task(), q, post=FAR, block=_at(0.2, 0.0, 0.36)).distance == FARTHEST


@pytest.mark.parametrize(
    ("fingers", "on", "gap"), [(HOLDING, "table", 0.05), (OPEN, "table", 0.08), (HOLDING, "post", 0.08)]
)
def test_what_both_fingers_touch_is_a_part_of_the_hand(
    gantry: RobotProfile, fingers: float, on: str, gap: float
) -> None:
    """The block ends 3 cm below the fingertips, 5 cm above the post, on which it may have stood."""
    q = [[0.3, 0.0, 0.2, fingers, fingers], [0.5, 0.0, 0.2, fingers, fingers]]
    post, block = _at(0.4, 0.0, 0.03), [_at(x, 0.0, 0.15) for x in (0.2, 0.4)]
    found = _measured(gantry, _task(on), q, post=post, block=block)
    assert (found.distance, found.to) == (pytest.approx(gap, abs=1e-6), "post")


def test_a_held_block_is_meant_to_reach_the_table(gantry: RobotProfile) -> None:
    q = [[0.3, 0.0, 0.09, HOLDING, HOLDING]]
    found = _measured(gantry, _task(), q, post=FAR, block=_at(0.2, 0.0, 0.04))
    assert (found.distance, found.to) == (pytest.approx(0.03, abs=1e-6), "table")


def test_a_drawer_that_comes_out_towards_the_hand_is_nearer_by_its_travel(gantry: RobotProfile) -> None:
    joint = (drawer := open_library("builtin").load("drawer", "0")).joint
    assert joint is not None
    head = joint.T_root_child @ np.append(drawer.keypoints["articulated_object_head"].position, 1.0)
    turn = -np.arctan2(joint.axis[1], joint.axis[0])  # the drawer opens along x, towards the hand
    pose = np.array([-0.4, 0.0, 0.3, np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
    q = [[0.0, 0.0, 0.3 + head[2], OPEN, OPEN]] * 2
    shut, out = (
        _measured(gantry, _task(other="drawer"), q, block=FAR, drawer=(pose, travel))
        for travel in ([0.0, 0.0], [0.0, 0.03])
    )
    assert (shut.to, out.to) == ("drawer", "drawer")
    assert 0.03 < shut.distance < FARTHEST
    assert out.distance == pytest.approx(shut.distance - 0.03, abs=1e-6)
