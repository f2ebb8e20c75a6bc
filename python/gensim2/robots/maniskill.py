"""Locate the robot models that ManiSkill ships."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from gensim2.core.errors import MissingExtraError


def robot_folder(name: str) -> Path:
    """Return the folder of one of ManiSkill's robot models, without importing ManiSkill.

    Raises:
        MissingExtraError: ManiSkill is not installed.

    Example:
        ```python
        print(robot_folder("panda") / "panda_v2.urdf")
        ```
    """
    spec = importlib.util.find_spec("mani_skill")
    if spec is None or not spec.submodule_search_locations:
        raise MissingExtraError("mani_skill", "sim")
    return Path(spec.submodule_search_locations[0]) / "assets" / "robots" / name
