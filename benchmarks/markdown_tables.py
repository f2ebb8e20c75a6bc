"""Helpers for the scripts that write Markdown tables."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gensim2.core.files import write_atomic, write_json

Row = dict[str, Any]


def line(cells: Iterable[str]) -> str:
    """Return a row of a table."""
    return f"| {' | '.join(cells)} |"


def markdown_table(head: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Format a table in Markdown."""
    return "\n".join([line(head), line(["---"] * len(head)), *map(line, rows)]) + "\n"


def take_in(
    about: str | None,
    store: Path,
    rows_of: Callable[[Any, str], Iterable[Row]],
    key: Sequence[str],
    *,
    field: str = "rows",
    order: Callable[[tuple[Any, ...]], Any] | None = None,
) -> list[Row]:
    """Add the results that the command line names to a JSON file of rows. A new row replaces the row of the same key.

    Args:
        about: docstring of the script, for its help.
        store: JSON file with the rows; it is created if missing.
        rows_of: function that converts the JSON of a result file and the hash of its commit to rows.
        key: names of the columns that identify a row.
        field: name of the list of rows in ``store``.
        order: sort key for the values of ``key``; None sorts by the values themselves.

    Returns:
        All rows of the file.
    """
    given = _results(about)
    stored = json.loads(store.read_text(encoding="utf-8"))[field] if store.exists() else []
    known = {tuple(row[name] for name in key): row for row in stored}
    for file in given.files:
        for row in rows_of(json.loads(file.read_text(encoding="utf-8")), given.commit):
            known[tuple(row[name] for name in key)] = row
    rows = [known[values] for values in sorted(known, key=order)]
    write_json(store, {"schema_version": 1, field: rows})
    return rows


def fill(
    pages: Iterable[Path],
    marked: re.Pattern[str],
    makers: Mapping[str, Callable[[Sequence[Row]], str]],
    rows: Sequence[Row],
) -> None:
    """Replace the marked texts of pages.

    Args:
        pages: Markdown files.
        marked: pattern whose groups are the opening mark, the name of a maker, and the closing mark.
        makers: functions that make the texts between the marks, by name.
        rows: rows that the makers get.
    """
    for page in pages:
        text = marked.sub(lambda match: f"{match[1]}{makers[match[2]](rows)}{match[3]}", page.read_text())
        write_atomic(page, text)


def _results(about: str | None) -> argparse.Namespace:
    """Parse the command line: ``files``, and the ``commit`` that produced them."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--commit", help="hash of the commit that produced the results")
    given = parser.parse_args()
    if given.files and not given.commit:
        parser.error("say which --commit the runs were made with")
    return given
