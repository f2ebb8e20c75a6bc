"""ManiSkill's Panda as the planner sees it: its URDF, its collision pairs, its tool keypoints."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.errors import MissingExtraError

Array = npt.NDArray[np.float64]

#: Points of the Franka hand with its own fingers, (3,) metres in the hand frame.
TOOL_KEYPOINTS: dict[str, Array] = {
    "tool_head": np.array([0.0, 0.0, 0.105]),
    "tool_tail": np.array([0.0, 0.0, 0.075]),
    "tool_side": np.array([0.0, 0.053, 0.105]),
}

#: What a person or a language model is told about them.
TOOL_KEYPOINT_DESCRIPTIONS: dict[str, str] = {
    "tool_head": "the middle point between the two finger tips",
    "tool_tail": "the middle point between the two finger bases",
    "tool_side": "the tip of the right finger",
}

#: Finger joint value of the fully open gripper, metres.
FINGER_OPEN = 0.04


def panda_folder() -> Path:
    """Return the folder of ManiSkill's Panda model.

    Raises:
        MissingExtraError: ManiSkill is not installed.
    """
    spec = importlib.util.find_spec("mani_skill")
    if spec is None or not spec.submodule_search_locations:
        raise MissingExtraError("mani_skill", "sim")
    return Path(spec.submodule_search_locations[0]) / "assets" / "robots" / "panda"


@cache
def panda() -> kpam.Robot:
    """Return ManiSkill's Panda, loaded once a process."""
    folder = panda_folder()
    return kpam.Robot.from_urdf(folder / "panda_v2.urdf", hand_link="panda_hand", srdf=folder / "panda_v2.srdf")
