"""Helpers for the scripts that write Markdown tables."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path


def line(cells: Iterable[str]) -> str:
    """Return a row of a table."""
    return f"| {' | '.join(cells)} |"


def runs_to_take_in(about: str | None) -> argparse.Namespace:
    """Parse the command line of a script that stores results: ``files``, and the ``commit`` that produced them.

    Args:
        about: docstring of the script, for its help.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--commit", help="hash of the commit that produced the results")
    given = parser.parse_args()
    if given.files and not given.commit:
        parser.error("say which --commit the runs were made with")
    return given
