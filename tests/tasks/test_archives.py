"""Archives of tasks that are damaged, encrypted or in unknown formats: an error of one line."""

from __future__ import annotations

import os
import tracemalloc
import zipfile
from pathlib import Path

import pytest

from gensim2.cli.main import run
from gensim2.core.errors import InputError
from gensim2.core.foreign.limits import MAX_ENTRIES
from gensim2.policy.array_file import read_arrays
from gensim2.tasks.library import load_task, packaged_names, task_folder, task_names, using_library


@pytest.fixture
def archive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A task of the package with another name, as in the user's own library."""
    path = tmp_path / "tasks.zip"
    text = (task_folder(packaged_names()[0]) / "task.yaml").read_text()
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("Mine/task.yaml", text.replace(packaged_names()[0], "Mine"))
    monkeypatch.setenv("GENSIM2_LIBRARY", str(path))
    return path


def patched(path: Path, local: int, central: int, value: int) -> None:
    """Change two bytes at these positions of both headers of the first file."""
    data = bytearray(path.read_bytes())
    begin = data.index(b"PK\x01\x02")
    for place in (local, begin + central):
        data[place : place + 2] = value.to_bytes(2, "little")
    path.write_bytes(data)


def test_a_good_one_is_read(archive: Path) -> None:
    assert "Mine" in task_names()
    assert load_task("Mine").name == "Mine"


@pytest.mark.parametrize(
    ("local", "central", "value", "said"),
    [(6, 8, 1, "encrypted"), (8, 10, 99, "not supported"), (8, 10, 97, "not supported")],
)
def test_encryption_and_unknown_methods_are_one_line(
    archive: Path, local: int, central: int, value: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    patched(archive, local, central, value)
    with pytest.raises(InputError, match=said):
        load_task("Mine")
    assert run(["tasks", "show", "Mine"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_every_cut_is_one_line(archive: Path) -> None:
    good = archive.read_bytes()
    for size in range(0, len(good), 7):
        archive.write_bytes(good[:size])
        with pytest.raises(InputError):
            load_task("Mine")


def test_a_pipe_is_no_archive(archive: Path) -> None:
    archive.unlink()
    os.mkfifo(archive)
    with pytest.raises(InputError):
        load_task("Mine")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_method_that_unpacks_more_than_is_asked_for_is_refused(archive: Path, method: int) -> None:
    with zipfile.ZipFile(archive, "w", method) as file:
        file.writestr("Mine/task.yaml", bytes(2**26))
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="not supported"):
            load_task("Mine")
        assert tracemalloc.get_traced_memory()[1] < 2**24
    finally:
        tracemalloc.stop()


def test_members_are_counted_before_the_directory_is_read(archive: Path) -> None:
    """A directory of 256 MiB would make 5.8 million Python objects."""
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("a", b"")
    data = archive.read_bytes()
    begin, end = data.index(b"PK\x01\x02"), data.index(b"PK\x05\x06")
    count = MAX_ENTRIES + 1
    size = count * (end - begin)
    tail = data[end : end + 12] + size.to_bytes(4, "little") + data[end + 16 :]
    archive.write_bytes(data[:begin] + data[begin:end] * count + tail)
    with zipfile.ZipFile(archive) as file:
        assert len(file.infolist()) == count
    tracemalloc.start()
    try:
        for read in (lambda: load_task("Mine"), lambda: read_arrays(archive)):
            with pytest.raises(InputError, match="has over 100"):
                read()
        assert tracemalloc.get_traced_memory()[1] < 2**24
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", ["file", "fifo"])
def test_a_library_that_is_neither_a_folder_nor_an_archive_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (tmp_path / "file").write_text("")
    os.mkfifo(tmp_path / "fifo")
    refused = r"must be a folder or a \.zip file"
    with pytest.raises(InputError, match=refused), using_library(str(tmp_path / name)):
        load_task("OpenDrawer")  # a task of the package does not need the library; the option is checked nevertheless
    monkeypatch.setenv("GENSIM2_LIBRARY", str(tmp_path / name))
    with pytest.raises(InputError, match=refused):
        task_names()
