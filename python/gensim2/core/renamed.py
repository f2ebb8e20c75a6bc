"""Accept names of the previous release in users' files and commands, and print a message about the new name."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import cache


def current(name: str, renamed: Mapping[str, str], kind: str) -> str:
    """Return the current name for a name that may be from the previous release.

    A name of the previous release is accepted and reported once per process on standard error.

    Args:
        name: name that the user gave.
        renamed: current names, keyed by the names of the previous release.
        kind: kind of the named thing for the message, for example ``"field"``.
    """
    if name not in renamed:
        return name
    _tell(kind, name, renamed[name])
    return renamed[name]


@cache
def _tell(kind: str, former: str, today: str) -> None:
    print(f"{kind} {former!r} is called {today!r}; the next release will not accept the old name", file=sys.stderr)
