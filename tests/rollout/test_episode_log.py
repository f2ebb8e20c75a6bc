"""A log of episodes: finished ones are read, a truncated line is run again, and an invalid line is an error."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "kill"))

import fake_world

from gensim2.core.errors import InputError
from gensim2.data.runfolder import TaskFolder
from gensim2.data.store import TaskStore
from gensim2.rollout import episode_log
from gensim2.rollout.episode_log import EpisodeLog, episodes_in, read_log
from gensim2.tasks.library import load_task

TASK = load_task("OpenDrawer")
SEEDS = (11, 12, 13)

pytestmark = pytest.mark.fast


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A log of the first two of three episodes."""
    log = EpisodeLog(tmp_path / "attempts.jsonl", SEEDS)
    for index in (1, 0):
        log.add(index, fake_world.episode_of(TASK, SEEDS[index], held=True))
    return log.path


def test_an_episode_comes_back_with_its_place(path: Path) -> None:
    first, second = read_log(path)
    assert (first.index, second.index) == (0, 1)
    assert first.at(-1) == fake_world.episode_of(TASK, SEEDS[0], held=True)
    assert "index" not in first.to_dict()


def test_a_cut_off_line_is_dropped_by_a_log_and_refused_in_a_data_set(path: Path, tmp_path: Path) -> None:
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    assert [None if each is None else each.index for each in episodes_in(path)] == [1, None]
    assert list(EpisodeLog(path, SEEDS).done) == [1]
    assert path.read_bytes() == whole.splitlines(keepends=True)[0]
    TaskFolder(tmp_path).write_task(TASK)
    rows = tmp_path / "episodes.jsonl"
    rows.write_bytes(b"".join(reversed(whole.splitlines(keepends=True)))[:-1])
    with pytest.raises(InputError, match=r"line 2: is incomplete"):
        list(TaskStore(tmp_path).rows())


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (b"{}\n", "line 1"),
        (b"not JSON\n", "line 1"),
        (b"[" * 200 + b"\n", "line 1: has over 0 MiB"),
    ],
)
def test_a_line_that_is_none_is_named(
    line: bytes, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(episode_log, "MAX_LINE", 100)
    path = tmp_path / "attempts.jsonl"
    path.write_bytes(line)
    with pytest.raises(InputError, match=message):
        EpisodeLog(path, SEEDS)


def test_an_episode_without_its_place_is_refused(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b'"index": 1, ', b""))
    with pytest.raises(InputError, match="line 1: index: is missing"):
        EpisodeLog(path, SEEDS)
