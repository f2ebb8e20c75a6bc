"""Mapping evaluated on first access, from what was read at its instant."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class LazyMapping(Mapping[str, Array]):
    """Arrays by name: most measurements are looked at in one or two numbers, and there is one every control step.

    Args:
        work_out: gives them all; must go by what was read before, not by the simulator.
    """

    def __init__(self, work_out: Callable[[], Mapping[str, Array]]) -> None:
        self._work_out = work_out

    @cached_property
    def _values(self) -> Mapping[str, Array]:
        return self._work_out()

    def __getitem__(self, name: str) -> Array:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return repr(dict(self._values))

    def __reduce__(self) -> tuple[type[dict[str, Array]], tuple[Mapping[str, Array]]]:
        return dict, (dict(self._values),)  # pickled as what they are
