"""Commands of the pages are found, and what is wrong with how one ends is told."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "scripts/first_hour.py"
_SPEC = importlib.util.spec_from_file_location("first_hour", SCRIPT)
assert _SPEC is not None
assert _SPEC.loader is not None
first_hour = importlib.util.module_from_spec(_SPEC)
sys.modules["first_hour"] = first_hour
_SPEC.loader.exec_module(first_hour)


def test_commands_are_those_of_the_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(first_hour, "ROOT", tmp_path)
    page = tmp_path / "page.md"
    page.write_text(
        "gensim2 is prose\n\n    gensim2 demo NAME [--seed N] \\\n        --episodes 500     # many\n\n"
        "```\ngensim2 assets list        # all\ngensim2 run-pipeline --designer MODEL\nruns/ is no command\n```\n"
        "```python\ngensim2.solve()\n```\n"
    )
    found = list(first_hour.commands_of(page))
    for command in found:
        first_hour.prepare(command, full=False)
    assert [(command.page, command.run) for command in found] == [
        ("page.md:3", "gensim2 demo CloseBox --episodes 2"),
        ("page.md:7", "gensim2 assets list"),
        ("page.md:8", None),
    ]
    assert found[2].why == "needs a language model"


def test_every_page_is_read_and_most_commands_can_be_run() -> None:
    found = [command for page in first_hour.pages() for command in first_hour.commands_of(page)]
    for command in found:
        first_hour.prepare(command, full=False)
    assert sum(command.run is not None for command in found) > 40
    assert all(command.run or command.why for command in found)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("echo done", None),
        ("true", "prints nothing"),
        ("echo found; exit 1", None),
        ("echo 'gensim2: no such task'; exit 2", "exit code 2: gensim2: no such task"),
        ("echo 'Traceback (most recent call last)'; echo 'ValueError: x'", "a traceback: ValueError: x"),
        ("echo begun; exec sleep 60", None),
    ],
)
def test_how_a_command_ends_is_judged(tmp_path: Path, text: str, fault: str | None) -> None:
    command = first_hour.Command("page.md:1", text, text)
    first_hour.run(command, tmp_path, 0.5)
    assert command.fault == fault
    assert (command.code is None) == ("sleep" in text)
