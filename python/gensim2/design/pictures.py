"""Pictures that go along with what a designer is told; drawn when they are first read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class LazyPicture:
    """A PNG.

    Attributes:
        of: what it shows, exactly: two pictures of the same are the same, whatever draws them. A recorded run is
            replayed where nothing can be drawn.
        make: draws it, at its first look after seconds. Raises GenSim2Error where nothing can be drawn.
    """

    of: str
    make: Callable[[], bytes]
