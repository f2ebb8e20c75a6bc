"""Generate pages of the site as a hook of MkDocs (``mkdocs.yml``): front page, command line, Python API.

The front page is the README. The reference is generated from click's commands and from the names that each package
exports.
"""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from gensim2.cli.main import cli

#: A reference in a docstring, as the page shows it.
_CELL = re.compile(r"<td.*?</td>", re.S)
_ROLE = re.compile(r":(?:class|meth|mod|func|attr|data):<code>(~?)([^<]*)</code>")

ROOT = Path(__file__).parents[1]

#: Packages of the reference, each with what it is for; what they export is in their ``__all__``.
PACKAGES = {
    "gensim2": "what most programs need",
    "gensim2_kpam": "the solver alone",
    "gensim2.objects": "objects and their library",
    "gensim2.tasks": "tasks, criteria, the task library",
    "gensim2.robots": "robot profiles",
    "gensim2.sim": "environments",
    "gensim2.perception": "what cameras give",
    "gensim2.planning": "scenes, problems, plans",
    "gensim2.rollout": "episodes, controllers, verdicts",
    "gensim2.data": "data sets",
    "gensim2.evaluation": "benchmark and evaluation of controllers",
    "gensim2.policy": "networks, training, checkpoints",
    "gensim2_robot": "an arm and its cameras",
    "gensim2.design": "designers, search, runs",
}
#: Links of pages outside docs/ that lead to files which the site does not have.
_FILES = re.compile(r"\[([^]]*)\]\((?!https?:|#|[\w/]+\.md|docs/)([^)]*)\)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Insert the generated reference pages into the navigation, below their index pages."""
    under = {
        "Command line": ["cli/index.md", *({name: f"cli/{name}.md"} for name in cli.list_commands(click.Context(cli)))],
        "Python": ["api/index.md", *({name: f"api/{name}.md"} for name in PACKAGES)],
    }
    for section in config.nav or ():
        for title, pages in section.items():
            if isinstance(pages, list):
                section[title] = [
                    {name: under.get(name, page) for name, page in entry.items()} if isinstance(entry, dict) else entry
                    for entry in pages
                ]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are generated from other files and from the code."""
    for name, text in {**_from_files(), **dict(_commands()), **dict(_packages())}.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_content(html: str, page: Any, config: MkDocsConfig, files: Files) -> str:
    """Replace docstring references by names, and unescape bars that are escaped in tables for GitHub."""
    html = _CELL.sub(lambda found: found[0].replace("\\|", "|"), html)
    return _ROLE.sub(lambda found: f"<code>{found[2].rsplit('.', 1)[-1] if found[1] else found[2]}</code>", html)


def _from_files() -> dict[str, str]:
    pages = {"index.md": "README.md", "contributing.md": "CONTRIBUTING.md", "changelog.md": "CHANGELOG.md"}
    return {page: _moved((ROOT / source).read_text(encoding="utf-8")) for page, source in pages.items()}


def _moved(text: str) -> str:
    """Adapt a Markdown file of the repository root to the site: links point to pages, or become plain text."""
    text = text.replace("(CONTRIBUTING.md)", "(contributing.md)").replace("(CHANGELOG.md)", "(changelog.md)")
    text = re.sub(r"\]\(docs/", "](", text)
    return _FILES.sub(lambda found: found[0] if found[2].startswith("images/") else found[1], text)


def _commands() -> Iterator[tuple[str, str]]:
    context = click.Context(cli, info_name="gensim2")
    rows = []
    for name in cli.list_commands(context):
        command = cli.get_command(context, name)
        assert command is not None
        rows.append(f"| [`gensim2 {name}`]({name}.md) | {_cell(command.get_short_help_str(200))} |")
        yield f"cli/{name}.md", "\n\n".join(_command(command, click.Context(command, context, name), 1)) + "\n"
    table = "\n".join(["| command | what it does |", "| --- | --- |", *rows])
    ends = "Exit codes: 0 ran to the end, 1 a check found something wrong, 2 bad input, 3 jobs could not be run."
    yield "cli/index.md", f"# Command line\n\n{table}\n\n{ends}\n"


def _command(command: click.Command, context: click.Context, level: int) -> Iterator[str]:
    """Return Markdown for a command and its subcommands, with the options that ``--help`` shows."""
    yield f"{'#' * level} {context.command_path}"
    yield f"```\n{command.get_usage(context).removeprefix('Usage: ')}\n```"
    yield inspect.cleandoc(command.help or "").replace("\f", "")
    records = [record for each in command.get_params(context) if (record := each.get_help_record(context))]
    rows = [f"| `{option.replace('|', chr(92) + '|')}` | {_cell(said)} |" for option, said in records]
    yield "\n".join(["| option | meaning |", "| --- | --- |", *rows])
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            assert below is not None
            yield from _command(below, click.Context(below, context, name), level + 1)


def _cell(text: str) -> str:
    """Return text for a table cell: on one line, with Markdown characters escaped."""
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*").replace("[", "\\[")


def _packages() -> Iterator[tuple[str, str]]:
    rows = [f"| [`{name}`]({name}.md) | {what} |" for name, what in PACKAGES.items()]
    table = "\n".join(["| package | what it gives |", "| --- | --- |", *rows])
    yield "api/index.md", f"# Python\n\nWhat each package exports; everything else may change.\n\n{table}\n"
    for name in PACKAGES:
        exported = [each for each in getattr(importlib.import_module(name), "__all__", ()) if not each.startswith("_")]
        yield f"api/{name}.md", _package(name, exported)


def _package(name: str, exported: list[str]) -> str:
    module = importlib.import_module(name)
    parts, values = [f"# `{name}`\n\n{_first_paragraph(module)}\n"], []
    for each in exported:
        thing = getattr(module, each)
        if not (inspect.isclass(thing) or inspect.isroutine(thing)):
            values.append(f"`{each}`")
        elif name == "gensim2":  # the front door: each name is documented by the package that it comes from
            parts.append(f"- [`{each}`][{thing.__module__}.{thing.__qualname__}]")
        elif name == "gensim2_kpam":  # its stubs stand beside the extension
            parts.append(f"::: {name}.{each}\n")
        else:
            parts.append(f"::: {thing.__module__}.{thing.__qualname__}\n")
    if values:
        parts.insert(1, f"Values and types besides: {', '.join(values)}.\n")
    return "\n".join(parts)


def _first_paragraph(module: Any) -> str:
    return str(module.__doc__ or "").strip().split("\n\n")[0]
