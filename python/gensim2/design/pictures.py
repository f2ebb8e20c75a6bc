"""Provide pictures for designers, which are rendered on first use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class LazyPicture:
    """A PNG image that is rendered on first use.

    Attributes:
        of: text that identifies the picture. Two pictures with the same text show the same content. A replay of
            recorded answers compares these texts instead of the images, so the replay also works on a machine that
            cannot render.
        make: function that renders the picture; the first call takes seconds. Raises GenSim2Error if this machine
            cannot render.
    """

    of: str
    make: Callable[[], bytes]
