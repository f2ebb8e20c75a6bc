"""Results for people on standard output, or as one JSON document."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gensim2.errors import InputError
from gensim2.files import write_json
from gensim2.progress import ConsoleProgress

Show = Callable[[dict[str, Any]], None]


@contextlib.contextmanager
def report(json_file: str | None, show: Show) -> Iterator[tuple[ConsoleProgress, Callable[[dict[str, Any]], None]]]:
    """Give a command its progress listener and a function that takes its result.

    With ``json_file == "-"`` everything that is printed to standard output while the command runs, by
    simulators written in C++ and by worker processes too, goes to standard error; the document alone goes to
    standard output.

    Args:
        json_file: value of ``--json``: ``None``, ``"-"`` or a file.
        show: prints the result for a person.

    Raises:
        InputError: the file cannot be written to.
    """
    if json_file is not None and json_file != "-":
        _check_writable(Path(json_file))
    results: list[dict[str, Any]] = []
    to_stdout = json_file == "-"
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
            sys.stdout.write(json.dumps(result, indent=2, allow_nan=False) + "\n")
        else:
            if json_file is not None:
                write_json(Path(json_file), result)
            show(result)


def table(columns: Sequence[str], rows: Sequence[Sequence[object]], *, title: str | None = None) -> None:
    """Print a table; numbers are right-aligned."""
    grid = Table(title=title, title_justify="left", box=None, pad_edge=False, header_style="bold")
    for index, column in enumerate(columns):
        numeric = bool(rows) and all(isinstance(row[index], int | float) for row in rows)
        grid.add_column(escape(column), justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        grid.add_row(*(escape(str(value)) for value in row))
    console().print(grid)


def line(text: str) -> None:
    """Print one line as it is, never folded: whoever reads it may be a program."""
    console().print(text, markup=False, highlight=False, soft_wrap=True)


def console() -> Console:
    """Standard output; wide where it is not a terminal, so that nothing is folded in a pipe."""
    found = Console(soft_wrap=False, highlight=False)
    return found if found.is_terminal else Console(width=200, highlight=False)


def _check_writable(path: Path) -> None:
    """Refuse a file that could not be written before the work is done, not after."""
    remedy = "choose another file with --json"
    if path.is_dir():
        raise InputError("is a folder", file=path, field="--json", remedy=remedy)
    parent = next(folder for folder in path.absolute().parents if folder.exists())
    try:
        with tempfile.TemporaryFile(dir=parent):
            pass
    except OSError as error:
        raise InputError(f"cannot write: {error.strerror}", file=path, field="--json", remedy=remedy) from error


def _point_stdout_at_stderr() -> int:
    sys.stdout.flush()
    saved = os.dup(1)
    os.dup2(2, 1)
    return saved


def _restore_stdout(saved: int) -> None:
    sys.stdout.flush()
    os.dup2(saved, 1)
    os.close(saved)
