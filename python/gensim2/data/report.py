"""Write ``quality.html`` and ``quality.json``, which show the coverage of a data set in images and numbers."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gensim2.core.files import write_atomic, write_json
from gensim2.core.pages import template
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.charts import charts
from gensim2.data.dataset import DataSet
from gensim2.data.quality import TaskQuality, qualities
from gensim2.data.sheet import Shot, contact_sheet
from gensim2.data.store import TaskStore
from gensim2.data.video import Replay, film
from gensim2.rollout.record import Episode
from gensim2.rollout.tally import interval

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
        path: folder of the data set.
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
