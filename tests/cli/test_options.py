"""Options come from typed functions: each has one help text, and the default of the function behind its command."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import click
import pytest

import gensim2
from gensim2.cli import main as cli
from gensim2.cli.options import Shared, command
from gensim2.cli.output import line
from gensim2.cli.typed import Count, Folder, Option, options_of_class
from gensim2.core.progress import Progress


def _commands() -> Iterator[tuple[str, click.Command]]:
    context = click.Context(cli.cli)

    def walk(name: str, each: click.Command) -> Iterator[tuple[str, click.Command]]:
        if isinstance(each, click.Group):
            for word in each.list_commands(context):
                inner = each.get_command(context, word)
                assert inner is not None
                yield from walk(f"{name} {word}".strip(), inner)
        else:
            yield name, each

    yield from walk("", cli.cli)


COMMANDS = dict(_commands())


@command("seed", show=lambda result: line(str(result)))
def sample(
    things: tuple[str, ...] = (),
    *,
    episodes: Count = 5,
    kind: Literal["a", "b"] | None = None,
    out: Folder,
    loud: bool = True,
    words: Annotated[tuple[str, ...], Option("--word", "WORD")] = (),
    progress: Progress,
    **given: Any,
) -> dict[str, Any]:
    """Count things.

    THINGS are counted one after the other.

    Args:
        episodes: Number of episodes.
        kind: Kind of the things,
            in one word.
        out: Folder to write to.
        loud: Say it.
        words: Word to count; may be given again.
    """
    return {"things": things, "episodes": episodes, "kind": kind, "loud": loud, "words": words, **given}


def test_a_typed_function_is_a_command() -> None:
    params = {each.name: each for each in sample.params}
    assert list(params) == ["things", "episodes", "kind", "out", "loud", "words", "seed", "json_file"]
    assert sample.short_help == "Count things."
    assert sample.help == "Count things.\n\nTHINGS are counted one after the other."
    assert isinstance(params["kind"], click.Option)
    assert params["kind"].help == "Kind of the things, in one word."
    assert params["loud"].secondary_opts == ["--no-loud"]
    values = sample.make_context("sample", ["x", "y", "--out", "a", "--word", "v", "--word", "w"]).params
    assert values["things"] == ("x", "y")
    assert (values["episodes"], values["kind"], values["loud"], values["seed"]) == (5, None, True, 0)
    assert values["words"] == ("v", "w")
    assert values["out"] == Path("a")


@pytest.mark.parametrize(
    "words", [[], ["--out", "a", "--kind", "c"], ["--out", "a", "--episodes", "0"], ["--out", "a", "--seed", "-1"]]
)
def test_a_value_outside_its_type_is_refused(words: list[str]) -> None:
    with pytest.raises(click.UsageError):
        sample.make_context("sample", words)


def test_an_option_without_a_text_is_an_error() -> None:
    class Silent:
        """Options for a test."""

        loud: bool = False

    with pytest.raises(KeyError, match="loud"):
        options_of_class(Silent)


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_option_and_command_has_a_text(name: str) -> None:
    made = COMMANDS[name]
    assert made.short_help
    assert made.short_help.endswith((".", "--assets."))
    for each in made.params:
        if isinstance(each, click.Option):
            assert each.help, each.name


def test_a_shared_option_has_one_text() -> None:
    texts: dict[str, set[str]] = {}
    for made in COMMANDS.values():
        for each in made.params:
            if isinstance(each, click.Option) and each.help:
                texts.setdefault(each.help, set()).add(each.name or "")
    shared = options_of_class(Shared)
    for name, option in shared.items():
        assert isinstance(option, click.Option)
        assert texts[option.help or ""] <= {name}, name


def test_defaults_are_those_of_the_functions_behind() -> None:
    """The command line does not import these functions for its help, so their defaults are compared here."""
    policy = pytest.importorskip("gensim2.policy.learning")
    functions = {
        "benchmark": gensim2.benchmark,
        "collect": gensim2.collect,
        "demo": gensim2.demo,
        "do": gensim2.do,
        "evaluate": gensim2.evaluate,
        "learn": policy.learn,
        "render": gensim2.render,
        "run-pipeline": gensim2.run_pipeline,
        "solve": gensim2.solve,
    }
    #: The command line has its own defaults for these: one core each, a settings file, or a word for None.
    other = {"arguments", "workers", "controls", "designer"}
    compared = 0
    for name, function in functions.items():
        own = inspect.signature(function).parameters
        for each in COMMANDS[name].params:
            if not isinstance(each, click.Option) or each.required or each.multiple:
                continue
            if each.name in own.keys() - other and own[each.name].default is not inspect.Parameter.empty:
                default = each.get_default(click.Context(COMMANDS[name]))
                assert default == own[each.name].default, f"{name} {each.name}"
                compared += 1
    assert compared > 60


@pytest.mark.parametrize(("words", "said"), [([], "--resume --out FOLDER"), (["--out", "here"], "with --resume")])
def test_an_interrupted_command_says_how_it_goes_on(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    @command("out", "resume", show=lambda result: line(str(result)))
    def interrupted(**given: Any) -> dict[str, Any]:
        """Do nothing."""
        raise KeyboardInterrupt

    monkeypatch.setattr(type(cli.cli), "get_command", lambda *_: interrupted)
    assert cli.run(["interrupted", *words]) == 130
    err = capfd.readouterr().err.strip()
    assert err.startswith("gensim2: interrupted; what was finished is kept; to continue, repeat the command")
    assert err.endswith(said)
