"""A command's output and its page show the same numbers, in a fake world."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from html.parser import HTMLParser
from pathlib import Path

import pytest
from click.testing import CliRunner

from gensim2 import design
from gensim2.cli.main import cli

#: Results and demonstrations of a task.
Row = dict[str, str]


class Page(HTMLParser):
    """A report: the rows of its overview, and the heading, badge, results and demonstrations of each task's card."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.overview: list[list[str]] = []
        self.cards: dict[str, list[str]] = {}
        self._card, self._in_overview = "", False
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag == "section":
            self._card = given.get("id") or ""
        elif tag == "table":
            self._in_overview = given.get("class") == "overview"
        elif tag == "tr" and self._in_overview:
            self.overview.append([])
        elif tag in ("td", "th") and self._in_overview:
            self.overview[-1].append("")

    def handle_data(self, data: str) -> None:
        words = " ".join(data.split())
        if self._in_overview and self.overview and self.overview[-1] and words:
            self.overview[-1][-1] += words
        elif self._card and words:
            self.cards.setdefault(self._card, []).append(words)

    def handle_endtag(self, tag: str) -> None:
        if tag == "table":
            self._in_overview = False

    def tasks(self) -> dict[str, Row]:
        """Return the overview by task."""
        head, *rows = self.overview
        # In a narrow window, the interval stands below the number of episodes that held, in the same cell.
        cells = [[re.sub(r"^(\d+/\d+)\d\.\d\d–.*$", r"\1", cell) for cell in row] for row in rows]
        return {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in cells}

    def verdicts(self, task: str) -> Row:
        """Return the results of a card (first of verification or collection) by name."""
        words = self.cards[task]
        return {name: words[words.index(name) + 1] for name in ("paper", "held", "strict")}


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Return a function that runs a command line in this process and returns its standard output."""
    monkeypatch.setattr(design, "run_pipeline", partial(_here, design.run_pipeline))
    monkeypatch.setattr(design, "demo", partial(_here, design.demo))

    def call(*words: str) -> str:
        done = CliRunner().invoke(cli, [*words, "--assets", "builtin", "--videos", "0", "--library", "none"])
        assert done.exit_code == 0, done.output
        return done.stdout

    return call


def _here(function: Callable[..., object], *arguments: object, **given: object) -> object:
    return function(*arguments, **{**given, "workers": 0})


def test_the_page_of_a_run_says_what_the_terminal_says(tmp_path: Path, here: Callable[..., str]) -> None:
    stored = [word for name in ("OpenDrawer", "CloseBox", "OpenSafe") for word in ("--stored-task", name)]
    count = ("--single", "0", "--long", "0", "--episodes", "3", "--verify", "6")
    said = here("run-pipeline", *count, *stored, "--out", str(tmp_path))
    page = Page(tmp_path / "report.html")
    head, *rows = [re.split(r"  +", line) for line in said.splitlines() if "  " in line]
    printed = {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in rows}
    assert {task: row["kept"] for task, row in printed.items()} == {
        "OpenDrawer": "yes", "CloseBox": "no", "OpenSafe": "no"
    }, "kept ones, and others"
    for task, row in printed.items():
        verdicts = {name: row[name] for name in ("paper", "held", "strict")}
        assert page.verdicts(task) == verdicts
        assert ("kept" in page.cards[task]) == (row["kept"] == "yes")
        assert f"{row['demos']} demonstrations ·" in page.cards[task]
    assert page.tasks().keys() == {task for task, row in printed.items() if row["kept"] == "yes"}
    for task, shown in page.tasks().items():
        row = printed[task]
        assert {name: shown[name] for name in ("paper", "held", "strict")} == page.verdicts(task)
        assert shown["demonstrations"] == row["demos"]


def test_the_page_of_demonstrations_says_what_the_terminal_says(tmp_path: Path, here: Callable[..., str]) -> None:
    said = here("demo", "OpenDrawer", "--episodes", "6", "--seed", "3", "--out", str(tmp_path / "run"))
    page = Page(tmp_path / "run" / "report.html")
    shown = page.tasks()["OpenDrawer"]
    assert f"OpenDrawer: {shown['demonstrations']} demonstrations\n" in said
    episodes = shown["held"].partition("/")[2]
    verdicts = {name: f"{count}/{episodes}" for count, name in re.findall(r"(\d+) (paper|held|strict)", said)}
    assert f"of {episodes} episodes " in said
    assert {name: shown[name] for name in verdicts} == page.verdicts("OpenDrawer") == verdicts
    (failed, cause), = re.findall(r"(\d+) failed: (.+)", said)
    words = page.cards["OpenDrawer"]
    assert words[words.index(cause) + 1] == failed
