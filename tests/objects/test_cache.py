"""Changed files in the cache are made again."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gensim2.cli import main as cli
from gensim2.objects import ArticulatedObject, open_library

Change = Callable[[Path], object]


@pytest.fixture(scope="module")
def filled(chest: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A library of one chest, and a cache in which it is prepared."""
    library, cache = tmp_path_factory.mktemp("assets"), tmp_path_factory.mktemp("cache")
    chest(library / "box_rotate" / "1")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GENSIM2_CACHE", str(cache))
        open_library(library).load("box_rotate", "1")
    return library, cache


def load(filled: tuple[Path, Path], cache: Path, monkeypatch: pytest.MonkeyPatch) -> ArticulatedObject:
    monkeypatch.setenv("GENSIM2_CACHE", str(cache))
    return open_library(filled[0]).load("box_rotate", "1")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(bytes(content))


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


WAYS: tuple[Change, ...] = (
    Path.unlink,
    flip,
    pipe,
    lambda path: path.write_bytes(b""),
    lambda path: path.write_bytes(path.read_bytes()[:-9]),
)


@pytest.mark.parametrize("way", WAYS, ids=("gone", "flipped", "pipe", "empty", "cut"))
@pytest.mark.parametrize("name", ["instance.json", "mobility.urdf", "files.json", "visual/link_0.glb"])
def test_a_damaged_object_is_made_again(
    filled: tuple[Path, Path], name: str, way: Change, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(filled[1], tmp_path / "cache")
    entry = next((tmp_path / "cache" / "objects").iterdir())
    good = contents(entry)
    assert name in good
    way(entry / name)
    instance = load(filled, tmp_path / "cache", monkeypatch)
    assert contents(entry) == good
    assert instance.urdf == entry / "mobility.urdf"
    assert [p.name for p in entry.parent.iterdir()] == [entry.name]


@pytest.mark.parametrize("way", [flip, pipe, *WAYS[3:]], ids=("flipped", "pipe", "empty", "cut"))
def test_damaged_convex_parts_are_made_again(
    filled: tuple[Path, Path], way: Change, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(filled[1], tmp_path / "cache")
    shutil.rmtree(tmp_path / "cache" / "objects")
    file = next((tmp_path / "cache" / "hulls").iterdir())
    with np.load(file) as data:
        good = {name: data[name].copy() for name in data}
    way(file)
    instance = load(filled, tmp_path / "cache", monkeypatch)
    with np.load(file) as data:
        assert all(np.array_equal(data[name], good[name]) for name in good)
    assert sum(len(hulls) for hulls in instance.hulls.values()) == len(good["sizes"])


@pytest.mark.parametrize("make", [Path.touch, os.mkfifo, lambda path: path.symlink_to("/gone")])
def test_something_else_in_the_place_of_an_object_makes_way(
    filled: tuple[Path, Path], make: Change, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(filled[1], tmp_path / "cache")
    entry = next((tmp_path / "cache" / "objects").iterdir())
    shutil.rmtree(entry)
    make(entry)
    assert load(filled, tmp_path / "cache", monkeypatch).urdf.is_file()


def test_what_others_put_beside_is_left(
    filled: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(filled[1], tmp_path / "cache")
    entry = next((tmp_path / "cache" / "objects").iterdir())
    (entry / "stray").touch()
    load(filled, tmp_path / "cache", monkeypatch)
    assert (entry / "stray").exists()


def test_a_damaged_rigid_object_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path))
    folder = open_library("builtin").load_rigid("mug").folder
    good = contents(folder)
    flip(folder / "hull_0.obj")
    assert open_library("builtin").load_rigid("mug").folder == folder
    assert contents(folder) == good


@pytest.mark.parametrize("place", ["/dev/null", "/proc/nowhere", "/dev/null/x"])
def test_a_cache_that_cannot_be_written_says_so(
    filled: tuple[Path, Path], place: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("GENSIM2_CACHE", place)
    for words in (["drawer/1", "--assets", "builtin"], ["box_rotate/1", "--assets", str(filled[0])]):
        assert cli.run(["assets", "show", *words]) == 2
        errors = [line for line in capfd.readouterr().err.splitlines() if not line.startswith("preparing ")]
        assert len(errors) == 1
        assert "set GENSIM2_CACHE to a folder that can be written to" in errors[0]
