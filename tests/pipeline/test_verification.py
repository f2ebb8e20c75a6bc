"""Verifications: finished episodes stay, and ``verification.json`` is read again or refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gensim2.errors import InputError
from gensim2.objects import open_library
from gensim2.pipeline import worker
from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.records import Verification
from gensim2.pipeline.runfolder import RunFolder
from gensim2.pipeline.verification import UNDER_WAY, VERIFY_EPISODES, verify
from gensim2.tasks.library import load_task

TASK = load_task("OpenDrawer")


def _verify(out: Path, seed: int = 0) -> Verification:
    with RunFolder(out, {}, {}, resume=True) as run, PoolEvaluator("builtin", 0) as evaluator:
        files = run.task(TASK.name)
        return verify(TASK, {}, files, run, evaluator, open_library("builtin"), episodes=3, seed=seed)


def test_an_interrupted_verification_repeats_no_episode(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = _verify(tmp_path / "whole")
    assert len(whole.attempts) == VERIFY_EPISODES
    plain, calls = worker.attempt, []

    def counted(*arguments: object) -> object:
        calls.append(arguments)
        if len(calls) == 8:
            raise KeyboardInterrupt
        return plain(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(worker, "attempt", counted)
    with pytest.raises(KeyboardInterrupt):
        _verify(tmp_path / "run")
    log = tmp_path / "run/tasks/OpenDrawer" / UNDER_WAY
    assert len(log.read_text().splitlines()) == 7
    assert _verify(tmp_path / "run") == whole
    assert len(calls) == 8 + VERIFY_EPISODES - 7
    assert not log.exists()
    name = "tasks/OpenDrawer/verification.json"
    assert (tmp_path / "run" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    _verify(tmp_path / "run")
    assert len(calls) == 8 + VERIFY_EPISODES - 7  # read, not run


def test_a_verification_of_another_run_is_refused(tmp_path: Path) -> None:
    _verify(tmp_path)
    with pytest.raises(InputError, match=r"verification\.json: episodes: is not of this run"):
        _verify(tmp_path, seed=1)
    path = tmp_path / "tasks/OpenDrawer/verification.json"
    value = json.loads(path.read_text())
    value["successes"] += 1
    path.write_text(json.dumps(value))
    with pytest.raises(InputError, match="the counts are not those of the episodes"):
        _verify(tmp_path)
