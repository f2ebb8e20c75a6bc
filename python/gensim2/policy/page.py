"""``report.html`` of ``gensim2 learn``: the table, the curves, films, and what went wrong."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gensim2.files import write_atomic
from gensim2.pages import template
from gensim2.policy.curves import read_curves
from gensim2.policy.train import TRAINING

if TYPE_CHECKING:
    from gensim2.policy.learning import LearnResult

REPORT = "report.html"
_WIDTH, _HEIGHT = 400.0, 100.0


def write_page(result: LearnResult) -> Path:
    """Write the page and return its path.

    Raises:
        WriteError: the folder cannot be written to.
    """
    out = Path(result.out)
    curves, failures, films = {}, [], []
    for each in result.learned:
        points = read_curves(each.folder / TRAINING)
        name = ", ".join(each.demonstrations)
        if points:
            curves[name] = _curve([point["loss"] for point in points], points[-1]["step"])
        for row in each.measured.policy.rows:
            failures += [
                {
                    "task": row.task.name,
                    "seed": episode.seed,
                    "objects": ", ".join(f"{thing.asset_class}/{thing.id}" for thing in episode.objects.values()),
                    "cause": "" if episode.cause is None else episode.cause.value,
                }
                for episode in row.episodes
                if not episode.held
            ]
        films += [os.path.relpath(film, out) for several in each.measured.policy.videos.values() for film in several]
    told = result.to_dict()
    controls = [row["episodes"] for each in result.learned for row in each.measured.rows("blind").values()]
    page = template("gensim2.policy", "learned.html.j2").render(
        rows=told["tasks"],
        record=result.record.model_dump(),
        controls=min(controls, default=0),
        curves=curves,
        failures=failures,
        films=films,
    )
    write_atomic(out / REPORT, page)
    return out / REPORT


def _curve(losses: Sequence[float], steps: int) -> dict[str, Any]:
    """Corners of a line in a box, the loss from 0 at the bottom to its largest at the top."""
    top, last = max(*losses, 1e-9), max(len(losses) - 1, 1)
    corners = ((_WIDTH * n / last, _HEIGHT * (1.0 - loss / top)) for n, loss in enumerate(losses))
    return {"points": " ".join(f"{x:.1f},{y:.1f}" for x, y in corners), "last": losses[-1], "steps": steps}
