"""Run folders: one owner, one identity, and a clear error for damage in any file."""

from __future__ import annotations

import dataclasses
import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fake_world
import pytest

from gensim2.data import runfolder
from gensim2.rollout.episode_log import EpisodeLog
from gensim2.core.resumable import FolderLock
from gensim2.data.records import RunRecord, Verification
from gensim2.data.runfolder import RunFolder, TaskFolder, default_run_dir
from gensim2.data.store import TaskStore
from gensim2.design.designing import Chosen
from gensim2.design.designing import offline_designer
from gensim2.design.designs import Design, read_design, write_design
from gensim2.core.errors import InputError
from gensim2.core.record_files import read_record
from gensim2.rollout.checker_result import CheckerResult, Mutation, WorldCount
from gensim2.rollout.record import Episode
from gensim2.tasks.library import load_strategies, load_task
from gensim2.core.yaml_files import dump_yaml

Record = Callable[..., Any]
SEEDS = (7, 8, 9)


def test_a_task_file_of_a_terabyte_is_replaced_unread(tmp_path: Path) -> None:
    """A resumed folder may come from anybody."""
    folder, task = TaskFolder(tmp_path), load_task("OpenDrawer")
    folder.write_task(task)
    good = (tmp_path / "task.yaml").read_bytes()
    os.truncate(tmp_path / "task.yaml", 2**40)
    folder.write_task(task)
    assert (tmp_path / "task.yaml").read_bytes() == good


def test_a_second_run_in_the_same_folder_is_refused(tmp_path: Path, record: Record) -> None:
    record()
    lock = FolderLock(tmp_path / "run")
    before = (tmp_path / "run/run.json").read_bytes()
    with pytest.raises(InputError, match=rf"another run is using this folder \(process {os.getpid()}\)"):
        record(resume=True)
    assert (tmp_path / "run/run.json").read_bytes() == before
    lock.release()
    record(resume=True)


def test_a_dead_process_holds_no_lock(tmp_path: Path) -> None:
    script = (
        "import os, signal, sys; from pathlib import Path; from gensim2.core.resumable import FolderLock\n"
        "lock = FolderLock(Path(sys.argv[1])); print('held', flush=True); os.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run([sys.executable, "-c", script, tmp_path], capture_output=True, text=True, check=False)
    assert done.stdout == "held\n"
    FolderLock(tmp_path).release()


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path, record: Record) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run/thesis.tex").write_text("mine")
    with pytest.raises(InputError, match="not empty, but contains no run"):
        record()
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["thesis.tex"]


def test_a_finished_run_is_not_begun_again(record: Record) -> None:
    record()
    with pytest.raises(InputError, match="holds a run already"):
        record()


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"seed": 1}, "arguments.seed"),
        ({"episodes": 7}, "arguments.episodes"),
        ({"instances": "train"}, "arguments.instances"),
        ({"physics": "original"}, "arguments.physics"),
        ({"open_loop": True}, "arguments.open_loop"),
        ({"randomization": "wide"}, "arguments.randomization"),
    ],
)
def test_other_arguments_are_refused(record: Record, change: dict[str, Any], field: str) -> None:
    record()
    with pytest.raises(InputError, match=field.replace(".", r"\.")):
        record(resume=True, **change)


def _task_folder(folder: Path, **changes: Any) -> str:
    spec, strategies = load_task("OpenDrawer").model_dump(mode="json"), load_strategies("OpenDrawer")
    spec.update({key: value for key, value in changes.items() if key in spec})
    files = TaskFolder(folder)
    for data in strategies.values():
        data.update({key: value for key, value in changes.items() if key not in spec})
    files.write_strategies(strategies)
    (folder / "task.yaml").write_text(dump_yaml(spec))
    return str(folder)


@pytest.mark.parametrize(
    ("change", "field"), [({"let_go": 0.07}, "identity.strategies"), ({"max_episode_steps": 7}, "identity.task")]
)
def test_other_strategies_or_another_task_are_refused(
    tmp_path: Path, record: Record, change: dict[str, Any], field: str
) -> None:
    record(task=_task_folder(tmp_path / "task"))
    before = {path: path.read_bytes() for path in (tmp_path / "run").rglob("*") if path.is_file()}
    _task_folder(tmp_path / "task", **change)
    changed = f"run.json: {field}: the {field.removeprefix('identity.')} changed after the run began .*delete the folder"
    with pytest.raises(InputError, match=changed):
        record(task=str(tmp_path / "task"), resume=True)
    assert {p: p.read_bytes() for p in before if p.name != ".lock"} == {
        p: content for p, content in before.items() if p.name != ".lock"
    }


def test_other_versions_are_refused(record: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    record()
    monkeypatch.setattr(runfolder, "versions", lambda *_: {"python": "2.7"})
    with pytest.raises(InputError, match=r"versions\.\w+: was begun with"):
        record(resume=True)


def test_a_changed_object_is_refused(tmp_path: Path, record: Record) -> None:
    record()
    path = tmp_path / "run/run.json"
    value = json.loads(path.read_text())
    key = next(iter(value["assets"]))
    value["assets"][key] = "0" * 64
    path.write_text(json.dumps(value))
    with pytest.raises(InputError, match=f"assets.{key}: the object has changed since the run began"):
        record(resume=True)


def test_an_episode_with_another_object_is_refused(tmp_path: Path, record: Record) -> None:
    record()
    store = TaskStore(tmp_path / "run/tasks/OpenDrawer")
    row = next(row for row in store.rows() if row.held)
    stored = store.read(row)
    other = {name: dataclasses.replace(each, content_hash="0" * 64) for name, each in row.objects.items()}
    store.add(row.index, dataclasses.replace(row, objects=other), stored.recording)
    with pytest.raises(InputError, match="the episode was recorded with a different version of the object drawer/"):
        record(resume=True)


def _set(**fields: Any) -> Callable[[bytes], bytes]:
    def change(content: bytes) -> bytes:
        value = json.loads(content.splitlines()[0] if content.count(b"\n{") else content)
        value.update(fields)
        return json.dumps(value).encode() + b"\n"

    return change


DAMAGE: dict[str, Callable[[bytes], bytes]] = {
    "an empty object": lambda _: b"{}\n",
    "a list": lambda _: b"[]\n",
    "nothing": lambda _: b"\n",
    "no JSON": lambda content: content.replace(b":", b";"),
    "not UTF-8": lambda content: content.replace(b"e", b"\xff"),
    "a flipped byte": lambda content: bytes([content[0] ^ 0x40]) + content[1:],
    "NaN": lambda content: content.replace(b"0", b"NaN"),
    "deeply nested": lambda _: b"[" * 100_000 + b"\n",
    "a number of 5,000 digits": lambda _: b'{"seed": ' + b"1" * 5000 + b"}\n",
    "an unknown field": _set(unknown=1),
}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("name", ["run.json", "attempts.jsonl"])
def test_damage_is_one_clear_error(tmp_path: Path, record: Record, name: str, damage: str) -> None:
    path = tmp_path / "run" / name
    if name == "run.json":
        record()
    else:
        _log(path)
    path.write_bytes(DAMAGE[damage](path.read_bytes()))
    with pytest.raises(InputError) as raised:
        record(resume=True) if name == "run.json" else EpisodeLog(path, SEEDS)
    assert str(raised.value.file).endswith(name)
    assert raised.value.remedy
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("fields", "field"),
    [
        ({"schema_version": 99}, "schema_version"),
        ({"schema_version": 3}, "schema_version"),
        ({"schema_version": "4"}, "schema_version"),
        ({"arguments": []}, "arguments"),
        ({"assets": {"drawer/0": 1}}, "assets.drawer/0"),
        ({"identity": None}, "identity"),
        ({"resumed": -1}, "resumed"),
    ],
)
def test_wrong_fields_of_run_json_are_named(tmp_path: Path, record: Record, fields: dict[str, Any], field: str) -> None:
    record()
    path = tmp_path / "run/run.json"
    path.write_bytes(_set(**fields)(path.read_bytes()))
    with pytest.raises(InputError) as raised:
        record(resume=True)
    assert raised.value.field == field


@pytest.mark.parametrize(
    ("fields", "field"),
    [
        ({"index": -1}, "line 1: index"),
        ({"index": 10**9}, "line 1: seed"),
        ({"seed": 1}, "line 1: seed"),
        ({"seed": "1"}, "line 1: seed"),
        ({"held": 1}, "line 1: held"),
        ({"cause": "bad luck"}, "line 1: cause"),
        ({"objects": {"drawer": 1}}, "line 1: objects.drawer"),
    ],
)
def test_wrong_fields_of_an_attempt_are_named(tmp_path: Path, fields: dict[str, Any], field: str) -> None:
    path = tmp_path / "attempts.jsonl"
    _log(path)
    path.write_bytes(_set(**fields)(path.read_bytes()))
    with pytest.raises(InputError) as raised:
        EpisodeLog(path, SEEDS)
    assert raised.value.field == field


def _episode(seed: int, held: bool) -> Episode:
    return fake_world.episode_of(load_task("OpenDrawer"), seed, held=held, end=0.9 if held else None)


def _log(path: Path) -> None:
    """Write the log of a benchmark."""
    log = EpisodeLog(path, SEEDS)
    for index, seed in enumerate(SEEDS):
        log.add(index, _episode(seed, seed != 8))


def test_design_and_verification_come_back_or_are_refused(tmp_path: Path) -> None:
    folder = TaskFolder(tmp_path)
    assert folder.verification() is None
    assert read_design(folder.path) is None
    verification = Verification((_episode(1, True), _episode(2, False)), 0.5, "new")
    folder.write_verification(verification)
    write_design(folder.path, Design((), None, ("nothing planned",)))
    assert folder.verification() == verification
    assert folder.checker() is None
    checker = CheckerResult.of([[WorldCount(None, str(Mutation.AT_START), "drawer", ("articulated_open",), 3, 1)]])
    folder.write_checker(checker)
    assert folder.checker() == checker
    design = read_design(folder.path)
    assert design is not None
    assert design.notes == ["nothing planned"]
    files = {
        "verification.json": folder.verification,
        "checker.json": folder.checker,
        "design.json": lambda: read_design(folder.path),
    }
    for name, read in files.items():
        content = (tmp_path / name).read_bytes()
        for change in (*DAMAGE.values(), _set(schema_version=99), _set(held=2, notes=[])):
            if change(content) == content:
                continue
            (tmp_path / name).write_bytes(change(content))
            with pytest.raises(InputError, match=name) as raised:
                read()
            assert raised.value.remedy == "delete the file and resume"


POISON = [b"\x00", b"\xff\xfe", b"NaN", b"1e999", b"-1", b"null", b"{", b"]", b'"', b"\n"]


def _mutated(content: bytes, dice: random.Random) -> bytes:
    """Return damaged bytes: flipped, removed, repeated or replaced."""
    value = bytearray(content)
    for _ in range(dice.randint(1, 4)):
        at = dice.randrange(len(value) + 1)
        kind = dice.randrange(4)
        if kind == 0 and at < len(value):
            value[at] ^= 1 << dice.randrange(8)
        elif kind == 1:
            del value[at : at + dice.randint(1, 30)]
        elif kind == 2:
            value[at:at] = value[at : at + dice.randint(1, 200)]
        else:
            value[at:at] = dice.choice(
                [b"\x00", b"\xff\xfe", b"NaN", b"1e999", b"-1", b"null", b"{", b"]", b'"', b"\n"]
            )
    return bytes(value)


def test_mutated_files_are_read_or_refused(tmp_path: Path, record: Record) -> None:
    """3,000 files are read or raise an InputError, and nothing else."""
    record()
    run, dice = tmp_path / "run", random.Random(0)
    task = TaskFolder(run / "tasks/OpenDrawer")
    task.write_verification(Verification((_episode(1, True), _episode(2, False)), 0.5, "new"))
    write_design(task.path, Design((), {"designed": {"constraint_list": []}}, ("found",)))
    attempts = run / "attempts.jsonl"
    _log(attempts)
    store = TaskStore(task.path)
    row = next(row for row in store.rows() if row.held)
    readers: dict[Path, Callable[[], object]] = {
        run / "run.json": lambda: read_record(run / "run.json", RunRecord, "choose another --out"),
        attempts: lambda: EpisodeLog(attempts, SEEDS),
        task.verification_path: task.verification,
        task.path / "design.json": lambda: read_design(task.path),
        store.path(row.index): lambda: store.read(row),
    }
    refused: dict[Path, list[InputError]] = {path: [] for path in readers}
    for path, read in readers.items():
        content = path.read_bytes()
        for _ in range(600):
            path.write_bytes(_mutated(content, dice))
            try:
                read()
            except InputError as error:
                refused[path].append(error)
        path.write_bytes(content)
    assert all(len(errors) > 60 for errors in refused.values())
    assert all("\n" not in str(error) and error.remedy for errors in refused.values() for error in errors)


def test_runs_that_begin_in_one_second_have_folders_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(time, "strftime", lambda *_: "20260101-120000")
    folders = []
    for _ in range(3):
        folders.append(default_run_dir())
        folders[-1].mkdir(parents=True)
    assert [folder.name for folder in folders] == ["20260101-120000", "20260101-120000-2", "20260101-120000-3"]


def test_two_folders_are_two_runs(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "a", {}, {}, False) as first, RunFolder(tmp_path / "b", {}, {}, False) as second:
        assert first.path != second.path
    with RunFolder(tmp_path / "a", {}, {}, True) as again:
        assert again.record.resumed == 1


@pytest.mark.parametrize(
    ("name", "was", "now"), [("runs", 2, 1), ("scenes", "recorded", "drawn"), ("wish", "drawer", None)]
)
def test_what_the_episodes_follow_from_is_the_same_on_resume(tmp_path: Path, name: str, was: Any, now: Any) -> None:
    with RunFolder(tmp_path / "run", {"command": "benchmark", name: was}, {}, False):
        pass
    record = (tmp_path / "run" / "run.json").read_bytes()
    with pytest.raises(InputError, match=rf"arguments\.{name}: was begun with"):
        RunFolder(tmp_path / "run", {"command": "benchmark", name: now}, {}, True)
    assert (tmp_path / "run" / "run.json").read_bytes() == record


def test_wishes_add_up() -> None:
    both = offline_designer("explore", "drawer", lambda task: True)
    assert isinstance(both, Chosen)
    assert both.wish == "explore, drawer"
