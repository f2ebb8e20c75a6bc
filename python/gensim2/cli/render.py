"""``gensim2 render``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report
from gensim2.core.errors import InputError


@click.command("render", cls=options.Command, short_help="Make observations of a data set's states.")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--modalities",
    default="pointcloud",
    show_default=True,
    metavar="LIST",
    help="Observations to make, of pointcloud, rgb, depth, segmentation; rgb needs a Vulkan driver.",
)
@click.option("--cameras", default="left,right,front", show_default=True, metavar="LIST", help="Those that are used.")
@click.option(
    "--points", type=options.count(49152), default=1024, show_default=True, help="Number of points of a cloud."
)
@click.option(
    "--source",
    type=click.Choice(("depth", "keypoints")),
    default="depth",
    show_default=True,
    help="What clouds are made of: depth pictures, or the true places of the objects' keypoints and of the corners of "
    "their boxes, which only a simulator knows, for privileged baselines.",
)
@click.option(
    "--keep-robot",
    type=click.Choice(("gripper", "all", "none")),
    default="gripper",
    show_default=True,
    help="What point clouds hold of the robot.",
)
@click.option(
    "--drop-outliers",
    type=click.FloatRange(0, 100, min_open=True),
    default=None,
    metavar="DEVIATIONS",
    help="Drop points that stand alone: farther from their neighbours than the mean by so many standard deviations.",
)
@click.option("--depth-noise", is_flag=True, help="White noise with a RealSense D435's numbers: as --noise white.")
@options.noise(None, "Let depth be as a stereo camera would measure it")
@click.option("--task", "tasks", multiple=True, metavar="NAME", help="Only this one; may be given again.")
@click.option(
    "--episodes",
    type=options.count(),
    default=None,
    metavar="N",
    help="Number of episodes of each task, the first that held.  [default: all]",
)
@options.moved_assets
@options.workers
@click.option("--resume", is_flag=True, help="Go on with the observations that DIR holds.")
@options.time_limit
@options.jobs_per_worker
@options.json_file
def render(
    folder: Path,
    modalities: str,
    cameras: str,
    points: int,
    source: str,
    keep_robot: str,
    drop_outliers: float | None,
    depth_noise: bool,
    noise: str | None,
    json_file: str | None,
    **given: Any,
) -> None:
    """Observe what the episodes of the data set DIR saw, from their recorded states; nothing is simulated again.

    Point clouds, depth and segmentation are ray-cast and need no GPU; rgb is the renderer's.
    """
    with report(json_file, _show) as (progress, give):
        from gensim2.data.rendering import render as function
        from gensim2.perception import CloudSettings, ObservationSpec
        from gensim2.perception.cloud import candidates_for
        from gensim2.perception.noise_file import read_noise

        if depth_noise and noise is not None:
            raise InputError("says it already", field="--noise", remedy="leave out --depth-noise")
        named = "white" if depth_noise else noise

        settings = CloudSettings(
            points=points,
            candidates=candidates_for(points),
            robot=keep_robot,  # type: ignore[arg-type]  # a choice of the option
            outliers=drop_outliers,
            noise=None if named is None else read_noise(named),
            source=source,  # type: ignore[arg-type]  # a choice of the option
        )
        spec = ObservationSpec(_words(modalities, "--modalities"), _words(cameras, "--cameras"), settings)  # type: ignore[arg-type]
        give(function(folder, spec=spec, progress=progress, **given).to_dict())


def _words(text: str, option: str) -> tuple[str, ...]:
    words = tuple(word.strip() for word in text.split(","))
    if not all(words):
        raise InputError("must be words with commas between them", field=option)
    return words


def _show(result: dict[str, Any]) -> None:
    each = f" ({1e3 * result['cpu_s'] / result['frames']:.1f} ms of CPU a frame)" if result["frames"] else ""
    line(f"{result['rendered']} episodes rendered, {result['frames']} frames{each}")
    line(f"{result['episodes']} episodes have observations, {result['bytes'] / 1e6:.1f} MB")
