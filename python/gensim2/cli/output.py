"""Print results as text on standard output, or as one JSON document."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gensim2.core.errors import InputError
from gensim2.core.files import check_writable, write_output
from gensim2.core.plural import plural
from gensim2.core.progress import ConsoleProgress
from gensim2.core.special_files import descriptor

if TYPE_CHECKING:
    from rich.console import Console

STDOUT = 1

Show = Callable[[dict[str, Any]], None]


def document(result: dict[str, Any]) -> str:
    """Return a result as a JSON document.

    Raises:
        ValueError: the result contains NaN or an infinite number, which JSON cannot represent.
    """
    return json.dumps(result, indent=2, allow_nan=False) + "\n"


@contextlib.contextmanager
def report(
    json_file: str | None, show: Show, text: Callable[[dict[str, Any]], str] = document
) -> Iterator[tuple[ConsoleProgress, Callable[[dict[str, Any]], None]]]:
    """Yield a progress listener, and a function that accepts the command's result.

    With ``json_file == "-"``, only the document goes to standard output. All other output to standard output while the
    command runs is redirected to standard error. This includes output of C++ simulators and worker processes.

    Args:
        json_file: value of ``--json``: ``None``, ``"-"`` or a file.
        show: function that prints the result as text.
        text: function that formats the result for the file.

    Raises:
        InputError: the file cannot be written to.
    """
    to_stdout = json_file == "-" or (json_file is not None and descriptor(Path(json_file)) == STDOUT)
    if json_file is not None and not to_stdout:
        with _said_of_json(json_file):
            check_writable(Path(json_file))
    results: list[dict[str, Any]] = []
    saved = _point_stdout_at_stderr() if to_stdout else None
    try:
        with (
            contextlib.redirect_stdout(sys.stderr) if to_stdout else contextlib.nullcontext(),
            ConsoleProgress() as progress,
        ):
            yield progress, results.append
    finally:
        if saved is not None:
            _restore_stdout(saved)
    for result in results:
        if to_stdout:
            sys.stdout.write(text(result))
        else:
            show(result)  # printed first, so that the result is visible even if the file cannot be written
            if json_file is not None:
                with _said_of_json(json_file):
                    write_output(Path(json_file), text(result))


def table(columns: Sequence[str], rows: Sequence[Sequence[object]], *, title: str | None = None) -> None:
    """Print a table; numbers are right-aligned."""
    from rich.markup import escape
    from rich.table import Table

    grid = Table(title=title, title_justify="left", box=None, pad_edge=False, header_style="bold")
    for index, column in enumerate(columns):
        numeric = bool(rows) and all(isinstance(row[index], int | float) for row in rows)
        grid.add_column(escape(column), justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        grid.add_row(*(escape(str(value)) for value in row))
    console().print(grid)


def line(text: str) -> None:
    """Print one line without wrapping, since a program may read it."""
    console().print(text, markup=False, highlight=False, soft_wrap=True)


def show_engines(name: str, episodes: int, result: dict[str, Any]) -> None:
    """Print the success rates in both engines. Print nothing if the episodes ran in only one engine."""
    if "engines" not in result:
        return
    rates = ", ".join(f"{count} in {engine}" for engine, count in result["engines"].items())
    seeds = ", ".join(str(seed) for seed in result["disagreed"])
    differ = f"; only one engine holds seed {seeds}" if seeds else "; the engines agree in every episode"
    line(f"{name}: of {plural(episodes, 'episode')} {rates} hold{differ}")


def number(value: float | None) -> str:
    """Format a number with one decimal. Return an empty string for None."""
    return "" if value is None else f"{value:.1f}"


def console() -> Console:
    """Return a console for standard output, wide if it is not a terminal, so that piped lines are not wrapped."""
    from rich.console import Console

    found = Console(soft_wrap=False, highlight=False)
    return found if found.is_terminal else Console(width=200, highlight=False)


@contextlib.contextmanager
def _said_of_json(json_file: str) -> Iterator[None]:
    """Add the name of the option ``--json`` to error messages about the option's output file."""
    try:
        yield
    except InputError as error:
        remedy = "choose another file with --json"
        raise InputError(error.message, file=json_file, field="--json", remedy=remedy) from error


def _point_stdout_at_stderr() -> int:
    sys.stdout.flush()
    saved = os.dup(1)
    os.dup2(2, 1)
    return saved


def _restore_stdout(saved: int) -> None:
    sys.stdout.flush()
    os.dup2(saved, 1)
    os.close(saved)
