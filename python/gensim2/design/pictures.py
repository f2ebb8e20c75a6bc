"""Provide pictures for designers, which are rendered on first use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class LazyPicture:
    """A PNG image that is rendered on first use.

    Attributes:
        of: text that identifies the content. A replay of recorded answers compares these texts instead of images, so it
            needs no renderer.
        make: function that renders the picture, or raises GenSim2Error if rendering is impossible. The first call takes
            seconds.
    """

    of: str
    make: Callable[[], bytes]
