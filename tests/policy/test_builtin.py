"""The policy that comes with the package knows the suite's tasks by their sentences, and does them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from gensim2.cli.main import run
from gensim2.policy import PolicyCheckpoint
from gensim2.policy.checkpoint import checkpoint_folder
from gensim2.policy.evaluating import policy_controller
from gensim2.policy.export import export_policy
from gensim2.policy.keypose.controller import KeyposeController
from gensim2.policy.keypose.latency import measure_looks
from gensim2.tasks.library import load_task


def test_its_sentences_are_those_of_its_tasks(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["policy", "show", "builtin", "--json"]) == 0
    shown = json.loads(capfd.readouterr().out)
    assert len(shown["data"]["tasks"]) == 24
    assert shown["sentences"] == [load_task(name).description for name in shown["data"]["tasks"]]
    assert PolicyCheckpoint.load("builtin").sentences == tuple(shown["sentences"])


def test_a_folder_of_that_name_is_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(checkpoint_folder("builtin"), tmp_path / "builtin")
    record = json.loads((tmp_path / "builtin" / "config.json").read_bytes())
    (tmp_path / "builtin" / "config.json").write_text(json.dumps({**record, "step": 7}))
    monkeypatch.chdir(tmp_path)
    for own in ("./builtin", Path("builtin"), tmp_path / "builtin"):
        assert PolicyCheckpoint.load(own).step == 7
        folder = policy_controller(own).arguments["checkpoint"]
        assert folder == str(tmp_path / "builtin")
    assert PolicyCheckpoint.load("builtin").step > 7
    assert policy_controller("builtin").arguments["checkpoint"] == str(checkpoint_folder("builtin"))


def test_every_command_takes_it(tmp_path: Path) -> None:
    assert export_policy("builtin", tmp_path / "policy.pt2", "torch")["difference"] <= 1e-5
    assert measure_looks("builtin", looks=2, assets="builtin")["looks"] == 2
    assert len(KeyposeController("builtin").sentences) == 24


def test_it_does_what_it_is_told(tmp_path: Path) -> None:
    words = ["CloseBox", "OpenBox", "TurnOnFaucet", "--checkpoint", "builtin", "--assets", "builtin"]
    rest = ["--instances", "new", "--seed", "3", "--episodes", "5", "--controls", "blind", "--control-episodes", "3"]
    out = ["--out", str(tmp_path / "run"), "--json", str(tmp_path / "found.json")]
    assert run(["evaluate", *words, *rest, "--workers", "1", *out]) == 0
    found = json.loads((tmp_path / "found.json").read_bytes())
    assert [row["name"] for row in found["tasks"]] == words[:3]
    assert sum(row["held_mean"] for row in found["tasks"]) / 3 >= 0.8
    assert sum(row["held_mean"] for row in found["controls"]["blind"]) == 0.0
