"""A Panda, and a small scene: a box on a table, whose lid turns about a hinge."""

from __future__ import annotations

from typing import Any

import numpy as np
from constraints import parallel, point_to_point

import gensim2_kpam as kpam

Q_START = np.array([0.0, -0.32, 0.0, -2.61799, 0.0, 2.23, 0.785398, 0.04, 0.04])
#: The planner's options for a Panda.
PANDA: dict[str, Any] = {
    "limits": "panda",
    "joint_weights": [10.0] + [1.0] * 8,
    "workspace": [[0.05, -1.0, 0.0], [1.0, 1.0, 1.0]],
}
TOOL = {"tool_head": [0.0, 0.0, 0.105], "tool_tail": [0.0, 0.0, 0.075], "tool_side": [0.0, 0.053, 0.105]}


def config(**changes: Any) -> dict[str, Any]:
    """Return a config that reaches for the lid's edge from above and then moves along the lid's joint."""
    out: dict[str, Any] = {
        "constraint_list": [
            point_to_point("tool_head", "edge", 0.001),
            parallel("tool_head", "tool_tail", [0, 0, 1], 0.02),
            parallel("tool_head", "tool_side", [0, 1, 0], 0.02),
        ],
        "pre_actuation_motions": [["translate_z", -0.1]],
        "post_actuation_motions": [["translate_z", -0.05], "move-up"],
    }
    out.update(changes)
    return out


def table() -> kpam.Body:
    pose = np.eye(4)
    pose[:3, 3] = [0.615, 0.0, -0.025]
    return kpam.Body("table", "table", [kpam.Shape.box([0.65, 0.65, 0.025])], pose)


def problem(panda: kpam.Robot, **changes: Any) -> kpam.KeypointProblem:
    """Return the scene's problem; ``changes`` replace arguments, and its options those of the Panda."""
    arguments: dict[str, Any] = {
        "config": config(),
        "q_start": Q_START,
        "tool_keypoints": TOOL,
        "object_keypoints": {"edge": [0.5, 0.1, 0.2], "inside": [0.5, 0.1, 0.05]},
        "T_base_object": np.eye(4),
        "joint": kpam.Joint("revolute", [0.5, 0.3, 0.1], [1.0, 0.0, 0.0], 0.2, 0.0, 1.5),
        "bodies": [table()],
        "options": {},
    }
    arguments.update(changes)
    if "panda_joint1" in panda.joint_names:
        arguments["options"] = {**PANDA, **arguments["options"]}
    settings = kpam.SolverConfig(arguments.pop("config"))
    return kpam.KeypointProblem(panda, settings, arguments.pop("q_start"), **arguments)
