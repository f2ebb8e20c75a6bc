"""The tutorial of an own object and task: its program, files and commands lead to a verified task and a policy."""

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


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Path:
    """A folder with the files of the page, and the object imported."""
    monkeypatch.chdir(tmp_path)
    exec(compile(_block("python", "## 1."), "make_chest.py", "exec"), {})
    for name in re.findall(r"`((?:CloseTeaChest|PushLid)/[\w/]+\.yaml)`", PAGE):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(_block("yaml", f"`{name}`"))
    assert cli.run(_command("assets import")) == 0
    assert capfd.readouterr().out.splitlines() == _block("text", "## 2.").splitlines()
    return tmp_path


def test_the_tutorial_leads_to_a_verified_task(page: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert (page / "mylibrary" / "pictures" / "tea_chest_1.png").read_bytes().startswith(b"\x89PNG")
    assert cli.run([*_command("design"), "--library", "none"]) == 0
    said = capfd.readouterr().out
    assert re.search(r"^CloseTeaChest .* yes ", said, re.M)
    for file in re.findall(r"^strategy: (\S+)$", said, re.M):
        assert (page / file).is_file()
    report = (page / "CloseTeaChest" / "design" / "report.html").read_text()
    shown = page / "CloseTeaChest" / "design"
    for source in re.findall(r'(?:src|href)="(tasks/[^"]+)"', report):
        assert (shown / source).is_file(), source
    assert ".mp4" in report
    assert "plan.png" in report
    assert cli.run(["solve", "CloseTeaChest", "--assets", "mylibrary", "--library", "none"]) == 0
    assert cli.run([*_command("assets import .*--force"), "--json", "again.json"]) == 0


def test_a_strategy_by_hand_is_planned_and_drawn(page: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.run([*_command("solve"), "--library", "none"]) == 0
    assert "PushLid on tea_chest/1: solved" in capfd.readouterr().out
    assert (page / "plan" / "plan.png").read_bytes().startswith(b"\x89PNG")
    strategy = page / "PushLid" / "strategies" / "push_lid.yaml"
    strategy.write_text(strategy.read_text().replace("[0.0, 0.02, 0.0]", "[0.0, 0.02, 0.6]"))
    assert cli.run(["solve", "PushLid", "--assets", "mylibrary", "--seed", "1", "--library", "none"]) == 1
    said = capfd.readouterr().out
    picture = re.search(r"^picture: (.+)$", said, re.M)
    assert picture is not None
    assert Path(picture[1]).read_bytes().startswith(b"\x89PNG")
    assert "joint axis [0, -0.7071, -0.7071]" in said
    reason = re.search(r"has a residual of (\S+) m \(tolerance 0\.001 m\)", said)
    row = re.search(r"^point2point_constraint\(tool_head, articulated_object_head\) +(\S+)", said, re.M)
    assert reason is not None
    assert row is not None
    assert float(row[1]) == pytest.approx(float(reason[1]), rel=0.01)
    assert not (page / "runs").exists()


def test_a_partial_motion_is_drawn_and_no_failure(page: Path, capfd: pytest.CaptureFixture[str]) -> None:
    strategy = page / "PushLid" / "strategies" / "push_lid.yaml"
    strategy.write_text(strategy.read_text().replace("[0.0, -0.7, -0.7]", "[0.5, 0.8, 0.0]"))
    assert cli.run(["solve", "PushLid", "--assets", "mylibrary", "--seed", "1", "--library", "none"]) == 0
    said = capfd.readouterr().out
    assert "PushLid on tea_chest/1: partial" in said
    picture = re.search(r"^picture: (.+)$", said, re.M)
    assert picture is not None
    assert Path(picture[1]).read_bytes().startswith(b"\x89PNG")


def test_the_policy_of_the_tutorial_is_trained(page: Path) -> None:
    pytest.importorskip("torch")
    small = ["--minutes", "0.05", "--scenes", "4", "--episodes", "1", "--controls", "none", "--videos", "0"]
    words = _command("learn")
    words[words.index("CloseTeaChest")] = "PushLid"  # whose strategy the page has; that of the other is found above
    assert cli.run([*words, *small, "--library", "none"]) == 0
    assert (page / "policy" / "report.html").is_file()
