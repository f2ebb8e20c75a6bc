"""The folder of an earlier training may be untrusted: bad links, names and plans in it are refused in one line."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.core.errors import InputError
from gensim2.policy.checkpoint import DataRecord
from gensim2.policy.keypose.adding import DATA, take_along
from gensim2.policy.keypose.data import RECORD, read_planned
from gensim2.policy.keypose.source import PlannedSource

from .made_up import made_up, written

SHARD = "shard_00000.npz"


def _shard(folder: Path, **arrays: Any) -> None:
    with np.load(folder / SHARD) as good:
        np.savez(folder / SHARD, **{**dict(good), **arrays})


def _pipe(folder: Path, name: str) -> None:
    (folder / name).unlink()
    os.mkfifo(folder / name)


def _huge(folder: Path) -> None:
    with (folder / "shard_00001.npz").open("wb") as stream:
        stream.truncate(2**31)


def _elsewhere(folder: Path) -> None:
    outside = folder.parents[2] / "outside"
    outside.mkdir()
    (outside / "secret").touch()
    folder.rename(outside / "plans")
    folder.symlink_to(outside)


HOSTILE: dict[str, tuple[Callable[[Path], Any], str]] = {
    "a link out of it": (lambda f: (f / "secret").symlink_to(f.parents[2] / "secret"), "is a link"),
    "a link to a folder": (lambda f: (f / "more").symlink_to("/etc"), "is a link"),
    "a folder elsewhere": (_elsewhere, "lies outside the folder"),
    "plans of 2 GiB": (_huge, "shard_00001.npz: is larger than 1024 MiB"),
    "a pipe for plans": (lambda f: _pipe(f, SHARD), "is a pipe"),
    "a pipe for the record": (lambda f: _pipe(f, RECORD), "is a pipe"),
    "a strategy of no step": (lambda f: _shard(f, way=np.full(32, 7, np.int16)), "strategy 7"),
    "arrays of other lengths": (lambda f: _shard(f, step=np.zeros(3, np.int16)), "the array 'step' has the shape (3,)"),
    "pickled": (lambda f: _shard(f, joints=np.array([{}] * 32, dtype=object)), "is damaged"),
    "not finite": (lambda f: _shard(f, joints=np.full((32, 9), np.nan, np.float32)), "NaN or infinity"),
    "no counts": (lambda f: _shard(f, about=np.array("[]")), "about"),
    "a negative time": (lambda f: _shard(f, about=np.array('{"scenes": 1, "failed": {}, "cpu_s": -1}')), "cpu_s"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_plans_of_a_stranger_are_refused_in_one_line(name: str, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("of somebody else")
    start, out = tmp_path / "start", tmp_path / "out"
    folder = written(made_up(), start / DATA / "PushBar")
    damage, said = HOSTILE[name]
    damage(folder)
    with pytest.raises(InputError) as told:
        take_along(start, out, ["PushBar"])
    assert said in str(told.value)
    assert "\n" not in str(told.value)
    assert not any("secret" in path.name or "passwd" in path.name for path in out.rglob("*"))
    assert not any(path.stat().st_size > 2**30 for path in out.rglob("*")), "it was copied first"


def test_plans_come_along_as_they_are(tmp_path: Path) -> None:
    written(made_up(), tmp_path / "start" / DATA / "PushBar")
    (found,) = take_along(tmp_path / "start", tmp_path / "out", ["PushBar"])
    assert found.scenes == read_planned(tmp_path / "start" / DATA / "PushBar").scenes


def test_a_task_of_a_path_and_a_robot_of_a_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"tasks\.0"):
        DataRecord(digest="", tasks=("../../../etc",), episodes=1, frames=1, folders=())
    planned = made_up()
    named = replace(planned, record=planned.record.model_copy(update={"robot": f"{tmp_path}/canary.py"}))
    (tmp_path / "canary.py").write_text("raise SystemExit")
    with pytest.raises(InputError, match="is not loaded"):
        PlannedSource([named])
