"""The package's policy knows the suite's tasks by their instructions and succeeds in them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from gensim2.cli.main import run
from gensim2.core.errors import InputError
from gensim2.objects import open_library
from gensim2.objects.library.export import export
from gensim2.policy import PolicyCheckpoint, teachers
from gensim2.policy.checkpoint import checkpoint_folder
from gensim2.policy.evaluating import policy_controller
from gensim2.policy.export import export_policy
from gensim2.policy.keypose import adding, data
from gensim2.policy.keypose.adding import tasks_to_plan_again
from gensim2.policy.keypose.controller import KeyposeController
from gensim2.policy.keypose.data import read_planned
from gensim2.policy.keypose.latency import measure_looks
from gensim2.policy.keypose.training import read_ways
from gensim2.tasks.library import load_task


def test_its_sentences_are_those_of_its_tasks(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["policy", "show", "builtin", "--json"]) == 0
    shown = json.loads(capfd.readouterr().out)
    assert len(shown["data"]["tasks"]) == 24
    assert shown["sentences"] == [load_task(name).description for name in shown["data"]["tasks"]]
    assert PolicyCheckpoint.load("builtin").sentences == tuple(shown["sentences"])


def test_what_taught_it_is_counted_as_it_is(capfd: pytest.CaptureFixture[str]) -> None:
    data = PolicyCheckpoint.load("builtin").data
    assert run(["policy", "show", "builtin"]) == 0
    assert f"{data.frames} examples, {data.episodes} planned steps among them" in capfd.readouterr().out


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


def test_tasks_are_added_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(data, "SHARD", 2)
    monkeypatch.setattr(adding, "REHEARSED", 2)
    monkeypatch.setattr(teachers, "LEAST_STEPS", 2)
    library = open_library("builtin")
    for name in ("dishwasher", "box_rotate"):
        made = export(library.load_articulated(name, "0"), tmp_path / f"made-{name}")
        shutil.copytree(made, tmp_path / "mine" / name / "own")
    words = ["learn", "CloseDishwasher", "--from", "builtin", "--assets", str(tmp_path / "mine"), "--instances", "all"]
    words += ["--test-instances", "all", "--minutes", "0.001", "--scenes", "1", "--workers", "1", "--episodes", "1"]
    words += ["--controls", "none", "--videos", "0", "--out", str(tmp_path / "more")]
    assert run([*words, "--json", str(tmp_path / "told.json")]) == 0
    # Tasks with available objects are measured again.
    told = json.loads((tmp_path / "told.json").read_bytes())
    assert [row["name"] for row in told["tasks"]] == ["CloseBox", "OpenBox", "CloseDishwasher"]
    assert "OpenDrawer: not measured again, " in capfd.readouterr().err
    packaged, grown = PolicyCheckpoint.load("builtin"), PolicyCheckpoint.load(tmp_path / "more")
    assert grown.data.tasks == (*packaged.data.tasks, "CloseDishwasher")
    assert read_ways(tmp_path / "more", grown)[:-1] == read_ways(checkpoint_folder("builtin"), packaged)
    assert told["tasks"][0]["data_cpu_s"] > 0  # new plans are counted
    # Other policies continue from this one without planning anything twice.
    planned = read_planned(tmp_path / "more" / "data" / "OpenDrawer")
    assert (planned.scenes, planned.record.scene["instances"]) == (2, "200 generated, seed 0")
    assert run([*words, "--resume"]) == 0


def test_the_library_s_strategies_are_those_that_taught_it(monkeypatch: pytest.MonkeyPatch) -> None:
    folder, policy = checkpoint_folder("builtin"), PolicyCheckpoint.load("builtin")
    again = tasks_to_plan_again(folder, policy, 3, seed=0)
    assert [one.spec.name for one in again] == list(policy.data.tasks)
    assert {one.instances for one in again} == {"3 generated, seed 0"}
    ways = read_ways(folder, policy)
    for one in again:
        taught = [(way.step, way.name) for way in ways if way.language == one.spec.description]
        assert [(number, name) for number, step in enumerate(one.spec.steps) for name in step.strategies] == taught
    other = [way.model_copy(update={"name": "another"}) for way in ways]
    monkeypatch.setattr(adding, "read_ways", lambda *_: other)
    with pytest.raises(InputError, match="CloseBox was taught by another, another, the library has close_box, "):
        tasks_to_plan_again(folder, policy, 3, seed=0)


def test_it_does_what_it_is_told(tmp_path: Path) -> None:
    words = ["CloseBox", "OpenBox", "TurnOnFaucet", "--checkpoint", "builtin", "--assets", "builtin"]
    rest = ["--instances", "new", "--seed", "3", "--episodes", "4", "--controls", "blind", "--control-episodes", "2"]
    out = ["--out", str(tmp_path / "run"), "--json", str(tmp_path / "found.json")]
    assert run(["evaluate", *words, *rest, "--workers", "1", *out]) == 0
    found = json.loads((tmp_path / "found.json").read_bytes())
    assert [row["name"] for row in found["tasks"]] == words[:3]
    assert sum(row["held_mean"] for row in found["tasks"]) / 3 >= 0.8
    assert sum(row["held_mean"] for row in found["controls"]["blind"]) == 0.0
