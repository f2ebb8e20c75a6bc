"""The benchmark of base poses: the Panda reaches its scenes from its own base, and nothing from 3 m away."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("mujoco")

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_scenes_are_planned_from_the_base_of_the_profile_only(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import base_pose

    base_pose.main(["--robot", "panda", "--x", "-0.615", "-3.0", "--tasks", "CloseBox", "OpenSafe", "--scenes", "1"])
    near, far = capsys.readouterr().out.splitlines()
    assert near == "x -0.615 m, z 0 m: 2 of 2 planned; failed: "
    assert far == "x -3 m, z 0 m: 0 of 2 planned; failed: CloseBox 1, OpenSafe 1"
