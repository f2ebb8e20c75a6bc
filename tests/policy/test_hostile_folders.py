"""``learn --resume`` and ``--from`` with folders in which one file is damaged: refused in one line, or made again.

``KINDS`` lists every kind of file that ``learn`` leaves.
"""

from __future__ import annotations

import fnmatch
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gensim2.cli.main import run
from gensim2.core.processes.pool import WorkerPool
from gensim2.policy import learn_settings, teachers, train
from gensim2.policy.keypose import data

pytest.importorskip("mani_skill")

BASE = ["--assets", "builtin", "--minutes", "0.001", "--scenes", "2", "--workers", "1", "--objects", "2"]
BASE += ["--episodes", "1", "--control-episodes", "1", "--controls", "no-op", "--videos", "1"]
COMMANDS = {
    "plans": ["learn", "CloseBox", "OpenBox", "--multi-task", *BASE],
    "episodes": ["learn", "CloseBox", "--policy", "chunk", *BASE],
}
EVALUATED = ("run.json", "tasks/*/attempts.jsonl", "tasks/*/*/000000.h5", "tasks/*/trajectory.*", "tasks/*/*.mp4")
CHECKPOINT = ("config.json", "weights-*.safetensors", "clouds.npz")
RECORDS = ("learn.json", "training/state.json", "training/state-*.safetensors", "training/curves.jsonl")
PAGES = ("report.html", "result.json")
LOCKS = (".lock", ".learn.lock", "data/.lock", "evaluation/*.lock")
PLANS = ("keypose.json", "data/*/data.json", "data/*/shard_*.npz")
EPISODES = (
    *("data/dataset.json", "data/run.json", "data/README.md", "data/report.html"),
    *("data/*/episodes.jsonl", "data/*/task.yaml", "data/*/strategies/*.yaml"),
    *("data/*/episodes/*.h5", "data/*/observations/*.h5"),
)
ALL = (*CHECKPOINT, *RECORDS, *PAGES, *LOCKS, *(f"evaluation/*{name}" for name in EVALUATED))
KINDS = {"plans": (*ALL, *PLANS), "episodes": (*ALL, *EPISODES)}
FROM = (*CHECKPOINT, *PLANS)


class Reached(BaseException):
    """Raised where work would start that a whole folder does not need."""


def _reached(*_: Any, **__: Any) -> Any:
    raise Reached


@pytest.fixture(scope="module")
def small() -> Iterator[pytest.MonkeyPatch]:
    """Settings of the smallest trainings."""
    sizes: dict[str, Any] = {"width": 16, "layers": 1, "attention": 2, "hidden": 16}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(data, "SHARD", 2)
        patch.setattr(teachers, "LEAST_STEPS", 2)
        patch.setattr(learn_settings, "POLICY", replace(learn_settings.POLICY, **sizes))
        patch.setattr(learn_settings, "CHUNK_POLICY", replace(learn_settings.CHUNK_POLICY, **sizes))
        yield patch


@pytest.fixture(scope="module")
def learned(small: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return the folder of a finished run of a kind, which is made once."""
    made: dict[str, Path] = {}

    def call(kind: str) -> Path:
        if kind not in made:
            out = tmp_path_factory.mktemp(kind) / "out"
            assert run([*COMMANDS[kind], "--out", str(out)]) == 0
            made[kind] = out
        return made[kind]

    return call


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()
    (path / "more").touch()


def _huge(path: Path) -> None:
    with path.open("r+b") as stream:
        stream.truncate(40 * 2**30)


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _names_code(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b'"panda"', f'"{path.parents[-3]}/canary.py"'.encode()))


DAMAGES = (_pipe, _folder, _huge, _cut, _names_code)


def damaged(folder: Path, kinds: tuple[str, ...]) -> Iterator[tuple[Path, str]]:
    """Yield copies of a folder with one file of each kind damaged, and a description of the damage.

    The damages take turns from kind to kind, so that all of them occur.
    """
    files = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    for number, kind in enumerate(kinds):
        damage = DAMAGES[number % len(DAMAGES)]
        for name in fnmatch.filter(files, kind)[:1]:
            copy = folder.parent / "copy"
            shutil.rmtree(copy, ignore_errors=True)
            shutil.copytree(folder, copy)
            before, path = (copy / name).read_bytes(), copy / name
            damage(path)
            if not path.is_file() or path.stat().st_size != len(before) or path.read_bytes() != before:
                yield copy, f"{name}: {damage.__name__}"


def outcomes(words: list[str], copies: Iterator[tuple[Path, str]], capfd: Any, canary: Path) -> dict[str, object]:
    """Return exit codes by damage; a refusal is one line, nothing hangs, and the canary does not run."""
    found: dict[str, object] = {}

    def late(*_: object) -> None:
        raise AssertionError(f"{what} hangs")

    canary.write_text("from pathlib import Path\nPath(__file__).with_name('ran').touch()\n")
    before = signal.signal(signal.SIGALRM, late)
    try:
        for copy, what in copies:
            capfd.readouterr()
            signal.alarm(300)
            try:
                found[what] = run([each.format(copy=copy) for each in words])
            except Reached:
                found[what] = "made again"
            signal.alarm(0)
            said = [line for line in capfd.readouterr().err.splitlines() if line.startswith("gensim2: ")]
            assert len(said) == (found[what] == 2), (what, said)
            assert found[what] in (0, 2, "made again"), (what, said)
            assert not canary.with_name("ran").exists(), what
    finally:
        signal.signal(signal.SIGALRM, before)
    return found


def no_work(patch: pytest.MonkeyPatch) -> None:
    """Raise ``Reached`` where worker processes or gradient steps would start."""
    work = train._run

    def steps(state: Any, *rest: Any) -> float:
        return work(state, *rest) if state.step >= rest[3].steps else _reached()

    def jobs(self: WorkerPool, function: Any, jobs: Any) -> Iterator[Any]:
        del self, function
        return _reached() if list(jobs) else iter(())

    patch.setattr(WorkerPool, "map_unordered", jobs)
    patch.setattr(teachers, "seconds_a_step", _reached)
    patch.setattr(train, "_run", steps)


@pytest.mark.parametrize("kind", COMMANDS)
def test_a_damaged_folder_is_refused_in_one_line_or_mended(
    kind: str, learned: Callable[[str], Path], capfd: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = learned(kind)
    files = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    assert [name for name in files if not any(fnmatch.fnmatch(name, each) for each in KINDS[kind])] == []
    no_work(monkeypatch)
    words = [*COMMANDS[kind], "--out", "{copy}", "--resume"]
    found = outcomes(words, damaged(folder, KINDS[kind]), capfd, folder.parent / "canary.py")
    records = [name for name in found if name.startswith(("learn.json", "training/state"))]
    assert {found[name] for name in records} == {2}


def test_a_damaged_start_is_refused_in_one_line(
    learned: Callable[[str], Path], capfd: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder = learned("plans")
    no_work(monkeypatch)

    def copies() -> Iterator[tuple[Path, str]]:
        for copy, what in damaged(folder, FROM):
            shutil.rmtree(tmp_path / "out", ignore_errors=True)
            yield copy, what

    words = ["learn", "OpenDrawer", *BASE, "--from", "{copy}", "--out", str(tmp_path / "out")]
    found = outcomes(words, copies(), capfd, folder.parent / "canary.py")
    unread = ("clouds.npz", "keypose.json")
    assert {found[name] for name in found if not name.startswith(unread)} <= {2, "made again"}
    assert {found[name] for name in found if name.startswith(("config.json", "weights"))} == {2}
