"""Commands in the documentation are found completely, and wrong results are reported."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest

from gensim2.cli.main import cli

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

import first_hour  # noqa: E402
import first_hour_pages  # noqa: E402

#: Text files that are not documentation for users, with the reason.
NO_PAGES = {
    r"CHANGELOG\.md|crates/python/CHANGES\.md": "what changed, not what to do",
    r"prompts/.*|python/.*/prompts/.*": "for language models",
    r"tests/.*": "data of tests",
    r"python/gensim2/robots/franka_description/README\.md": "origin of the robot's files",
}


def test_commands_are_those_of_the_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(first_hour_pages, "ROOT", tmp_path)
    page = tmp_path / "page.md"
    page.write_text(
        "gensim2 is prose\n\n    gensim2 demo NAME [--seed N] \\\n        --episodes 500     # many\n\n"
        "```\ngensim2 assets list        # all\ngensim2 run-pipeline --designer MODEL\nruns/ is no command\n```\n"
        "```python\ngensim2.solve()\n```\n"
    )
    found = first_hour_pages.all_commands([page], full=False)
    assert [(command.page, command.run) for command in found] == [
        ("page.md:3", "gensim2 demo CloseBox --episodes 2"),
        ("page.md:7", "gensim2 assets list"),
        ("page.md:8", None),
    ]
    assert str(found[2].why).startswith("needs a language model")


@pytest.fixture(scope="module")
def commands() -> list[first_hour_pages.Command]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GENSIM2_ASSETS", "/objects")
        return first_hour_pages.all_commands(first_hour_pages.pages(), full=False)


def test_no_page_is_left_out() -> None:
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True)
    pages = {str(page.relative_to(ROOT)) for page in first_hour_pages.pages()}
    others = [name for name in listed.stdout.split() if name not in pages]
    assert [name for name in others if not re.fullmatch("|".join(NO_PAGES), name)] == []


def test_no_command_is_left_out(commands: list[first_hour_pages.Command]) -> None:
    assert len(commands) > 140
    assert sum(command.run is not None for command in commands) > 60
    for command in commands:
        assert command.run or command.why
        for test in re.findall(r"(?:tests|benchmarks)/[\w/]+\.py", command.why or ""):
            assert (ROOT / test).is_file(), f"{command.page}: {test}"
    told = first_hour.summary(commands)
    assert told["not_run"] == sum(first_hour.rules(commands).values()) == len(commands) - int(str(told["run"]))


def test_every_line_of_a_shell_block_is_a_command() -> None:
    for page in first_hour_pages.pages():
        numbers = {int(each.page.rpartition(":")[2]) for each in first_hour_pages.commands_of(page)}
        goes_on = False
        for number, language, text in first_hour_pages.blocks_of(page):
            if language in ("bash", "sh", "console") and not goes_on and text and not text.startswith("#"):
                assert number in numbers, f"{page}:{number}: {text}"
            goes_on = text.endswith("\\")


def _options(command: click.Command) -> set[str]:
    return {option for param in command.params for option in (*param.opts, *param.secondary_opts)} | {"--help", "-h"}


def _check_words(where: str, words: list[str]) -> None:
    """Check the names of commands and options against the command line."""
    command: click.Command = cli
    with click.Context(cli) as context:
        rest = iter(words[1:])
        for word in rest:
            if isinstance(command, click.Group) and not word.startswith("-"):
                found = command.get_command(context, word)
                assert found is not None, f"{where}: no command {word!r}"
                command = found
            elif word.startswith("-") and not re.fullmatch(r"-+|-\d.*", word):
                assert word.partition("=")[0] in _options(command) | {"--version"}, f"{where}: no option {word}"


def test_commands_that_are_not_run_have_options_that_exist(commands: list[first_hour_pages.Command]) -> None:
    for command in commands:
        words = shlex.split(command.text)
        if words[0] == "gensim2":
            _check_words(command.page, words)
        elif words[0] == "python" and words[1].endswith(".py"):
            source = (ROOT / words[1]).read_text(encoding="utf-8")
            for word in words[2:]:
                if word.startswith("--"):
                    assert f'"{word}"' in source, f"{command.page}: {words[1]} has no {word}"


def test_commands_in_sentences_exist() -> None:
    found = 0
    for page in first_hour_pages.pages():
        for text in re.findall(r"`(gensim2 [^`\n]+)`", page.read_text(encoding="utf-8")):
            words = [word for word in re.sub(r"[\[\]…'\"|]", " ", text).split() if word != "..."]
            _check_words(str(page), words)
            found += 1
    assert found > 50


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("echo done", None),
        ("true", "prints nothing"),
        ("echo found; exit 1", None),
        ("echo 'gensim2: no such task'; exit 2", "exit code 2: gensim2: no such task"),
        ("echo 'Traceback (most recent call last)'; echo 'ValueError: x'", "a traceback: ValueError: x"),
        ("echo begun; exec sleep 60", None),
        ("trap 'echo stopped; exit 2' INT; echo begun; sleep 60", "exit code 2 after Ctrl-C: stopped"),
    ],
)
def test_how_a_command_ends_is_judged(tmp_path: Path, text: str, fault: str | None) -> None:
    command = first_hour_pages.Command("page.md:1", text, text)
    first_hour.run(command, tmp_path, 0.1)
    assert command.fault == fault
    assert command.interrupted == ("sleep" in text)
