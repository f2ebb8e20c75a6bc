"""The tutorial of an object and a task: its program, files and commands give a plan."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from gensim2.cli import main as cli

PAGE = (Path(__file__).parents[2] / "docs/tutorials/own_object.md").read_text(encoding="utf-8")


def _block(language: str, after: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", PAGE[PAGE.index(after) :], re.S)
    assert found is not None
    return found[1]


def _command(begin: str) -> list[str]:
    found = re.search(rf"^    gensim2 ({begin}.*)$", PAGE, re.M)
    assert found is not None
    return shlex.split(found[1])


def test_the_tutorial_leads_to_a_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(_block("python", "## 1."), "make_chest.py", "exec"), {})
    assert cli.run(_command("assets import")) == 0
    assert "ok     tea_chest/1" in capfd.readouterr().out
    for name in re.findall(r"`(CloseTeaChest/[\w/]+\.yaml)`", PAGE):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(_block("yaml", f"`{name}`"))
    assert cli.run([*_command("solve"), "--library", "none"]) == 0
    assert "solved" in capfd.readouterr().out
