"""Names of the release before, which users' files and commands may still have: today's, and one line that says so."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import cache


def current(name: str, renamed: Mapping[str, str], kind: str) -> str:
    """Return today's name of what a file or a command names.

    A name of the release before is understood, and told once a process on standard error.

    Args:
        name: as given.
        renamed: today's names by those of the release before.
        kind: of thing that has the name, as the line says it.
    """
    if name not in renamed:
        return name
    _tell(kind, name, renamed[name])
    return renamed[name]


@cache
def _tell(kind: str, former: str, today: str) -> None:
    print(f"{kind} {former!r} is called {today!r}; the old name goes with the next release", file=sys.stderr)
