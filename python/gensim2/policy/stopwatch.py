"""Wall and CPU time of what is done again and again, by stage."""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt


class Stopwatch:
    """Times repeated passes through the same stages.

    Args:
        stages: names, in order; ``total`` comes on top.
    """

    def __init__(self, *stages: str) -> None:
        self._stages = (*stages, "total")
        self._marks: list[tuple[float, float]] = []
        self._passes: list[npt.NDArray[np.float64]] = []

    def __len__(self) -> int:
        """Return the number of passes that were kept."""
        return len(self._passes)

    def begin(self) -> None:
        """Begin a pass, dropping one that was not kept."""
        self._marks = []
        self.mark()

    def mark(self) -> None:
        """End a stage, and begin the next."""
        self._marks.append((time.perf_counter(), time.process_time()))

    def keep(self) -> None:
        """Keep the pass, each of whose stages has ended."""
        marks = np.array(self._marks)
        self._passes.append(np.vstack([np.diff(marks, axis=0), marks[-1:] - marks[:1]]))

    def percentiles(self, warm_up: int) -> dict[str, dict[str, float]]:
        """Return milliseconds by stage: ``p50`` and ``p95`` of wall time, ``cpu`` time on median.

        Args:
            warm_up: number of first passes that are left out.
        """
        times = np.array(self._passes[warm_up:])  # (passes, stages, wall and CPU)

        def by_stage(share: float, clock: int) -> dict[str, float]:
            found = 1e3 * np.percentile(times[..., clock], share, axis=0)
            return dict(zip(self._stages, found.round(3).tolist(), strict=True))

        return {"p50": by_stage(50, 0), "p95": by_stage(95, 0), "cpu": by_stage(50, 1)}
