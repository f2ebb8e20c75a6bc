"""The policy that comes with the package knows the suite's tasks by their sentences, and does them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gensim2.cli.main import run
from gensim2.policy import PolicyCheckpoint
from gensim2.tasks.library import load_task


def test_its_sentences_are_those_of_its_tasks(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["policy", "show", "builtin", "--json"]) == 0
    shown = json.loads(capfd.readouterr().out)
    assert len(shown["data"]["tasks"]) == 24
    assert shown["sentences"] == [load_task(name).description for name in shown["data"]["tasks"]]
    assert PolicyCheckpoint.load("builtin").sentences == tuple(shown["sentences"])


def test_it_does_what_it_is_told(tmp_path: Path) -> None:
    words = ["CloseBox", "OpenBox", "TurnOnFaucet", "--checkpoint", "builtin", "--assets", "builtin"]
    rest = ["--instances", "new", "--seed", "3", "--episodes", "5", "--controls", "blind", "--control-episodes", "3"]
    out = ["--out", str(tmp_path / "run"), "--json", str(tmp_path / "found.json")]
    assert run(["evaluate", *words, *rest, "--workers", "1", *out]) == 0
    found = json.loads((tmp_path / "found.json").read_bytes())
    assert [row["name"] for row in found["tasks"]] == words[:3]
    assert sum(row["held_mean"] for row in found["tasks"]) / 3 >= 0.8
    assert sum(row["held_mean"] for row in found["controls"]["blind"]) == 0.0
