"""Resumable folders: one owner, equal settings, and an error that names the setting that differs."""

from __future__ import annotations

import errno
import os
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import Field

from gensim2.core.errors import InputError, WriteError
from gensim2.core.resumable import FolderLock, ResumableFolder, RunSettings, command_line


class Asked(RunSettings):
    FREE = frozenset({"steps", "nested.title"})

    seed: int = 0
    steps: int = 1
    nested: dict[str, Any] = Field(default={"title": "first", "depth": {"sigma": 0.1}})


def opened(path: Path, resume: bool = False, **settings: Any) -> ResumableFolder[Asked]:
    return ResumableFolder(path, "asked.json", Asked(**settings), holds="a run", resume=resume)


@pytest.mark.parametrize(
    ("change", "field", "message"),
    [
        ({"seed": 3}, "seed", "was begun with 0, not 3"),
        ({"nested": {"depth": {"sigma": 0.2}}}, "nested.depth.sigma", "was begun with 0.1, not 0.2"),
        ({"nested": {}}, "nested.depth", "was begun with {'sigma': 0.1}, not None"),
    ],
)
def test_other_settings_are_refused_by_name(tmp_path: Path, change: dict[str, Any], field: str, message: str) -> None:
    with opened(tmp_path / "out"):
        pass
    with pytest.raises(InputError) as caught:
        opened(tmp_path / "out", resume=True, **change)
    assert (caught.value.field, caught.value.message) == (field, message)
    assert caught.value.file == tmp_path / "out" / "asked.json"
    with opened(tmp_path / "out", resume=True):
        pass  # an error releases the lock


def test_free_settings_may_change_and_the_first_record_stays(tmp_path: Path) -> None:
    with opened(tmp_path):
        before = (tmp_path / "asked.json").stat().st_mtime_ns
    nested = {"title": "other", "depth": {"sigma": 0.1}}
    with opened(tmp_path, resume=True, steps=9, nested=nested) as folder:
        assert folder.record == Asked()
        assert (tmp_path / "asked.json").stat().st_mtime_ns == before


def test_a_folder_has_one_owner_and_holds_nothing_else(tmp_path: Path) -> None:
    with opened(tmp_path / "out"), pytest.raises(InputError, match="another run is using this folder"):
        opened(tmp_path / "out", resume=True)
    with pytest.raises(InputError, match=r"holds a run already \(add --resume .*delete the folder"):
        opened(tmp_path / "out")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "file").touch()
    with pytest.raises(InputError, match="is not empty, but contains no run"):
        opened(tmp_path / "other")


def test_of_several_runs_that_start_together_one_goes_on(tmp_path: Path) -> None:
    for number in range(30):
        found = started_together(tmp_path / str(number), 3)
        refused = [each for each in found if isinstance(each, str)]
        assert len(refused) == 2, found
        assert all(each.startswith("another run is using this folder") for each in refused)
        (won,) = (each for each in found if isinstance(each, ResumableFolder))
        with won:
            pass


def started_together(out: Path, count: int) -> list[object]:
    """Open a folder in several threads at the same moment; return the opened folders and the errors' messages."""
    barrier, found = threading.Barrier(count), list[object]()

    def start() -> None:
        barrier.wait()
        try:
            found.append(opened(out, resume=True))
        except InputError as error:
            found.append(error.message)

    threads = [threading.Thread(target=start) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


LEFT = ".asked.json.0123456789abcdef.tmp.json"


def test_leftovers_of_killed_runs_are_removed_but_not_in_subfolders_that_other_runs_may_own(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    for folder in (tmp_path, tmp_path / "sub"):
        (folder / LEFT).touch()
    with ResumableFolder(tmp_path, "asked.json", Asked(), holds="a run", resume=True, alone=False):
        assert not (tmp_path / LEFT).exists()
    assert (tmp_path / "sub" / LEFT).exists()
    with opened(tmp_path, resume=True):
        assert not (tmp_path / "sub" / LEFT).exists()


def test_a_leftover_that_cannot_be_removed_does_not_hide_the_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unlink(path: Path, missing_ok: bool = False) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    with pytest.raises(WriteError, match="disk of the run"), opened(tmp_path):  # noqa: PT012
        (tmp_path / LEFT).touch()
        monkeypatch.setattr(Path, "unlink", unlink)
        raise WriteError("the disk of the run")
    with pytest.raises(WriteError, match=r"cannot write: Read-only file system \(choose another folder"):
        opened(tmp_path, resume=True)


@pytest.mark.parametrize(("make", "said"), [(os.mkfifo, "is a pipe"), (os.mkdir, "is a folder")])
def test_a_lock_is_a_file(tmp_path: Path, make: Callable[[Path], None], said: str) -> None:
    make(tmp_path / FolderLock.NAME)
    with pytest.raises(InputError, match=rf"\.lock: {said}, not a file \(remove it\)"):
        FolderLock(tmp_path)


def removed(out: Path, is_back: bool) -> None:
    shutil.rmtree(out)
    if is_back:
        out.mkdir()
        (out / FolderLock.NAME).touch()


@pytest.mark.parametrize("is_back", [False, True])
def test_a_run_does_not_end_well_if_its_folder_was_removed(tmp_path: Path, is_back: bool) -> None:
    for kind in (opened, FolderLock):
        out = tmp_path / kind.__name__
        with pytest.raises(WriteError, match=r"was removed or replaced during the run \(run it again\)"), kind(out):
            removed(out, is_back)


def test_a_run_that_fails_in_a_removed_folder_keeps_its_reason(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(OSError, match="No such file"), opened(out):
        (out / str(removed(out, False)) / "file").read_bytes()


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("/usr/bin/gensim2", ["demo", "OpenBox"]),
        ("/lib/python3/gensim2/__main__.py", ["demo", "OpenBox"]),
        ("my_script.py", []),
        ("", []),
    ],
)
def test_the_command_line_of_another_program_is_not_recorded(
    program: str, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", [program, "demo", "OpenBox"])
    assert command_line() == words
