"""``gensim2 assets``: output, files and exit codes of each command."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from gensim2.cli import main as cli
from gensim2.objects import open_library
from gensim2.rollout.inputs import task_and_strategies


@pytest.fixture(autouse=True)
def generated_objects(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use the generated library if ``--assets`` is not given, even if the tests have real objects."""
    monkeypatch.delenv("GENSIM2_ASSETS", raising=False)


def run_json(capfd: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, Any]:
    code = cli.run([*arguments, "--json"])
    out, err = capfd.readouterr()
    return code, json.loads(out) if out else err


def test_show_says_what_is_known(capfd: pytest.CaptureFixture[str]) -> None:
    code, result = run_json(capfd, "assets", "show", "drawer/7")
    assert code == 0
    assert (result["class"], result["id"], result["joint"]["type"]) == ("drawer", "7", "prismatic")
    assert result["split"] in ("train", "test")
    assert Path(result["urdf"]).is_file()
    assert cli.run(["assets", "show", "drawer/7"]) == 0
    out, _ = capfd.readouterr()
    assert "articulated_object_inside" in out
    assert "[m]" in out


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("drawers", "no class 'drawers'"),
        ("drawer/x", "no instance 'x' of drawer"),
        ("drawer/", "write CLASS or CLASS/ID"),
        ("faucet_/1", "did you mean faucet"),
        ("toilet/test", "toilet has only 2 instances, which are all used for training"),
    ],
)
@pytest.mark.parametrize("command", ["show", "validate", "prepare"])
def test_what_is_not_there_is_bad_input(
    capfd: pytest.CaptureFixture[str], command: str, word: str, message: str
) -> None:
    assert cli.run(["assets", command, word]) == 2
    assert message in capfd.readouterr().err


def test_solve_and_demo_take_the_same_words(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """An id or a split, checked before anything is simulated or written."""
    pytest.importorskip("mani_skill")
    task = tmp_path / "task"
    task.mkdir()
    spec, strategies = task_and_strategies("OpenBox")
    told = spec.model_dump(mode="json", by_alias=True)
    (role,) = told["objects"]
    told["objects"][role]["class"] = "toilet"
    (task / "task.yaml").write_text(yaml.safe_dump(told))
    (task / "strategies").mkdir()
    for name, strategy in strategies.items():
        (task / "strategies" / f"{name}.yaml").write_text(yaml.safe_dump(strategy))
    out = tmp_path / "out"
    for command in (["solve", str(task)], ["demo", str(task), "--out", str(out)]):
        for word, message in (
            ("test", "toilet has only 2 instances, which are all used for training"),
            ("x", "a number from 0 to"),
        ):
            assert cli.run([*command, "--assets", "builtin", "--instance", word]) == 2
            assert message in capfd.readouterr().err
    assert not out.exists()
    code, result = run_json(capfd, "solve", "CloseBox", "--assets", "builtin", "--instance", "test", "--seed", "4")
    assert code in (0, 1)
    assert result["instance"] in open_library("builtin").split("box_rotate", "test")


def test_validate_prints_a_line_an_object_and_writes_json(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    pytest.importorskip("sapien")
    file = tmp_path / "found.json"
    words = ["drawer/test", "faucet/random", "--random", "1", "--seed", "3", "--workers", "1"]
    assert cli.run(["assets", "validate", *words, "--json", str(file)]) == 0
    lines = capfd.readouterr().out.splitlines()
    result = json.loads(file.read_text())
    names = [f"{entry['class']}/{entry['id']}" for entry in result["objects"]]
    assert lines[:-1] == [f"ok     {name}" for name in names]
    assert lines[-1] == "5 of 5 objects of builtin are sound"
    assert [name.partition("/")[0] for name in names] == ["drawer", "drawer", "faucet", "drawer", "faucet"]
    assert int(names[-1].partition("/")[2]) >= 13
    assert all(entry == {**entry, "sound": True, "findings": []} for entry in result["objects"])


def test_validate_ends_with_one_and_names_what_is_wrong(
    capfd: pytest.CaptureFixture[str], chest: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))
    whole = chest(tmp_path / "lib" / "box_rotate" / "1")
    chest(tmp_path / "lib" / "box_rotate" / "2", scale=-1)
    torn = chest(tmp_path / "lib" / "box_rotate" / "3")
    (torn / "textured_objs" / "left.obj").unlink()
    assert whole.is_dir()
    where = ["--assets", str(tmp_path / "lib"), "--no-physics", "--workers", "1"]
    code, result = run_json(capfd, "assets", "validate", *where)
    assert code == 1
    one, two, three = result["objects"]
    assert (one["sound"], two["sound"], three["sound"], result["sound"]) == (True, False, False, 1)
    assert two["findings"][0]["check"] == "loads"
    assert "scale: must be a positive number" in two["findings"][0]["value"]
    assert any("left.obj" in str(finding["value"]) for finding in three["findings"])
    assert cli.run(["assets", "validate", "box_rotate", *where]) == 1
    assert "FAULT  box_rotate/3: " in capfd.readouterr().out
    code, result = run_json(capfd, "assets", "prepare", "--assets", str(tmp_path / "lib"), "--workers", "1")
    assert (code, result["prepared"]) == (1, 2)
    assert [entry["id"] for entry in result["refused"]] == ["2"]


def test_export_writes_a_library_that_opens(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "mine"
    code, result = run_json(capfd, "assets", "export", "drawer/test", "faucet/3", "--out", str(out))
    assert code == 0
    folders = [Path(entry["folder"]) for entry in result["objects"]]
    assert [folder.relative_to(out / "articulated_objs").parts[0] for folder in folders] == [
        "drawer",
        "drawer",
        "faucet",
    ]
    code, result = run_json(capfd, "assets", "list", "--assets", str(out))
    found = [(entry["class"], len(entry["instances"])) for entry in result["classes"] if entry["source"] == "real"]
    assert found == [("drawer", 2), ("faucet", 1)]
    assert result["license"] == "Apache-2.0"
    assert cli.run(["assets", "export", "faucet/3", "--out", str(out)]) == 2
    assert "already exists" in capfd.readouterr().err
    assert cli.run(["assets", "export", "faucet/3", "--out", str(out), "--force"]) == 0
    assert capfd.readouterr().out.splitlines() == [str(folders[2]), "license: Apache-2.0"]
    assert cli.run(["assets", "export", "--out", str(out)]) == 2
    assert "--all" in capfd.readouterr().err


def test_ctrl_c_ends_validation_and_its_workers_at_once() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "gensim2", "assets", "validate", "--all", "--no-physics", "--workers", "2"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "GENSIM2_ASSETS": "", "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    deadline = time.monotonic() + 60
    while len(children.read_text().split()) < 2:
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    workers = children.read_text().split()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=15)
    assert (process.returncode, out) == (130, "")
    assert "interrupted" in err
    deadline = time.monotonic() + 5
    while any(Path(f"/proc/{worker}").exists() for worker in workers):
        assert time.monotonic() < deadline
        time.sleep(0.05)
