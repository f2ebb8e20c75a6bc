"""The other benchmark scripts run, and their results agree."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mani_skill")
pytestmark = pytest.mark.usefixtures("peers")


def test_kinematics_agree(capsys: pytest.CaptureFixture[str]) -> None:
    import kinematics

    assert kinematics.main(["--count", "200", "--repeats", "1"]) == 0
    assert "largest difference" in capsys.readouterr().out


def test_collisions_agree_with_coal(capsys: pytest.CaptureFixture[str]) -> None:
    import collision

    affinity = os.sched_getaffinity(0)
    try:
        assert collision.main(["--hulls", "40", "--configurations", "300", "--repeats", "1"]) == 0
    finally:
        os.sched_setaffinity(0, affinity)
    found = {line.rsplit(maxsplit=1)[0].strip(): line.split()[-1] for line in capsys.readouterr().out.splitlines()}
    assert found["configurations with different results"] == "0"


def test_sampling_finds_the_motion_and_goes_on(problem: dict[str, Any], assets: Path, tmp_path: Path) -> None:
    import reachability

    problems, out = tmp_path / "p.jsonl", tmp_path / "reach.jsonl"
    far = {**problem, "id": "far", "object_keypoints_base": {"articulated_object_head": [1.6, 0.0, 0.3]}}
    problems.write_text(json.dumps(problem) + "\n" + json.dumps(far) + "\n")
    arguments = ["--problems", str(problems), "--assets", str(assets), "--out", str(out), "--seconds", "5"]
    assert reachability.main([*arguments, "--limit", "1"]) == 0
    first = out.read_text()
    assert reachability.main([*arguments, "--seconds", "0.3"]) == 0
    assert out.read_text().startswith(first)
    near, beyond = (json.loads(line) for line in out.read_text().splitlines())
    assert near["found"]
    assert np.asarray(near["path"]).shape == (len(near["times"]), 9)
    assert near["times"][-1] == 32
    assert (beyond["found"], beyond["poses"]) == (False, 0)


def test_keyframes_from_the_config(problem: dict[str, Any]) -> None:
    import rules

    problem["config"]["post_actuation_motions"] = [["translate_x", 0.1], ["rotate", 0.5]]
    hand = np.eye(4)
    hand[:3, 3] = [0.5, 0.0, 0.3]
    frames = rules.expected_keyframes(problem, hand, "original")
    np.testing.assert_allclose(
        [frame.pose[:3, 3] for frame in frames[:3]], [[0.5, 0, 0.17], [0.5, 0, 0.22], [0.5, 0, 0.3]]
    )
    yaw = problem["object_yaw"]
    np.testing.assert_allclose(frames[3].pose[:3, 3] - hand[:3, 3], [0.1 * np.cos(yaw), 0.1 * np.sin(yaw), 0.0])
    center = np.asarray(problem["T_base_object"])[:3, 3]
    radii = [np.linalg.norm((frame.pose[:3, 3] - center)[:2]) for frame in frames[3:]]
    assert radii[0] == pytest.approx(radii[1])
    assert rules.angle_between(frames[3].pose[:3, :3], frames[4].pose[:3, :3]) == pytest.approx(0.5)
    halfway = center + rules.rotation("z", 0.25) @ (frames[3].pose[:3, 3] - center)
    assert rules.off_path(frames[3], frames[4], halfway) == pytest.approx(0.0, abs=1e-12)
    chord = 0.5 * (frames[3].pose[:3, 3] + frames[4].pose[:3, 3])
    assert rules.off_path(frames[3], frames[4], chord) == pytest.approx(radii[0] * (1 - np.cos(0.25)))
