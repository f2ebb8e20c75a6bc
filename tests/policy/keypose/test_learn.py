"""``gensim2 learn`` at toy size: a checkpoint, its controls, one page, and a second run that does nothing again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gensim2.cli.main import run
from gensim2.errors import InputError
from gensim2.policy import learning
from gensim2.policy.checkpoint import PolicyCheckpoint
from gensim2.policy.evaluating import CONTROLS, read_controls
from gensim2.policy.keypose import data


def test_learning_goes_from_nothing_to_a_measured_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(data, "SHARD", 3)
    monkeypatch.setattr(learning, "LEAST_STEPS", 2)
    out, told = tmp_path / "box", tmp_path / "told.json"
    words = ["learn", "CloseBox", "--assets", "builtin", "--minutes", "0.001", "--scenes", "3", "--workers", "1"]
    words += ["--episodes", "1", "--control-episodes", "1", "--out", str(out), "--json", str(told)]
    assert run(words) == 0
    found = json.loads(told.read_text())
    (row,) = found["tasks"]
    assert (row["name"], row["policy"], row["episodes"], row["steps"]) == ("CloseBox", "keypose", 1, 2)
    assert row["demonstrations"] > 0
    assert row["cpu_s"] == pytest.approx(row["data_cpu_s"] + row["training_cpu_s"], abs=2e-3)
    assert (found["objects"], found["test_instances"]) == (200, "new")
    assert row["expert_mean"] == 1.0  # the planner does what the policy is to learn
    assert row["no_op_mean"] == 0.0
    for name in ("held_mean", "blind_mean", "shuffled_mean"):
        assert 0.0 <= row[name] <= 1.0
    low, high = row["interval"]
    assert 0.0 <= low <= row["held_mean"] <= high <= 1.0
    page = (out / "report.html").read_text()
    assert (out / "evaluation" / "tasks" / "CloseBox" / "video_000000.mp4").exists()
    assert 'src="evaluation/tasks/CloseBox/video_000000.mp4"' in page
    assert "CloseBox" in page
    assert "<polyline" in page
    policy = PolicyCheckpoint.load(out)
    assert policy.data.tasks == ("CloseBox",)
    weights = sorted(path.name for path in out.glob("weights-*"))
    capfd.readouterr()
    assert run(words) == 2
    assert "holds a run already" in capfd.readouterr().err
    assert run([*words, "--resume"]) == 0
    assert sorted(path.name for path in out.glob("weights-*")) == weights
    assert json.loads(told.read_text())["tasks"][0]["held_mean"] == row["held_mean"]
    assert run([*words, "--resume", "--seed", "1"]) == 2
    assert "seed" in capfd.readouterr().err


def test_controls_are_named() -> None:
    assert read_controls("all") == CONTROLS
    assert read_controls("none") == ()
    assert read_controls("expert,blind") == ("blind", "expert")
    with pytest.raises(InputError, match="no control 'deaf'"):
        read_controls("blind,deaf")
