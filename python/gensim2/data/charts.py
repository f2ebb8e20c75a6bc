"""Draw SVG charts of a data set's coverage."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from gensim2.core.errors import MissingExtraError
from gensim2.data.quality import TaskQuality

_INCHES = (2.3, 2.1)
"""Width and height of a chart, inches; five charts side by side fill the width of a page."""
_POINTS = 9
"""Font size, points: 12 CSS pixels."""
_INK, _GOOD, _BAD, _FILL = "#76839a", "#2a9d6a", "#d0553f", "#4a7fd0"
"""Colours that are visible on light and on dark pages."""


def charts(quality: TaskQuality) -> tuple[str, ...]:
    """Draw histograms of object positions, openness, durations, arm jerk and clearance.

    Equal data give byte-identical charts.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    drawn = [_drawing(quality.name, lambda axes: _places(axes, quality.places))]
    if quality.openness:
        drawn.append(_histogram(quality, quality.openness, "openness at the start", "share"))
    drawn.append(_histogram(quality, quality.lengths, "length", "control steps"))
    drawn.append(_histogram(quality, quality.jerks, "jerk, root mean square", "rad/s³"))
    drawn.append(_histogram(quality, [1e3 * each for each in quality.clearances], "clearance", "mm"))
    return tuple(drawn)


def _places(axes: Any, places: Sequence[tuple[float, float, float, bool]]) -> None:
    for held, colour, label in ((True, _GOOD, "held"), (False, _BAD, "not held")):
        points = [(x, y) for x, y, _, each in places if each == held]
        if points:
            # The robot faces along x, so objects on its left appear on the left of the chart.
            axes.scatter([-y for _, y in points], [x for x, _ in points], s=16, c=colour, label=label, linewidths=0)
    axes.set(title="where it stood (m)", xlabel="right of the robot", ylabel="ahead")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=_POINTS, loc="best", framealpha=0.0, labelcolor=_INK, handletextpad=0.1, borderpad=0.1)


def _histogram(quality: TaskQuality, values: Sequence[float], title: str, unit: str) -> str:
    def draw(axes: Any) -> None:
        if values:
            axes.hist(values, bins=min(20, max(5, len(values) // 2)), color=_FILL)
            axes.yaxis.get_major_locator().set_params(integer=True)
        else:
            axes.text(0.5, 0.5, "none", ha="center", va="center", transform=axes.transAxes)
        axes.set(title=title, xlabel=unit, ylabel="demonstrations")

    return _drawing(f"{quality.name} {title}", draw)


def _drawing(salt: str, draw: Any) -> str:
    try:
        import matplotlib
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError("matplotlib", "data") from error
    coloured = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color")
    sized = ("font.size", "axes.titlesize", "axes.labelsize", "xtick.labelsize", "ytick.labelsize")
    settings: dict[Any, Any] = {**dict.fromkeys(coloured, _INK), **dict.fromkeys(sized, _POINTS)}
    # Equal data must give equal bytes. Therefore the salt makes the ids of the SVG elements reproducible, and no date
    # is written to the file. The font type "none" stores text as text instead of curves.
    settings |= {"svg.hashsalt": salt, "svg.fonttype": "none"}
    with matplotlib.rc_context(settings):
        figure = Figure(figsize=_INCHES, layout="constrained", facecolor="none")
        axes = figure.subplots()
        axes.set_facecolor("none")
        axes.locator_params(nbins=4)
        draw(axes)
        stream = io.StringIO()
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]
