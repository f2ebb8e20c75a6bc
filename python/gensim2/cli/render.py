"""Command ``gensim2 render``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from gensim2.cli.options import command
from gensim2.cli.output import line
from gensim2.cli.typed import Option, Real, Tasks, count
from gensim2.core.errors import InputError
from gensim2.core.plural import plural
from gensim2.core.progress import Progress

Words = Annotated[str, Option(metavar="LIST")]


def _words(text: str, option: str) -> tuple[str, ...]:
    words = tuple(word.strip() for word in text.split(","))
    if not all(words):
        raise InputError("the value must be a list of names separated by commas", field=option)
    return words


def _show(result: dict[str, Any]) -> None:
    each = f" ({1e3 * result['cpu_s'] / result['frames']:.1f} ms of CPU a frame)" if result["frames"] else ""
    line(f"{plural(result['rendered'], 'episode')} rendered, {plural(result['frames'], 'frame')}{each}")
    line(f"{plural(result['episodes'], 'episode')} with observations, {result['bytes'] / 1e6:.1f} MB")


@command("moved_assets", "workers", "time_limit", "jobs_per_worker", show=_show)
def render(
    folder: Annotated[Path, Option(metavar="DIR")],
    *,
    modalities: Words = "pointcloud",
    cameras: Words = "left,right,front",
    points: Annotated[int, count(49152)] = 1024,
    source: Literal["depth", "keypoints"] = "depth",
    keep_robot: Literal["gripper", "all", "none"] = "gripper",
    drop_outliers: Annotated[float | None, Real(0, 100, min_open=True), Option(metavar="DEVIATIONS")] = None,
    depth_noise: bool = False,
    noise: str | None = None,
    tasks: Tasks = (),
    episodes: Annotated[int | None, count(), Option(metavar="N")] = None,
    resume: bool = False,
    progress: Progress,
    **given: Any,
) -> dict[str, Any]:
    """Render observations of a data set.

    The command computes observations of the episodes in the data set DIR from their recorded states, without simulating
    them again. Point clouds, depth and segmentation images are ray-cast and need no GPU; rgb images come from the
    renderer.

    Args:
        modalities: Observations to render: pointcloud, rgb, depth or segmentation, separated by commas. rgb needs a
            Vulkan driver.
        cameras: Cameras to use.
        points: Number of points of a point cloud.
        source: Source of the point clouds. depth uses depth images. keypoints uses the true positions of keypoints and
            bounding-box corners. Only a simulator knows these positions, so this source is for privileged baselines.
        keep_robot: Part of the robot whose points stay in the point clouds.
        drop_outliers: Drop isolated points. A point is isolated if its mean distance to its neighbours exceeds the
            average over all points by this number of standard deviations.
        depth_noise: Add white noise with the parameters of a RealSense D435; same as --noise white.
        tasks: Render only this task; can be repeated.
        episodes: Number of episodes of each task, starting with the first successful one.  [default: all]
        resume: Continue an interrupted rendering of DIR.
    """
    from gensim2.data.rendering import render as function
    from gensim2.perception import CloudSettings, ObservationSpec
    from gensim2.perception.cloud import candidates_for
    from gensim2.perception.noise import read_noise

    if depth_noise and noise is not None:
        raise InputError("cannot be combined with --depth-noise", field="--noise", remedy="leave out --depth-noise")
    named = "white" if depth_noise else noise
    settings = CloudSettings(
        points=points,
        candidates=candidates_for(points),
        robot=keep_robot,
        outliers=drop_outliers,
        noise=None if named is None else read_noise(named),
        source=source,
    )
    spec = ObservationSpec(_words(modalities, "--modalities"), _words(cameras, "--cameras"), settings)  # type: ignore[arg-type]
    own: dict[str, Any] = {"tasks": tasks, "episodes": episodes, "resume": resume}
    return function(folder, spec=spec, progress=progress, **own, **given).to_dict()
