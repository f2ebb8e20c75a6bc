"""Episode files: always the same bytes, damaged files are refused, and everything is read back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import fake_world
import h5py
import numpy as np
import pytest

from gensim2.core.errors import InputError, WriteError
from gensim2.core.sealed_file import HEADER_SIZE
from gensim2.data import TaskStore, episode_file
from gensim2.data.episode_file import DamagedEpisodeError, read_episode, read_row, write_episode
from gensim2.data.runfolder import TaskFolder
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import Recording
from gensim2.tasks.library import load_task


def made(seed: int = 1, held: bool = True) -> tuple[Episode, Recording]:
    episode = fake_world.episode_of(load_task("OpenDrawer"), seed, held=held)
    return episode, fake_world.recording(seed, {"drawer": "0"}, np.random.default_rng(seed))


def test_an_episode_comes_back_as_it_was(tmp_path: Path) -> None:
    episode, recording = made()
    digest = write_episode(tmp_path / "a.h5", episode, recording)
    stored = read_episode(tmp_path / "a.h5")
    assert stored.episode == episode.at(-1, digest)
    again = stored.recording
    assert again is not None
    for name in ("obs", "actions", "rewards", "terminated", "truncated", "success"):
        mine, theirs = getattr(recording, name), getattr(again, name)
        assert mine.dtype == theirs.dtype
        assert np.array_equal(mine, theirs)
    states = again.env_states["articulations"]["object"]
    assert np.array_equal(states, recording.env_states["articulations"]["object"])
    assert (again.seed, again.reset_options, again.instances) == (1, recording.reset_options, recording.instances)
    assert write_episode(tmp_path / "b.h5", episode, recording) == digest
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_any_hdf5_reader_opens_it_and_the_first_line_says_what_it_is(tmp_path: Path) -> None:
    episode, recording = made()
    digest = write_episode(tmp_path / "a.h5", episode, recording)
    assert (tmp_path / "a.h5").open("rb").readline() == f"gensim2-episode 1 {digest}\n".encode()
    with h5py.File(tmp_path / "a.h5") as file:
        assert np.array_equal(file["traj/actions"], recording.actions)


def test_the_record_may_stand_alone(tmp_path: Path) -> None:
    episode, _ = made(held=False)
    write_episode(tmp_path / "a.h5", episode, None)
    stored = read_episode(tmp_path / "a.h5")
    assert stored.recording is None
    assert stored.episode.at(-1) == episode


def test_every_changed_byte_and_every_cut_is_seen(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    write_episode(path, *made())
    good = path.read_bytes()
    places = [0, 15, 16, 20, 80, 200, HEADER_SIZE - 1, HEADER_SIZE, *range(600, len(good), 97), len(good) - 1]
    for place in places:
        damaged = bytearray(good)
        damaged[place] ^= 0x01
        path.write_bytes(damaged)
        with pytest.raises(DamagedEpisodeError, match=r"a\.h5: is not a finished episode"):
            read_row(path)
    for cut in (0, 1, 100, HEADER_SIZE, len(good) // 2, len(good) - 1):
        path.write_bytes(good[:cut])
        with pytest.raises(DamagedEpisodeError):
            read_row(path)
    path.write_bytes(good + b"\0")
    with pytest.raises(DamagedEpisodeError):
        read_row(path)


def test_another_version_is_named_and_is_no_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(episode_file, "_SEAL", replace(episode_file._SEAL, version=2))
    write_episode(tmp_path / "a.h5", *made())
    monkeypatch.undo()
    with pytest.raises(
        InputError, match=r"a\.h5: schema_version: is 2, but this version of gensim2 reads files with schema version 1"
    ) as raised:
        read_row(tmp_path / "a.h5")
    assert not isinstance(raised.value, DamagedEpisodeError)


def test_a_row_and_another_episodes_file_do_not_go_together(tmp_path: Path) -> None:
    TaskFolder(tmp_path).write_task(load_task("OpenDrawer"))
    store = TaskStore(tmp_path)
    for index in range(2):
        store.add(index, *made(seed=index))
    first, second = store.write_rows(2)
    assert [row.index for row in store.rows()] == [0, 1]
    assert store.read(second).episode.seed == 1
    store.path(1).write_bytes(store.path(0).read_bytes())
    assert store.is_complete(first)
    assert not store.is_complete(second)
    with pytest.raises(InputError, match="does not match the row of this episode"):
        store.read(second)


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "in_the_way").write_text("")
    with pytest.raises(WriteError, match="cannot write"):
        TaskStore(tmp_path / "in_the_way").add(0, *made())
