"""Write an experiment's ``report.html``, with a figure and tables, from its JSON result."""

from __future__ import annotations

from collections.abc import Mapping
from math import log10
from pathlib import Path
from typing import Any

from gensim2.core.files import write_atomic
from gensim2.core.pages import template
from gensim2.policy.experiments.figures import Kind

REPORT = "report.html"
WIDTH, HEIGHT, LEFT, BOTTOM = 640.0, 240.0, 40.0, 40.0
COLOURS: dict[Kind, str] = {
    "seen": "#8aa0b8",
    "unseen": "#2f6fc4",
    "real": "#1f8a5b",
    "rephrased": "#8a4fbf",
    "opposite": "#c4772f",
    "untaught": "#b8952f",
    "blind": "#b0413e",
}
APART = 11.0
"""Horizontal distance between the points of one policy, pixels."""
WORDS: dict[Kind, str] = {
    "seen": "seen",
    "unseen": "unseen",
    "real": "real",
    "opposite": "told the opposite",
    "rephrased": "in other words",
    "untaught": "untaught tasks",
    "blind": "blind",
}
"""Column titles."""
MEANINGS: dict[Kind, str] = {
    "seen": "on objects of the training data",
    "unseen": "on objects of the same kind that no training used",
    "real": "on real objects that no training used",
    "opposite": "on unseen objects, with the sentence of the opposite task; low if the policy follows the sentence",
    "rephrased": "on unseen objects, with paraphrases of the sentence",
    "untaught": "on tasks without training data",
    "blind": "on unseen objects, with the point cloud blanked out; low if the policy uses its cloud",
}
"""Meaning of each column."""


def write_page(told: Mapping[str, Any]) -> Path:
    """Write the report of an experiment into the folder of the experiment, and return the path of the report.

    Args:
        told: result of the experiment, as returned by :meth:`ExperimentResult.to_dict`.

    Raises:
        WriteError: the folder of the experiment cannot be written to.
    """
    arms = told["arms"]
    kinds = [
        {"name": kind, "words": WORDS[kind], "meaning": MEANINGS[kind], "colour": COLOURS[kind]}
        for kind in _measured(arms)
    ]
    page = template("gensim2.policy.experiments", "experiment.html.j2").render(
        told=told, kinds=kinds, figure=figure(arms)
    )
    path = Path(told["out"]) / REPORT
    write_atomic(path, page)
    return path


def _measured(arms: list[dict[str, Any]]) -> list[Kind]:
    """Return the kinds of evaluations that at least one policy has."""
    return [kind for kind in WORDS if any(arm[f"{kind}_mean"] is not None for arm in arms)]


def figure(arms: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the coordinates of the report's figure.

    The figure shows the success rates of each policy with their intervals, by evaluation.

    The horizontal axis is the number of training objects on a logarithmic scale, or else the policies at equal
    distances.
    """
    counts = [arm["count"] for arm in arms]
    counted = all(count is not None for count in counts) and len(set(counts)) > 1
    places = [log10(count) for count in counts] if counted else [float(n) for n in range(len(arms))]
    low, span = min(places), max(max(places) - min(places), 1e-9)
    room = (WIDTH - LEFT) / (len(arms) + 1)
    kinds = _measured(arms)
    marks, names = [], []
    for arm, place in zip(arms, places, strict=True):
        share = (place - low) / span if len(arms) > 1 else 0.5
        x = LEFT + room + share * (WIDTH - LEFT - 2 * room)
        names.append({"x": round(x, 1), "words": f"{arm['count']} objects" if counted else arm["name"]})
        for number, kind in enumerate(kinds):
            mean, interval = arm[f"{kind}_mean"], arm[f"{kind}_interval"]
            if mean is not None:
                shift = APART * (number - (len(kinds) - 1) / 2)
                ends = [round(_up(value), 1) for value in interval]
                mark = {"x": round(x + shift, 1), "y": round(_up(mean), 1), "low": ends[0], "high": ends[1]}
                marks.append({**mark, "colour": COLOURS[kind], "words": f"{arm['name']}, {WORDS[kind]}: {mean:.2f}"})
    grid = [{"y": round(_up(share), 1), "words": f"{share:.2f}"} for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    return {"width": WIDTH, "height": HEIGHT, "left": LEFT, "marks": marks, "names": names, "grid": grid}


def _up(share: float) -> float:
    """Return the vertical pixel position of a success rate from 0 to 1; pixel rows are counted from the top."""
    top = 10.0
    return top + (1.0 - share) * (HEIGHT - BOTTOM - top)
