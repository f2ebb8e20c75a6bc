"""Provide pictures for designers, which are rendered on first use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class LazyPicture:
    """A PNG image that is rendered on first use.

    Attributes:
        of: description of the content; pictures with equal descriptions are equal. A replay of recorded answers
            compares only descriptions, so that it works on a machine that cannot render.
        make: function that renders the picture; the first call takes seconds. Raises GenSim2Error if this machine
            cannot render.
    """

    of: str
    make: Callable[[], bytes]
