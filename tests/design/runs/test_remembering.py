"""Kept tasks of a run and the user's task library."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from run_folders import CONFIG, add_task, run_folder, task_spec

from gensim2.cli.main import run as command
from gensim2.data.runfolder import TaskFolder
from gensim2.design.remembering import known_before, remember
from gensim2.core.errors import InputError
from gensim2.rollout.inputs import task_and_strategies
from gensim2.tasks import Provenance
from gensim2.tasks.library import load_task, packaged_names
from gensim2.tasks.memory import Memory

#: The tasks of the run: a new one (18 of 20 episodes succeeded), a copy of OpenBox, and one of the paper.
NEW, KNOWN, PAPERS = "RaiseStaplerArm", "OpenDemo", "CloseDemo"


def _told(run: Path, name: str, asset_class: str, origin: str) -> None:
    """Set the class and the origin of a task of the run."""
    task = task_spec(name)
    box = task.objects["box"].model_copy(update={"asset_class": asset_class})
    TaskFolder(run / "tasks" / name).write_task(
        task.model_copy(update={"objects": {"box": box}, "provenance": Provenance(origin=origin)})
    )


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GENSIM2_LIBRARY", str(tmp_path / "library"))
    made = run_folder(tmp_path / "run")
    add_task(made, NEW, 18)
    _told(made, NEW, "stapler_press", "offline")
    _told(made, KNOWN, "box_rotate", "offline")
    _told(made, PAPERS, "window_rotate", "paper")
    return made


def test_what_is_new_is_added_with_its_verification_and_the_rest_is_named(run: Path) -> None:
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    first = remember(run)
    assert first.added == (NEW,)
    assert list(first.left_out) == [KNOWN]
    assert "OpenDemo is not new: OpenBox has the same goal" in first.left_out[KNOWN]
    assert remember(run) == first
    assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before
    found = load_task(NEW).provenance
    assert found is not None
    assert found.verification is not None
    assert (found.verification.held, found.verification.episodes, found.verification.seed) == (18, 20, 0)
    assert (found.verification.paper, found.verification.strict) == (18, 9)
    assert found.verification.interval == (0.699, 0.9721)
    assert found.verification.objects == {"box_rotate": 4}  # from its episodes
    assert task_and_strategies(NEW)[1] == {"designed": CONFIG}
    assert Memory().run_of(NEW) == str(run)
    assert NEW in known_before(None)
    assert set(known_before(None)) - set(known_before(run)) == {NEW}


def test_what_verifies_a_task_anew_can_be_pasted_and_takes_the_run_s_objects(tmp_path: Path, run: Path) -> None:
    place = run.rename(tmp_path / "my run")
    record = json.loads((place / "run.json").read_bytes())
    arguments = {**record["arguments"], "assets": str(tmp_path / "my objects"), "randomization": "wide"}
    (place / "run.json").write_text(json.dumps({**record, "arguments": arguments}))
    add_task(place, NEW, 4, episodes=5)
    _told(place, NEW, "stapler_press", "offline")
    found = re.search(r"`(.+)` verifies it anew", remember(place).left_out[NEW])
    assert found is not None
    words = shlex.split(found[1])
    assert words[:4] == ["gensim2", "tasks", "add", str(place / "tasks" / NEW)]
    told = dict(zip(words[4::2], words[5::2], strict=True))
    assert (told["--assets"], told["--randomization"]) == (str(tmp_path / "my objects"), "wide")


def test_without_a_library_nothing_is_kept(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GENSIM2_LIBRARY", "none")
    assert remember(run).library is None
    with pytest.raises(InputError, match="the user library is disabled"):
        Memory().remove(NEW)
    monkeypatch.setenv("GENSIM2_LIBRARY", "somewhere")
    with pytest.raises(InputError, match="contains no run"):
        remember(run / "tasks")


def test_by_command(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["tasks", "add", str(run)]) == 0
    assert f"in your library {tmp_path / 'library'}: {NEW}" in capsys.readouterr().out
    assert command(["tasks", "list", "--json"]) == 0
    listed = {task["name"]: task for task in json.loads(capsys.readouterr().out)["tasks"]}
    assert set(listed) == {*packaged_names(), NEW}
    assert listed[NEW]["origin"] == "offline"
    assert listed["OpenBox"]["origin"] == "paper"
    assert all(isinstance(task["steps"], list) for task in listed.values())
    assert [task["name"] for task in listed.values() if not task["packaged"]] == [NEW]
    assert command(["tasks", "show", NEW]) == 0
    text = capsys.readouterr().out
    assert "proposed by offline" in text
    assert "verified: 18 of 20 fresh episodes succeeded (0.70 to 0.97), seed 0, new objects: box_rotate (4)" in text
    archive = str(tmp_path / "mine.zip")
    assert command(["tasks", "export", NEW, "--out", archive]) == 0
    assert command(["tasks", "remove", NEW]) == 0
    capsys.readouterr()
    assert command(["tasks", "show", NEW]) == 2
    assert command(["tasks", "show", NEW, "--library", archive]) == 0
    assert command(["tasks", "remove", NEW, "--library", archive]) == 2
    assert command(["tasks", "remove", "OpenBox"]) == 2
    assert command(["tasks", "export", "--out", archive]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert "unknown task" in errors[0]
    assert "is an archive, which is read-only" in errors[1]
    assert "part of the package" in errors[2]
