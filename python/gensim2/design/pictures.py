"""Pictures for designers, rendered on first use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class LazyPicture:
    """A PNG image that is rendered on first use.

    Attributes:
        of: description that identifies the content; equal descriptions mean equal pictures. A recorded run can
            therefore be replayed on a machine that cannot render.
        make: renders the picture, which takes seconds at first. Raises GenSim2Error if this machine cannot render.
    """

    of: str
    make: Callable[[], bytes]
