"""``quality.html`` and ``quality.json``: what a data set covers, in pictures and in numbers."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gensim2.data.quality import TaskQuality, qualities
from gensim2.data.store import DataSet, TaskStore
from gensim2.episodes.video import Replay, film
from gensim2.errors import MissingExtraError
from gensim2.files import write_atomic, write_json
from gensim2.pages import template
from gensim2.pipeline.tally import interval
from gensim2.progress import NULL_PROGRESS, Progress

HTML, JSON, MEDIA = "quality.html", "quality.json", "quality"
SCHEMA_VERSION = 1


@dataclass(frozen=True)
class _Section:
    """What the page shows of a task.

    Attributes:
        quality: its numbers.
        interval: 95 % of the share that holds.
        plot: SVG.
        video, still: file names beside the page; None where no picture could be made.
    """

    quality: TaskQuality
    interval: tuple[float, float]
    plot: str
    video: str | None
    still: str | None


def report(path: Path, *, video: bool = True, progress: Progress = NULL_PROGRESS) -> dict[str, Any]:
    """Look at every episode of a data set; write the page and the numbers into its folder.

    Args:
        path: of the data set.
        video: film the first demonstration of each task, where this machine can draw pictures.
        progress: listener.

    Returns:
        The numbers.

    Raises:
        InputError: the data set cannot be read, or its collection is not complete.
    """
    dataset = DataSet.open(path)
    sections = []
    for quality in qualities(dataset, progress):
        pictures = _film(dataset, dataset.task(quality.name), progress) if video and quality.held else (None, None)
        sections.append(_Section(quality, interval(quality.held, quality.tried), _plot(quality), *pictures))
    numbers = {"schema_version": SCHEMA_VERSION, "tasks": [section.quality.to_dict() for section in sections]}
    write_json(path / JSON, numbers)
    page = template("gensim2.data", "quality.html.j2").render(sections=sections, record=dataset.record.model_dump())
    write_atomic(path / HTML, page)
    return numbers


def _film(dataset: DataSet, store: TaskStore, progress: Progress) -> tuple[str | None, str | None]:
    from gensim2.sim import rendering

    video, still = f"{MEDIA}/{store.name}.mp4", f"{MEDIA}/{store.name}.png"
    if (dataset.path / video).exists() and (dataset.path / still).exists():
        return video, still
    if not rendering.can_render():
        progress.message(f"{store.name}: no video: {rendering.NO_DRIVER}")
        return None, None
    progress.start(f"{store.name}: film", 1)
    recording = store.read(next(row for row in store.rows() if row.held)).recording
    assert recording is not None
    circumstances = dataset.record.circumstances
    replay = Replay.of(recording, store.spec(), circumstances.assets, circumstances.environment)
    film(replay, dataset.path / video, still=dataset.path / still)
    progress.advance()
    return video, still


def _plot(quality: TaskQuality) -> str:
    """Where objects stood, how far open they were, how long it took and how smoothly the arm moved."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError("matplotlib", "data") from error
    figure = Figure(figsize=(11, 2.6), layout="constrained")
    places, openness, lengths, jerks = figure.subplots(1, 4)
    for held, colour, label in ((True, "#2a7d4f", "held"), (False, "#c0392b", "not held")):
        points = [(x, y) for x, y, _, each in quality.places if each == held]
        if points:
            # The robot looks along x: what lies to its left is left in the picture.
            places.scatter([-y for _, y in points], [x for x, _ in points], s=6, c=colour, label=label, linewidths=0)
    places.set(title="where it stood (m)", xlabel="right of the robot", ylabel="ahead", aspect="equal")
    places.legend(fontsize=7, loc="upper right")
    for axes, values, title, unit in (
        (openness, quality.openness, "openness at the start", "share"),
        (lengths, quality.lengths, "length", "control steps"),
        (jerks, quality.jerks, "jerk, root mean square", "rad/s³"),
    ):
        if values:
            axes.hist(values, bins=min(20, len(values)), color="#3867b0")
            axes.yaxis.get_major_locator().set_params(integer=True)
        else:
            axes.text(0.5, 0.5, "none", ha="center", va="center", transform=axes.transAxes)
        axes.set(title=title, xlabel=unit)
    for axes in (places, openness, lengths, jerks):
        axes.title.set_size(9)
        axes.tick_params(labelsize=7)
    stream = io.StringIO()
    # Without a date and with fixed names: the same data give the same bytes.
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": quality.name}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]
