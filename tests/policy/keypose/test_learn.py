"""``gensim2 learn`` at toy size: a checkpoint, its controls, a page, and a second run that repeats nothing."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.cli.main import run
from gensim2.core.errors import InputError
from gensim2.core.pages import template
from gensim2.objects import open_library
from gensim2.objects.library.export import export
from gensim2.policy import learn_settings, learning, teachers
from gensim2.policy.checkpoint import PolicyCheckpoint
from gensim2.policy.config import PolicyConfig
from gensim2.policy.evaluating import CONTROLS, read_controls
from gensim2.policy.keypose import data
from gensim2.policy.keypose.adding import BESIDE, taught_before
from gensim2.policy.keypose.data import read_planned
from gensim2.policy.keypose.source import PlannedSource
from gensim2.policy.keypose.training import read_ways
from gensim2.policy.learn_record import LearnFolder, LearnRecord
from gensim2.policy.learning import shared_objects, unseen_instances
from gensim2.policy.starting import SPEC
from gensim2.rollout.counted_objects import with_objects
from gensim2.rollout.inputs import read_task_input
from gensim2.tasks.library import task_folder

from .made_up import made_up


def test_learning_goes_from_nothing_to_a_measured_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(data, "SHARD", 3)
    monkeypatch.setattr(teachers, "LEAST_STEPS", 2)
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
    assert row["expert_mean"] == 1.0  # the planner succeeds in the training task
    assert row["no_op_mean"] == 0.0
    for name in ("held_mean", "blind_mean", "shuffled_mean"):
        assert 0.0 <= row[name] <= 1.0
    low, high = row["interval"]
    assert 0.0 <= low <= row["held_mean"] <= high <= 1.0
    page = (out / "report.html").read_text()
    assert (out / "evaluation" / "tasks" / "CloseBox" / "video_000000.mp4").exists()
    assert 'src="evaluation/tasks/CloseBox/video_000000.mp4"' in page
    assert "CloseBox" in page
    assert "1 of 1 (0.21 to 1.00)" in page, "the control expert with its number of episodes and interval"
    printed = capfd.readouterr()
    assert "1 of 1" in printed.out
    pattern = r"CloseBox: (\d+) plans in (\d+) scenes \((\d+) already done at the start, (\d+) without a plan"
    (counts,) = re.findall(pattern, printed.err)
    plans, scenes, done, failed = map(int, counts)
    assert plans + done + failed == scenes == 3
    assert "<b>demonstrations</b>: planned task steps" in page
    assert "<b>steps</b>: gradient steps" in page
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
    told_otherwise = ["evaluate", "CloseBox", "--assets", "builtin", "--checkpoint", str(out), "--controller-args"]
    for sentence, said in (("Close the box.", "did you mean close the box"), ("close the box", "ignores instructions")):
        assert run([*told_otherwise, json.dumps({"says": {sentence: "close the box"}})]) == 2
        assert said in capfd.readouterr().err
    # A policy that another command has trained is not overwritten.
    (out / "learn.json").unlink()
    assert run(words) == 2
    assert "contains a policy that was trained by a different command" in capfd.readouterr().err


def test_chunks_are_taught_by_episodes_until_their_share_of_the_time_is_spent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(teachers, "PORTION", 1)
    monkeypatch.setattr(teachers, "LEAST_STEPS", 2)
    out, told = tmp_path / "box", tmp_path / "told.json"
    words = ["learn", "CloseBox", "--policy", "chunk", "--assets", "builtin", "--minutes", "0.001", "--workers", "1"]
    words += ["--episodes", "1", "--control-episodes", "1", "--controls", "blind", "--videos", "0"]
    words += ["--out", str(out), "--json", str(told)]
    assert run(words) == 0
    said = capfd.readouterr().err
    assert "CloseBox: demonstrations: 1/1 in" in said
    assert "the data took all of the 0.001 minutes" in said
    (row,) = json.loads(told.read_text())["tasks"]
    assert (row["policy"], row["demonstrations"], row["steps"], row["episodes"]) == ("chunk", 1, 2, 1)
    assert row["expert_mean"] is None
    assert row["data_cpu_s"] > 0.024  # one portion of data is made, and no more
    record = json.loads((out / "learn.json").read_text())
    assert record["episodes"] == {".": 1}
    policy = PolicyCheckpoint.load(out)
    assert policy.action.kind == "joint-relative"
    weights = sorted(path.name for path in out.glob("weights-*"))
    capfd.readouterr()
    assert run([*words, "--resume"]) == 0
    assert sorted(path.name for path in out.glob("weights-*")) == weights
    assert json.loads((out / "learn.json").read_text())["episodes"] == {".": 1}
    assert json.loads(told.read_text())["tasks"][0]["held_mean"] == row["held_mean"]
    # Another head learns from the same data.
    words[words.index("chunk")], words[words.index(str(out))] = "flow", str(tmp_path / "flow")
    assert run([*words, "--demonstrations", str(out)]) == 0
    (other,) = json.loads(told.read_text())["tasks"]
    assert [other[name] for name in ("policy", "demonstrations")] == ["flow", 1]
    assert other["data_cpu_s"] >= row["data_cpu_s"]
    assert PolicyCheckpoint.load(tmp_path / "flow").data.digest == policy.data.digest
    # So does a policy of keypoints instead of images.
    words[words.index("flow")], words[words.index(str(tmp_path / "flow"))] = "chunk", str(tmp_path / "state")
    settings = tmp_path / "state.yaml"
    settings.write_text("encoder: state\nkeyframes: 0\n")
    assert run([*words, "--demonstrations", str(out), "--config", str(settings)]) == 0
    found = json.loads(told.read_text())
    assert found["settings"] == {"encoder": "state", "keyframes": 0}
    assert [found["tasks"][0][name] for name in ("policy", "demonstrations")] == ["chunk", 1]
    state = PolicyCheckpoint.load(tmp_path / "state")
    assert state.observation.is_privileged
    assert (state.config.encoder, state.config.keyframes) == ("state", 0)
    evaluated = json.loads((tmp_path / "state" / "evaluation" / "run.json").read_text())
    assert evaluated["result"]["controller"]["privileged"] is True
    words[words.index(str(tmp_path / "state"))] = str(tmp_path / "refused")
    for more, said in (
        (["--seed", "1"], "seed: the value is 0 in the other run, but 1 in this run"),
        (["--policy", "keypose"], "are episodes, but the policy needs plans"),
    ):
        assert run([*words, *more, "--demonstrations", str(out)]) == 2
        assert said in capfd.readouterr().err
        assert not (tmp_path / "refused").exists()


def test_controls_are_named() -> None:
    assert read_controls("all") == CONTROLS
    assert read_controls("none") == read_controls(()) == ()
    assert read_controls(["expert", "blind"]) == ("blind", "expert")
    assert read_controls("expert,blind") == ("blind", "expert")
    with pytest.raises(InputError, match="no control 'deaf'"):
        read_controls("blind,deaf")


@pytest.mark.parametrize("hears", [True, False])  # older policies had no term for the instruction
def test_tasks_are_added_to_those_that_a_policy_knows(
    hears: bool,
    sentence_model: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(data, "SHARD", 2)
    monkeypatch.setattr(teachers, "LEAST_STEPS", 2)
    first, second, told = tmp_path / "two", tmp_path / "three", tmp_path / "told.json"
    common = ["--assets", "builtin", "--minutes", "0.001", "--scenes", "2", "--workers", "1", "--episodes", "1"]
    common += ["--controls", "none", "--videos", "0", "--json", str(told)]
    own = ["--text-model", sentence_model] if hears else []  # checkpoints do not load it by themselves
    hearing = ["--text", "sentence", *own] if hears else []
    with monkeypatch.context() as before:
        usual = learn_settings.POLICY
        before.setattr(learn_settings, "POLICY", PolicyConfig.of({**usual.to_dict(), "hears": hears}))
        assert (
            run(["learn", "TurnOnFaucet", "TurnOffFaucet", "--multi-task", *common, *hearing, "--out", str(first)]) == 0
        )
    plans = {path.name: path.read_bytes() for path in (first / "data" / "TurnOnFaucet").iterdir()}
    words = ["learn", "CloseBox", "--from", str(first), *common, *own, "--out", str(second)]
    if hears:
        assert run([word for word in words if word not in own]) == 2
        assert "give them with --text-model if they are your own" in capfd.readouterr().err
        assert not second.exists()
    assert run(words) == 0
    found = json.loads(told.read_text())
    assert [row["name"] for row in found["tasks"]] == ["TurnOnFaucet", "TurnOffFaucet", "CloseBox"]
    policy = PolicyCheckpoint.load(second)
    assert policy.data.tasks == ("TurnOnFaucet", "TurnOffFaucet", "CloseBox")
    assert policy.config.hears is hears
    assert (policy.config.text, policy.table.shape[0]) == ("sentence" if hears else "small", 3)
    assert policy.sentences[:2] == PolicyCheckpoint.load(first).sentences
    assert {path.name: path.read_bytes() for path in (second / "data" / "TurnOnFaucet").iterdir()} == plans
    assert [way.language for way in read_ways(second, policy)[-2:]] == ["close the box"] * 2
    assert run([*words, "--resume"]) == 0
    capfd.readouterr()
    other = tmp_path / "CloseBoxToo"
    shutil.copytree(task_folder("CloseBox"), other)
    (other / "task.yaml").write_text((other / "task.yaml").read_text().replace("CloseBox", "CloseBoxToo"))
    for tasks, said in (
        (["TurnOnFaucet", "--from", str(second)], "already knows this task"),
        (["OpenBox", "--from", str(second), "--policy", "chunk"], "goes on from a keypose policy of several tasks"),
        (["OpenBox", "--from", str(tmp_path / "none")], "config.json"),
        (["OpenBox", "--from", str(second), "--noise", "d435"], "noise"),
        (
            ["OpenBox", "--from", str(second), "--text", "clip"],
            f"text: the policy given with --from has the text encoder {policy.config.text!r}",
        ),
        (
            ["OpenBox", "--from", str(second), "--text-model", "other"],
            "text_model: is determined by the policy given with --from",
        ),
        (["OpenBox", "--from", str(second), "--robot", "fetch"], "is for the robot 'panda'"),
        ([str(other), "--from", str(second)], "have the sentence 'close the box'"),
    ):
        assert run(["learn", *own, *tasks, *common, "--out", str(tmp_path / "refused")]) == 2
        assert said in capfd.readouterr().err
        assert not (tmp_path / "refused").exists()
    shutil.rmtree(second / "data" / "CloseBox")
    words = ["learn", "OpenBox", "--from", str(second), *common, *own, "--out", str(tmp_path / "refused-too")]
    assert run(words) == 2
    assert "the folder lacks the plans that the policy was trained on" in capfd.readouterr().err


def test_generated_objects_teach_beside_those_of_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(data, "SHARD", 2)
    monkeypatch.setattr(teachers, "LEAST_STEPS", 2)
    library = open_library("builtin")
    for name in ("dishwasher", "box_rotate", "toaster_press"):
        shutil.copytree(export(library.load_articulated(name, "0"), tmp_path / name), tmp_path / "mine" / name / "own")
    rest = ["--assets", str(tmp_path / "mine"), "--test-instances", "all", "--minutes", "0.001", "--scenes", "1"]
    rest += ["--workers", "1", "--episodes", "1", "--controls", "none", "--videos", "0"]
    both, told = tmp_path / "both", tmp_path / "told.json"
    words = ["learn", "CloseBox", "CloseDishwasher", "--multi-task", "--generated", "3", "--instances", "all", *rest]
    assert run([*words, "--out", str(both), "--json", str(told)]) == 0
    plans = {}
    for name in ("CloseBox", "CloseDishwasher"):
        own, beside = (read_planned(both / "data" / f"{name}{end}") for end in ("", BESIDE))
        assert own.record.scene["instances"] == "all"
        assert beside.record.scene["instances"] == "3 generated, seed 0"
        plans[name] = own.demonstrations + beside.demonstrations
    assert {row["name"]: row["demonstrations"] for row in json.loads(told.read_text())["tasks"]} == plans
    policy = PolicyCheckpoint.load(both)
    assert policy.data.tasks == ("CloseBox", "CloseDishwasher")
    assert len(read_ways(both, policy)) + 1 == policy.config.ways
    assert run([*words, "--out", str(both), "--resume"]) == 0
    # Others continue from all of it, or from its plans.
    more = ["learn", "PressToasterLever", "--from", str(both), *rest, "--out", str(tmp_path / "more")]
    assert run([*more, "--instances", "all"]) == 0
    again = tmp_path / "again"
    assert run([*words, "--demonstrations", str(both), "--out", str(again)]) == 0
    for folder in (tmp_path / "more", again):
        copied = folder / "data" / f"CloseBox{BESIDE}" / "shard_00000.npz"
        assert copied.read_bytes() == (both / "data" / f"CloseBox{BESIDE}" / "shard_00000.npz").read_bytes()
    # A task for which generated objects do not suffice is trained on its own objects only.
    capfd.readouterr()
    words[2] = "HandCanOfTunaAcross"
    assert run([*words, "--out", str(tmp_path / "half")]) == 0
    assert "HandCanOfTunaAcross: trained without generated objects, " in capfd.readouterr().err
    assert not (tmp_path / "half" / "data" / f"HandCanOfTunaAcross{BESIDE}").exists()
    assert run([*words[:1], *words[2:3], "--generated", "3", *rest, "--out", str(tmp_path / "none")]) == 2
    assert "generated: none of these tasks can use generated objects" in capfd.readouterr().err


def test_two_folders_of_plans_of_a_task_are_of_the_same_strategies() -> None:
    planned = made_up(4)
    assert PlannedSource([planned, made_up(4, seed=1)]).record.tasks == ("PushBar",)
    other = replace(planned, record=planned.record.model_copy(update={"ways": (("one",),)}))
    with pytest.raises(InputError, match="the two folders of plans for PushBar have different values of this setting"):
        PlannedSource([planned, other])


def test_a_policy_s_tasks_are_measured_on_none_of_the_objects_that_taught_them(tmp_path: Path) -> None:
    boxes = read_task_input("OpenBox", assets="builtin", instances="new")
    counted = with_objects(read_task_input("CloseBox", assets="builtin"), 3, 0)
    for one in (boxes, counted):
        folder = tmp_path / "data" / one.spec.name
        folder.mkdir(parents=True)
        (folder / data.RECORD).write_text(data.record_of(one, SPEC, 0).model_dump_json())
    before = taught_before(tmp_path, ["OpenBox", "CloseBox"], seed=0, assets="builtin")
    assert [(one.spec.name, one.instances) for one in before] == [("OpenBox", "new")]
    assert unseen_instances(before) == "test"
    assert shared_objects(before, "new") != []


def test_what_cannot_be_done_is_said_before_anything_is_planned(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for words, said in (
        (["--test-instances", "tset"], "test_instances: no"),
        (["--objects", "5", "--instances", "train"], "cannot be given together with instances"),
        (["--policy", "chunk", "--verify"], "applies only to keypose policies"),
        (["--policy", "chunk", "--generated", "5"], "generated: applies only to keypose policies"),
        (["--generated", "5"], "generated: adds generated objects to a folder's objects"),
        (["OpenBox", "--text", "clip"], "applies to multi-task policies only"),
        (["OpenBox", "--multi-task", "--text-model", "one"], "applies to pretrained encoders only"),
        (["OpenBox", "--multi-task", "--text", "sentence", "--text-model", str(tmp_path)], "it has no config.json"),
    ):
        assert run(["learn", "CloseBox", "--assets", "builtin", *words, "--out", str(tmp_path / "out")]) == 2
        assert said in capfd.readouterr().err
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"workers": -1}, "workers: must be at least 0"),
        ({"objects": 0}, "objects: must be at least 1"),
        ({"controls": ("deaf",)}, "no control 'deaf'"),
    ],
)
def test_arguments_from_python_are_checked_at_the_start(given: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        learning.learn("CloseBox", out=tmp_path / "out", assets="builtin", minutes=0.001, **given)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "words", "said"),
    [
        ("steps: 5", [], "steps: this field is not a setting of gensim2 learn (say how long with --minutes)"),
        ("head: flow", [], "head: this field is not a setting of gensim2 learn (say it with --policy)"),
        ("encodr: mlp", [], "encodr: is not a field of the policy settings"),
        (
            "encoder: state",
            [],
            "encoder: the encoder 'state' is available only for policies that predict action chunks",
        ),
        ("history: 2", [], "history: applies only to action chunks"),
        ("arm_noise: 0.1", [], "arm_noise: applies only to action chunks"),
        ("ways: 3", ["--policy", "chunk"], "ways: this field is not a setting of gensim2 learn"),
        ("hears: false", ["--policy", "chunk"], "hears: applies only to keyposes"),
        ("{encoder: state, points: 8}", ["--policy", "chunk"], "points: must be at least 64 for the encoder state"),
        ("encoder: state", ["--policy", "chunk", "--noise", "d435"], "noise: is of depth pictures"),
        ("batch: 16", ["--from", "builtin"], "--config: cannot be given together with --from"),
        ("[1]", [], "settings.yaml"),
    ],
)
def test_settings_that_a_run_does_not_take_are_refused(
    text: str, words: list[str], said: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    settings = tmp_path / "settings.yaml"
    settings.write_text(text)
    command = ["learn", "CloseBox", "--assets", "builtin", "--out", str(tmp_path / "out"), "--config", str(settings)]
    assert run([*command, *words]) == 2
    told = capfd.readouterr().err
    assert said in told
    assert "Traceback" not in told
    assert not (tmp_path / "out").exists()


def test_a_task_without_a_plan_is_refused_also_where_some_scenes_are_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = made_up(2)
    done = {**planned.arrays, "way": np.full_like(planned.arrays["way"], -1)}
    monkeypatch.setattr(teachers, "plan_scenes", lambda *_, **__: replace(planned, arrays=done))
    with pytest.raises(InputError, match=r"tasks\.CloseBox: none of its 4 scenes could be planned"):
        learning.learn("CloseBox", out=tmp_path, assets="builtin", minutes=0.001, workers=0)


def test_scenes_that_are_done_at_the_start_are_counted() -> None:
    """Scene 1 has a planned step, scene 2 is done at the start, and a later step of scene 3 has no plan."""
    arrays = {"seed": np.array([1, 1, 2, 3]), "way": np.array([0, -1, -1, 0])}
    assert teachers._done_at_start(replace(made_up(2), arrays=arrays)) == 1


def test_a_run_keeps_its_demonstrations(tmp_path: Path) -> None:
    record = LearnRecord(
        tasks=("CloseBox",), policy="keypose", minutes=1.0, multi_task=False, seed=0, scenes=1, scene={}
    )
    first = record.model_copy(update={"demonstrations_of": "/one"})
    with LearnFolder(tmp_path, first, resume=False):
        pass
    for again in (first, record):
        with LearnFolder(tmp_path, again, resume=True) as opened:
            assert opened.record.demonstrations_of == "/one"
    with pytest.raises(InputError, match="demonstrations: was begun with '/one', not '/other'"):
        LearnFolder(tmp_path, record.model_copy(update={"demonstrations_of": "/other"}), resume=True)


def test_the_page_of_added_tasks_is_of_one_policy() -> None:
    row = {"name": "CloseBox", "held_mean": 1.0, "interval": (0.5, 1.0), "cpu_s": 1.0, "causes": {}, "episodes": 1}
    for begun, words in (({"start": ("folder", "digest")}, "One policy for 4 tasks"), ({"start": None}, " 4 tasks")):
        page = template("gensim2.policy", "learned.html.j2").render(
            rows=[{**row, "demonstrations": 1, "steps": 1}] * 4,
            named=3,
            record={"policy": "keypose", "seed": 0, "multi_task": False, "settings": {}, **begun},
            controls=0,
            demonstrations="planned steps",
            measured=[],
            seen_objects=[],
            curves={},
            films=[],
            failures=[],
        )
        assert f"<h1>{words}</h1>" in page
