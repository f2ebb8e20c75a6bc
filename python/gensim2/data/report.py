"""Write ``quality.html`` and ``quality.json``, which show the coverage of a data set in images and numbers."""

from __future__ import annotations

import io
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gensim2.core.errors import MissingExtraError
from gensim2.core.files import write_atomic, write_json
from gensim2.core.pages import template
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.dataset import DataSet
from gensim2.data.quality import TaskQuality, qualities
from gensim2.data.sheet import Shot, contact_sheet
from gensim2.data.store import TaskStore
from gensim2.data.video import Replay, film
from gensim2.rollout.record import Episode
from gensim2.rollout.tally import interval

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
    # The bytes must be reproducible, so the salt fixes the SVG ids and no date is written. The font type "none" keeps
    # text as text.
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


HTML, JSON, MEDIA = "quality.html", "quality.json", "quality"
SCHEMA_VERSION = 1


@dataclass(frozen=True)
class _Section:
    """Data for the section of the report about one task.

    Attributes:
        quality: quality measures of the task.
        interval: 95 % interval of the success rate.
        charts: SVG charts.
        films: pairs of file names in the page's folder: a video and its still picture.
        shots: images of rendered demonstrations; empty if the data set was not rendered.
    """

    quality: TaskQuality
    interval: tuple[float, float]
    charts: tuple[str, ...]
    films: tuple[tuple[str, str], ...]
    shots: tuple[Shot, ...]


def report(
    path: Path, *, videos: int = 1, assets: Path | str | None = None, progress: Progress = NULL_PROGRESS
) -> dict[str, Any]:
    """Analyse every episode of a data set, and write an HTML page and the quality measures into its folder.

    Args:
        videos: number of demonstrations of each task to record as videos.
        assets: current folder of the object library; None: the folder recorded in the data set.

    Returns:
        The quality measures of the data set.

    Raises:
        InputError: the data set cannot be read, its collection is incomplete, or an object is missing or has changed.
    """
    dataset = DataSet.open(path, assets)
    sections = [_section(dataset, quality, videos, progress) for quality in qualities(dataset, progress)]
    numbers = {"schema_version": SCHEMA_VERSION, "tasks": [section.quality.to_dict() for section in sections]}
    write_json(path / JSON, numbers)
    page = template("gensim2.data", "quality.html.j2").render(sections=sections, record=dataset.record.model_dump())
    write_atomic(path / HTML, page)
    return numbers


def _section(dataset: DataSet, quality: TaskQuality, videos: int, progress: Progress) -> _Section:
    store = dataset.task(quality.name)
    rows = itertools.islice((row for row in store.rows() if row.held), videos)
    films = [_film(dataset, store, row, number, progress) for number, row in enumerate(rows)]
    shots = contact_sheet(store, dataset.path, MEDIA)
    made = tuple(each for each in films if each is not None)
    return _Section(quality, interval(quality.held, quality.tried), charts(quality), made, shots)


def _film(dataset: DataSet, store: TaskStore, row: Episode, number: int, progress: Progress) -> tuple[str, str]:
    """Record a demonstration's video; return the paths of the video and of a still image."""
    name = f"{MEDIA}/{store.name}" + (f"_{number}" if number else "")
    video, still = f"{name}.mp4", f"{name}.png"
    if (dataset.path / video).exists() and (dataset.path / still).exists():
        return video, still
    progress.start(f"{store.name}: film", 1)
    replay = Replay.of(store.recording(row), dataset.scene.with_task(store.spec()))
    made = film(replay, dataset.path / video, still=dataset.path / still)
    progress.message(f"{store.name}: in the film, {made.renderer}")
    progress.advance()
    return video, still
