"""Files are complete or absent, and are on the disk before they get their names."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from gensim2.core import files
from gensim2.core.errors import InputError
from gensim2.core.files import append, remove_temporaries, replacing, write_atomic, write_changed, write_json


def test_a_file_is_written_and_replaced(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "data.json"
    write_json(path, {"a": 1})
    write_atomic(path, "new")
    assert path.read_text() == "new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    assert [entry.name for entry in path.parent.iterdir()] == ["data.json"]


def test_only_a_file_with_another_content_is_replaced_and_none_of_another_size_is_read(tmp_path: Path) -> None:
    path = tmp_path / "task.yaml"
    write_changed(path, "name: ö\n")
    before = path.stat()
    write_changed(path, "name: ö\n")
    assert os.path.samestat(path.stat(), before)
    for content in (b"name: o.\n", b"\xff" * before.st_size, b""):
        path.write_bytes(content)
        write_changed(path, "name: ö\n")
        assert path.read_text() == "name: ö\n"
    with path.open("r+b") as stream:
        stream.truncate(2**42)  # more than fits into any memory
    write_changed(path, "name: ö\n")
    assert path.read_text() == "name: ö\n"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_what_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "video.mp4"
    path.write_text("old")

    def write() -> None:
        with replacing(path) as temporary:
            assert temporary.suffix == ".mp4"
            temporary.write_text("half")
            raise error

    with pytest.raises(error):
        write()
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["video.mp4"]


def test_data_reach_the_disk_before_the_name_and_the_name_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    fsync, replace = os.fsync, Path.replace

    def watched_fsync(handle: int) -> None:
        order.append("folder" if stat.S_ISDIR(os.fstat(handle).st_mode) else "file")
        fsync(handle)

    def watched_replace(self: Path, target: Path) -> Path:
        order.append("rename")
        return replace(self, target)

    monkeypatch.setattr(os, "fsync", watched_fsync)
    monkeypatch.setattr(Path, "replace", watched_replace)
    write_atomic(tmp_path / "data", b"x")
    assert order == ["file", "rename", "folder"]


def test_nan_and_places_that_cannot_be_written_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "data.json", float("nan"))
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot write"):
        write_atomic(tmp_path / "file" / "data", "x")


def test_a_link_is_replaced_and_what_it_leads_to_stays(tmp_path: Path) -> None:
    """A run as root with a link to a device would otherwise replace the device by a file."""
    (tmp_path / "target").write_text("of somebody else")
    for name, target in (("a", "target"), ("b", "gone"), ("c", "c")):
        (tmp_path / name).symlink_to(target)
        write_atomic(tmp_path / name, "x")
        assert (tmp_path / name).read_text() == "x"
        assert not (tmp_path / name).is_symlink()
    assert (tmp_path / "target").read_text() == "of somebody else"
    assert not (tmp_path / "gone").exists()


def test_a_long_name_that_fits_can_be_written(tmp_path: Path) -> None:
    write_atomic(tmp_path / ("n" * 250), "x")


def test_leftovers_of_killed_writers_are_removed_and_nothing_else(tmp_path: Path) -> None:
    with replacing(tmp_path / "a" / "data.h5") as temporary:
        temporary.write_text("x")
    left = temporary.name
    (tmp_path / "a" / "data.h5").unlink()
    for name in (left, ".notes.tmp", "data.tmp", ".lock"):
        (tmp_path / "a" / name).write_text("x")
    remove_temporaries(tmp_path)
    assert sorted(entry.name for entry in (tmp_path / "a").iterdir()) == [".lock", ".notes.tmp", "data.tmp"]


def test_bytes_of_a_path_that_are_no_text_are_shown_as_escapes(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"W\xe4g") / "a.html"
    write_atomic(path, f"<p>{path.parent.name}</p>")
    append(path, path.parent.name)
    assert path.read_text() == "<p>W\\udce4g</p>W\\udce4g"


def test_a_folder_of_an_account_without_a_home_is_one_error_that_names_the_variable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def homeless() -> str:
        raise RuntimeError("could not determine the home directory")

    monkeypatch.delenv("GENSIM2_CACHE", raising=False)
    monkeypatch.setattr(files, "user_cache_dir", lambda _: homeless())
    with pytest.raises(InputError, match=r"GENSIM2_CACHE: this account has no home folder.*set GENSIM2_CACHE"):
        files.cache_dir()
    monkeypatch.setenv("GENSIM2_CACHE", "/somewhere")
    assert files.cache_dir() == Path("/somewhere")
