"""The grasp benchmark: objects are lifted in physics, and an object that stays on the table is a failure."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.robots import robot

pytest.importorskip("mani_skill")

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def benchmark() -> Iterator[Any]:
    sys.path.insert(0, str(BENCHMARKS))
    import grasps

    yield grasps
    sys.path.remove(str(BENCHMARKS))


def test_objects_are_lifted_and_held(benchmark: Any, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--objects", "rubiks_cube", "bowl", "banana", "--poses", "2", "--seed", "5", "--workers", "0"]
    assert benchmark.main(arguments) == 0
    out = capsys.readouterr().out
    assert "| bowl | 2/2 |" in out
    assert "held: 6 of 6, 1.000 (" in out


def test_an_object_that_is_not_held_is_counted(benchmark: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    # Open fingers lift nothing.
    monkeypatch.setattr(benchmark, "press", lambda profile: profile.gripper.open)
    result = benchmark.lift("panda", "rubiks_cube", 5, 0)
    assert result["cause"] == "missed"
    assert result["raised"] < 0.01


def test_poses_are_seeded_and_within_reach(benchmark: Any) -> None:
    poses = np.array([benchmark.draw_pose(robot("panda"), "mug", 0, i) for i in range(50)])
    again = np.array([benchmark.draw_pose(robot("panda"), "mug", 0, i) for i in range(50)])
    np.testing.assert_array_equal(poses, again)
    distance = np.hypot(poses[:, 0] - robot("panda").base_position[0], poses[:, 1])
    assert distance.min() >= 0.4
    assert distance.max() <= 0.65
    assert np.ptp(poses[:, 2]) > 5
