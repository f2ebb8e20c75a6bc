"""ManiSkill's Panda."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

import gensim2_kpam as kpam


def panda_folder() -> Path:
    """Return the folder of robots in ManiSkill's wheel."""
    spec = importlib.util.find_spec("mani_skill")
    if spec is None or not spec.submodule_search_locations:
        pytest.skip("needs mani_skill, whose wheel holds the Panda")
    return Path(next(iter(spec.submodule_search_locations))) / "assets" / "robots"


@pytest.fixture(scope="session")
def robots() -> Path:
    return panda_folder()


@pytest.fixture(scope="session")
def panda(robots: Path) -> kpam.Robot:
    folder = robots / "panda"
    return kpam.Robot.from_urdf(folder / "panda_v2.urdf", hand_link="panda_hand", srdf=folder / "panda_v2.srdf")
