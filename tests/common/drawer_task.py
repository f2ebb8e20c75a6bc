"""A task of four steps with one strategy each: open a drawer, take a ball, put it in, close the drawer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from constraints import point_to_point, pointing_down

from gensim2.tasks.spec import TaskSpec

OPEN_DRAWER = Path(__file__).parent / "open_drawer"
"""Folder of a task with one step and one strategy: pull a drawer open by its handle."""

TASK = TaskSpec.model_validate(
    {
        "name": "PutBallIntoDrawer",
        "description": "",
        "objects": {"drawer": {"class": "drawer"}, "ball": {"class": "golf_ball"}},
        "steps": [
            {
                "name": "open",
                "object": "drawer",
                "strategies": ["open"],
                "done": [{"type": "articulated_open", "object": "drawer"}],
            },
            {"name": "grasp", "object": "ball", "strategies": ["grasp"]},
            {
                "name": "place",
                "object": "drawer",
                "tool": "ball",
                "strategies": ["place"],
                "done": [{"type": "distance_articulated_rigidbody", "articulated": "drawer", "rigid": "ball"}],
            },
            {
                "name": "close",
                "object": "drawer",
                "strategies": ["close"],
                "done": [{"type": "articulated_closed", "object": "drawer"}],
            },
        ],
        "goal": [
            {"type": "distance_articulated_rigidbody", "articulated": "drawer", "rigid": "ball"},
            {"type": "articulated_closed", "object": "drawer"},
        ],
        "max_episode_steps": 1200,
    }
)


def _point(tool: str, target: str, offset: list[float], tolerance: float) -> dict[str, Any]:
    return point_to_point(tool, target, tolerance, target_offset=offset)


STRATEGIES: dict[str, dict[str, Any]] = {
    "open": {
        "constraint_list": [_point("tool_head", "articulated_object_head", [0.0, 0.0, 0.0], 0.001), pointing_down(0.1)],
        "pre_actuation_motions": [["translate_z", -0.1]],
        "post_actuation_motions": [["follow_joint_to", 1.0]],
        "gripper": "grasp",
        "let_go": 0.06,
    },
    "grasp": {"grasp": "antipodal"},
    "place": {
        "constraint_list": [
            _point("rigidbody_object_head", "articulated_object_inside", [0.0, 0.0, 0.02], 0.028),
            pointing_down(0.6),
        ],
        "pre_actuation_motions": ["move-up"],
        "gripper": "release",
        "let_go": 0.08,
    },
    "close": {
        "constraint_list": [_point("tool_head", "articulated_object_head", [0.0, 0.0, 0.0], 0.001), pointing_down(0.6)],
        "pre_actuation_motions": [["translate_z", -0.1]],
        "post_actuation_motions": [["follow_joint_to", 0.0]],
        "gripper": "closed",
        "let_go": 0.06,
    },
}
