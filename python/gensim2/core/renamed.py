"""Accept names of the previous release in users' files and commands, with a message."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import cache


def current(name: str, renamed: Mapping[str, str], kind: str) -> str:
    """Return the present name for a possibly outdated one.

    A name of the previous release is accepted and reported once per process on standard error.

    Args:
        name: given name.
        renamed: present names by those of the previous release.
        kind: kind of thing, for the message.
    """
    if name not in renamed:
        return name
    _tell(kind, name, renamed[name])
    return renamed[name]


@cache
def _tell(kind: str, former: str, today: str) -> None:
    print(f"{kind} {former!r} is called {today!r}; the next release removes the old name", file=sys.stderr)
