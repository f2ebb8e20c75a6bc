"""``quality.html`` and ``quality.json``: coverage of a data set in images and numbers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gensim2.core.files import write_atomic, write_json
from gensim2.core.pages import template
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.charts import charts
from gensim2.data.dataset import DataSet
from gensim2.data.quality import TaskQuality, qualities
from gensim2.data.sheet import Shot, contact_sheet, film_seen
from gensim2.data.store import TaskStore
from gensim2.data.video import Replay, film
from gensim2.rollout.record import Episode
from gensim2.rollout.tally import interval

HTML, JSON, MEDIA = "quality.html", "quality.json", "quality"
SCHEMA_VERSION = 1


@dataclass(frozen=True)
class _Section:
    """Section of the report about one task.

    Attributes:
        quality: its figures.
        interval: 95 % interval of the success rate.
        charts: SVG charts.
        video, still: file names beside the page; None without a renderer.
        shots: images of rendered demonstrations; empty if the data set was not rendered.
    """

    quality: TaskQuality
    interval: tuple[float, float]
    charts: tuple[str, ...]
    video: str | None
    still: str | None
    shots: tuple[Shot, ...]


def report(
    path: Path, *, video: bool = True, assets: Path | str | None = None, progress: Progress = NULL_PROGRESS
) -> dict[str, Any]:
    """Analyse every episode of a data set, and write page and figures into its folder.

    Args:
        path: folder of the data set.
        video: record a video of each task's first demonstration, if this machine can render.
        assets: present folder of its objects; None: the recorded folder.

    Returns:
        The figures.

    Raises:
        InputError: the data set cannot be read, its collection is incomplete, or an object is missing or has changed.
    """
    dataset = DataSet.open(path, assets)
    sections = [_section(dataset, quality, video, progress) for quality in qualities(dataset, progress)]
    numbers = {"schema_version": SCHEMA_VERSION, "tasks": [section.quality.to_dict() for section in sections]}
    write_json(path / JSON, numbers)
    page = template("gensim2.data", "quality.html.j2").render(sections=sections, record=dataset.record.model_dump())
    write_atomic(path / HTML, page)
    return numbers


def _section(dataset: DataSet, quality: TaskQuality, video: bool, progress: Progress) -> _Section:
    store = dataset.task(quality.name)
    first = next((row for row in store.rows() if row.held), None)
    filmed = _film(dataset, store, first, progress) if video and first is not None else (None, None)
    shots = contact_sheet(store, dataset.path, MEDIA)
    return _Section(quality, interval(quality.held, quality.tried), charts(quality), *filmed, shots)


def _film(dataset: DataSet, store: TaskStore, row: Episode, progress: Progress) -> tuple[str | None, str | None]:
    """Record a demonstration's video by replaying it, or from its observations if this machine cannot render."""
    from gensim2.sim import rendering

    video, still = f"{MEDIA}/{store.name}.mp4", f"{MEDIA}/{store.name}.png"
    if (dataset.path / video).exists() and (dataset.path / still).exists():
        return video, still
    progress.start(f"{store.name}: film", 1)
    if not rendering.can_render():
        if not film_seen(store, row, dataset.path / video, dataset.path / still):
            progress.message(f"{store.name}: no video: {rendering.NO_DRIVER}")
            return None, None
    else:
        recording = store.read(row).recording
        assert recording is not None
        scene = dataset.scene
        replay = Replay.of(recording, store.spec(), scene.assets, scene.environment)
        film(replay, dataset.path / video, still=dataset.path / still)
    progress.advance()
    return video, still
