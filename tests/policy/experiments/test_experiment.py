"""``gensim2 experiment`` at toy size: every arm is trained and measured, and a second run repeats nothing."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from gensim2.cli.main import run
from gensim2.core.progress import NULL_PROGRESS
from gensim2.core.record_files import read_record
from gensim2.objects.library.catalogue import BUILTIN
from gensim2.policy import teachers
from gensim2.policy.checkpoint import PolicyCheckpoint
from gensim2.policy.experiments import running
from gensim2.policy.experiments.config import Arm, ExperimentConfig
from gensim2.policy.experiments.running import ExperimentRecord, _measurements, run_experiment, runnable, without_others
from gensim2.policy.keypose import data
from gensim2.policy.learn_record import LearnRecord

CONFIG = """
title: Toy
about: Two arms.
minutes_a_task: 0.001
scenes: 2
episodes: 1
control_episodes: 1
unseen: new
sentences: true
untaught: [CloseTrashCan]
arms:
  - {name: split, objects: generated, tasks: [CloseBox, OpenBox]}
  - {name: counted, objects: generated, count: 2, tasks: [CloseBox]}
  - {name: more, start: split, objects: generated, tasks: [CloseLaptop, CloseBox, OpenBox]}
  - {name: real, objects: real, tasks: [CloseBox]}
"""


def test_every_arm_is_learned_and_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(data, "SHARD", 2)
    monkeypatch.setattr(teachers, "LEAST_STEPS", 2)
    config, out, told = tmp_path / "toy.yaml", tmp_path / "out", tmp_path / "told.json"
    text = "\n".join(line for line in CONFIG.splitlines() if "name: counted" not in line)
    config.write_text(text)
    words = ["experiment", "generalization", "--config", str(config), "--assets", "builtin", "--workers", "1"]
    words += ["--seed", "3", "--out", str(out), "--json", str(told)]
    assert run(words) == 0
    found = json.loads(told.read_text())
    assert [(row["arm"], row["name"]) for row in found["tasks"]] == [
        ("split", "CloseBox"),
        ("split", "OpenBox"),
        ("split", "CloseTrashCan"),
        ("more", "CloseLaptop"),
        ("more", "CloseBox"),
        ("more", "OpenBox"),
        ("more", "CloseTrashCan"),
    ]
    split, _, untaught, added, known, _, _ = found["tasks"]
    assert (split["episodes"], added["episodes"], known["episodes"]) == (2, 2, 2)
    assert found["episodes"] == 10
    measured = {kind: rate["episodes"] for kind, rate in split["counts"].items()}
    assert measured == {"seen": 1, "unseen": 1, "opposite": 1, "rephrased": 2, "blind": 1}
    assert set(untaught["counts"]) == {"untaught"}
    for name in ("seen", "unseen"):
        low, high = found[f"{name}_interval"]
        assert 0.0 <= low <= found[f"{name}_mean"] <= high <= 1.0
    assert found["skipped"] == {"real": "needs a folder of real objects: --assets"}
    assert "Toy" in (out / "report.html").read_text()
    assert PolicyCheckpoint.load(out / "split" / "seed-3").data.tasks == ("CloseBox", "OpenBox")
    more = PolicyCheckpoint.load(out / "more" / "seed-3")
    assert more.data.tasks == ("CloseBox", "OpenBox", "CloseLaptop")
    assert read_record(out / "more" / "seed-3" / "learn.json", LearnRecord, "").tasks == ("CloseLaptop",)
    split_arm, more_arm = found["arms"]
    assert more_arm["cpu_s"] > split_arm["cpu_s"]
    assert found["cpu_s"] == pytest.approx(more_arm["cpu_s"], abs=0.01)
    capfd.readouterr()
    assert run(words) == 2
    assert "--resume" in capfd.readouterr().err
    before = {path: path.read_bytes() for path in out.rglob("weights-*")}
    assert run([*words, "--resume"]) == 0
    assert {path: path.read_bytes() for path in out.rglob("weights-*")} == before
    assert json.loads(told.read_text())["tasks"] == found["tasks"]
    config.write_text(text.replace("Two arms.", "Two arms, and one more."))
    assert run([*words, "--resume"]) == 0  # texts of the page may change
    config.write_text(text.replace("episodes: 1", "episodes: 2"))
    assert run([*words, "--resume"]) == 2
    assert "config" in capfd.readouterr().err


def test_a_first_training_of_every_arm_goes_before_second_ones_and_figures_stand_after_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[tuple[str, int]] = []
    figures: list[tuple[int, int]] = []

    def stop_after_three(arm: Arm, start: object, record: object, number: int, *_: object) -> running._Training:
        if (tmp_path / "result.json").exists():
            told = json.loads((tmp_path / "result.json").read_text())
            figures.append((told["remaining"], len(told["arms"])))
        if len(order) == 3:
            raise KeyboardInterrupt
        order.append((arm.name, number))
        learned: Any = SimpleNamespace(folder=tmp_path / arm.name / str(number), demonstrations={}, cpu_s=1.0)
        return running._Training(learned, 0.0, {})

    monkeypatch.setattr(running, "_train", stop_after_three)
    config = ExperimentConfig.model_validate({**yaml.safe_load(CONFIG), "seeds": 2})
    with pytest.raises(KeyboardInterrupt):
        run_experiment(config, out=tmp_path, assets=BUILTIN)
    assert order == [("split", 0), ("counted", 0), ("more", 0)]
    assert figures == [(5, 1), (4, 2), (3, 3)]
    assert "3 trainings are still to come" in (tmp_path / "report.html").read_text()
    # If it is continued and stopped before it reaches its former state, it keeps all results.
    order.pop()
    order.pop()
    with pytest.raises(KeyboardInterrupt):
        run_experiment(config, out=tmp_path, assets=BUILTIN, resume=True)
    assert figures[3:] == [(3, 3), (3, 3), (3, 3)]
    assert "3 trainings are still to come" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("[CloseTrashCan]", "[CloseTrashcan]"), "CloseTrashcan"),
        (("[CloseBox, OpenBox]", "[CloseBox, OpenBok]"), "OpenBok"),
        (("[CloseBox, OpenBox]", "[CloseBox, OpenDishwasher]"), "has no other words for"),
        (("[CloseBox, OpenBox]", "[CloseBox, OpenBok]"), "arms.split.tasks"),
        (("[CloseBox, OpenBox]", "[CloseBox, CloseBox]"), "split lists a task twice"),
        (("[CloseTrashCan]", "[CloseBox]"), "no policy may train on CloseBox, because 'untaught'"),
    ],
)
def test_what_cannot_be_measured_is_said_before_anything_is_taught(
    change: tuple[str, str], said: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    config, out = tmp_path / "toy.yaml", tmp_path / "out"
    config.write_text("\n".join(line for line in CONFIG.splitlines() if "start:" not in line).replace(*change))
    words = ["experiment", "generalization", "--config", str(config), "--assets", "builtin", "--out", str(out)]
    assert run(words) == 2
    assert said in capfd.readouterr().err
    assert not out.exists()


def test_an_arm_that_starts_from_one_that_cannot_be_run_is_left_out() -> None:
    base = {"title": "a", "about": "a", "minutes_a_task": 1, "scenes": 1, "episodes": 1, "control_episodes": 1}
    doors = {"name": "doors", "objects": "generated", "tasks": ["SwingDoorOpen", "CloseBox"]}
    more = {**doors, "name": "more", "start": "doors", "tasks": ["SwingDoorOpen", "CloseBox", "OpenBox"]}
    config = ExperimentConfig.model_validate({**base, "arms": [doors, more]})
    found, skipped = runnable(ExperimentRecord(config=config, seed=0, assets=BUILTIN))
    assert [each.name for each in found] == ["doors"]
    assert "a test split needs at least 10" in skipped["doors/SwingDoorOpen"]
    assert skipped["more"] == f"starts from doors, which cannot be run: {skipped['doors/SwingDoorOpen']}"


def test_a_task_of_rigid_objects_alone_is_taught_beside_others_and_has_no_unseen_objects() -> None:
    base = {"title": "a", "about": "a", "minutes_a_task": 1, "scenes": 1, "episodes": 1, "control_episodes": 1}
    arm = {"name": "ten", "objects": "generated", "count": 10, "tasks": ["CloseBox", "LayTableWithAppleAndPear"]}
    table = {**arm, "name": "table", "tasks": ["LayTableWithAppleAndPear"]}
    config = ExperimentConfig.model_validate({**base, "unseen": "new", "arms": [arm, table]})
    record = ExperimentRecord(config=config, seed=0, assets=BUILTIN)
    (found,), skipped = runnable(record)
    assert (found.name, list(found.tasks)) == ("ten", arm["tasks"])
    assert without_others(found, record) == {"LayTableWithAppleAndPear"}
    assert skipped == {"table": "has no task that generated objects do for"}


def test_objects_without_a_class_leave_out_their_measurement_alone(tmp_path: Path) -> None:
    base = {"title": "a", "about": "a", "minutes_a_task": 1, "scenes": 1, "episodes": 1, "control_episodes": 1}
    arm = {"name": "split", "objects": "generated", "tasks": ["CloseBox", "OpenBox"]}
    config = ExperimentConfig.model_validate({**base, "unseen": "new", "transfer": True, "arms": [arm]})
    faucet = tmp_path / "articulated_objs" / "faucet" / "1"
    faucet.mkdir(parents=True)
    for name, text in (("info.json", "{}"), ("mobility.urdf", "<robot/>")):
        (faucet / name).write_text(text)
    record = ExperimentRecord(config=config, seed=0, assets=str(tmp_path))
    found, skipped = runnable(record)
    assert [each.tasks for each in found] == [("CloseBox", "OpenBox")]
    assert [one.kind for one in _measurements(found[0], record, 0)] == ["seen"]
    assert list(skipped) == ["split/CloseBox on real objects", "split/OpenBox on real objects"]
    assert all("no class 'box_rotate'" in reason for reason in skipped.values())


@pytest.mark.real
def test_an_arm_of_both_kinds_of_objects_is_measured_on_the_folder_s_alone(
    real_assets: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    base = {"title": "a", "about": "a", "minutes_a_task": 1, "scenes": 1, "episodes": 1, "control_episodes": 1}
    arms = [
        {"name": "mixed", "objects": "real", "count": 7, "tasks": ["CloseBox"]},
        {"name": "counted", "objects": "generated", "count": 7, "tasks": ["CloseBox"]},
    ]
    config = ExperimentConfig.model_validate({**base, "arms": arms})
    record = ExperimentRecord(config=config, seed=0, assets=str(real_assets))
    (mixed, counted), _ = runnable(record)
    (seen,) = _measurements(mixed, record, 0)
    assert (seen.kind, seen.assets, seen.instances) == ("seen", str(real_assets), "train")
    assert not list(_measurements(counted, record, 0))
    taught: list[dict[str, Any]] = []

    def kept(*_: object, **given: Any) -> None:
        taught.append(given)
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "learn", kept)
    for arm, number in ((mixed, 0), (mixed, 1), (counted, 1)):
        with pytest.raises(KeyboardInterrupt):
            running._train(arm, None, record, number, tmp_path, 1, "cpu", NULL_PROGRESS)
    names = ("objects", "generated", "instances", "test_instances", "assets")
    assert [tuple(each.get(name) for name in names) for each in taught] == [
        (None, 7, "train", "test", str(real_assets)),
        (None, 7, "train-1", "test-1", str(real_assets)),
        (7, None, None, "test", BUILTIN),
    ]


@pytest.mark.real
def test_an_arm_of_both_kinds_of_objects_without_generated_ones_is_left_out(real_assets: Path) -> None:
    base = {"title": "a", "about": "a", "minutes_a_task": 1, "scenes": 1, "episodes": 1, "control_episodes": 1}
    arm = {"name": "mixed", "objects": "real", "count": 7, "tasks": ["HandCanOfTunaAcross"]}
    config = ExperimentConfig.model_validate({**base, "arms": [arm]})
    found, skipped = runnable(ExperimentRecord(config=config, seed=0, assets=str(real_assets)))
    assert not found
    assert skipped == {"mixed": "has no task that generated objects do for, beside the real ones"}


def test_each_training_of_a_split_leaves_out_another_tenth() -> None:
    split, counted = (
        Arm(name="a", objects="real", tasks=("CloseBox",)),
        Arm(name="b", objects="generated", count=9, tasks=("CloseBox",)),
    )
    told = ExperimentConfig(
        title="", about="", minutes_a_task=1, scenes=1, episodes=1, control_episodes=1, tenth=9, arms=(split, counted)
    )
    assert [told.words(split, number) for number in range(3)] == [
        ("train-9", "test-9"),
        ("train", "test"),
        ("train-1", "test-1"),
    ]
    assert told.words(counted, 1) == ("all", "test")
    assert told.model_copy(update={"unseen": "new"}).words(split, 1) == ("train", "new")


def test_tasks_without_unseen_objects_are_left_out_of_an_arm_and_named() -> None:
    arm = {"name": "split", "objects": "generated", "tasks": ["CloseBox", "SwingDoorOpen"]}
    base = {"title": "a", "about": "a", "minutes_a_task": 1, "scenes": 1, "episodes": 1, "control_episodes": 1}
    record = ExperimentRecord(config=ExperimentConfig.model_validate({**base, "arms": [arm]}), seed=0, assets=BUILTIN)
    found, skipped = runnable(record)
    assert [each.tasks for each in found] == [("CloseBox",)]
    assert list(skipped) == ["split/SwingDoorOpen"]
    assert "a test split needs at least 10" in skipped["split/SwingDoorOpen"]
