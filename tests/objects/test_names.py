"""Strings that are no valid name of an object, a folder or a file."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from gensim2.cli import main as cli
from gensim2.objects import open_library


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("9" * 5000, "no instance '99999"),
        ("\N{SUPERSCRIPT TWO}", "no instance"),
        ("../1", "no instance '../1'"),
    ],
)
def test_numbers_that_are_none(word: str, message: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["assets", "show", f"drawer/{word}", "--assets", "builtin"]) == 2
    errors = capfd.readouterr().err
    assert message in errors
    assert len(errors) < 300


@pytest.mark.parametrize("where", ["", "~nobody-is-called-so/x", "x" * 300, "a/" * 3000])
def test_folders_that_are_none(where: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for words in (
        ["list", "--assets", where],
        ["list", "--kind", "rigid", "--assets", where],
        ["import", where, "--class", "box_rotate", "--name", "1", "--out", str(tmp_path)],
    ):
        assert cli.run(["assets", *words]) == 2
        errors = capfd.readouterr().err
        assert "no such folder" in errors
        assert len(errors) < 500


def test_names_too_long_for_files(
    chest: Callable[..., Path], tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))
    words = ["assets", "import", str(chest(tmp_path / "1")), "--class", "box_rotate", "--out", str(tmp_path)]
    assert cli.run([*words, "--name", "x" * 300]) == 2
    assert "is not a valid folder name" in capfd.readouterr().err
    library = tmp_path / "library" / "box_rotate"
    library.mkdir(parents=True)
    chest(library / ("y" * 90))
    assert open_library(library.parent).load("box_rotate", "y" * 90).id == "y" * 90
    (library / os.fsdecode(b"\xff")).mkdir()
    (library / os.fsdecode(b"\xff") / "mobility.urdf").touch()
    assert cli.run(["assets", "list", "--assets", str(library.parent)]) == 2
    assert "name of the folder: " in capfd.readouterr().err
