"""Commands ``gensim2 perceive``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import click

from gensim2.cli.options import command
from gensim2.cli.output import line, table
from gensim2.cli.typed import Count, Folder, Name, Option
from gensim2.core.errors import InputError
from gensim2.core.progress import Progress

Classes = Annotated[tuple[str, ...], Option("--class", "NAME")]


def _show_training(result: dict[str, Any]) -> None:
    table(
        ("what", "value"),
        [
            ("classes", ", ".join(result["classes"])),
            ("clouds", str(result["clouds"])),
            ("steps", str(result["steps"])),
            ("CPU s of the steps", f"{result['cpu_s']:.0f}"),
            ("weights", str(result["parameters"])),
        ],
    )
    line(f"estimator: {result['folder']}")


def _show_measure(result: dict[str, Any]) -> None:
    rows = {"all, class given": result["given"], "all": result["estimated"], **result["classes"]}
    cells = {name: error_cells(found) for name, found in rows.items()}
    heads = next(iter(cells.values()))
    table(("of", *heads), [(name, *found.values()) for name, found in cells.items()])
    line("the rows of classes have the class given; pairs of numbers are the median and the 90th percentile")


def error_cells(found: dict[str, Any]) -> dict[str, str]:
    """Format the statistics of :func:`~gensim2.perception.estimation.measuring.figures` by column title."""

    def pair(name: str, scale: float, digits: int) -> str:
        return " / ".join(f"{scale * value:.{digits}f}" for value in found.get(name, ()))

    return {
        "clouds": str(found["clouds"]),
        "missed": str(found["missed"]),
        "class": f"{found['class']:.2f}",
        "axis, degrees": pair("axis_degrees", 1.0, 1),
        "axis, mm": pair("axis_m", 1000.0, 0),
        "keypoints, mm": pair("keypoint_m", 1000.0, 0),
        "openness": pair("openness", 1.0, 2),
        "part IoU": f"{found['part_iou']:.2f}",
    }


@command("resume", "robot", "seed", show=_show_training)
def train(
    *,
    out: Folder,
    classes: Classes = (),
    assets: Annotated[str, Option(metavar="DIR|builtin")] = "builtin",
    objects: Count = 60,
    objects_of: Annotated[tuple[str, ...], Option("--objects-of", "CLASS=COUNT")] = (),
    others: Count = 4,
    looks: Count = 12,
    steps: Count = 4000,
    batch: Count = 24,
    start: Annotated[str | None, Option("--from", "DIR|builtin")] = None,
    stand_ins: Annotated[tuple[str, ...], Option("--stand-in", "CLASS")] = (),
    robot: str,
    progress: Progress,
    **given: Any,
) -> dict[str, Any]:
    """Train a network that estimates articulated objects from point clouds.

    The command places objects at random, renders point clouds by ray casting without simulation, and trains a network
    on them. The trained estimator is written to --out.

    Args:
        out: Output folder.
        classes: Class to learn; can be repeated.  [default: all articulated classes of --assets]
        assets: Folder of training objects, or 'builtin' for generated objects that no evaluation uses.
        objects: Number of training objects of each class.
        objects_of: Number of training objects of one class, instead of --objects; can be repeated. Training uses a
            class with more point clouds more often.
        others: Number of training objects of each class that only the estimator of --from knows. Such a class is not
            forgotten. The objects are generated, or come from --assets if the package does not have the class.
        looks: Number of point clouds of each object; at most 4 of each object of --others.
        steps: Number of gradient steps.
        batch: Number of point clouds in a step.
        start: Continue training from the weights of this estimator. The trained estimator knows the classes of this
            estimator and the classes of --class.
        stand_ins: Class whose estimates are used for objects of classes that the estimator does not know; can be
            repeated. The class must be one of the estimator's classes.  [default: the stand-ins of --from]
    """
    from gensim2.perception.estimation.training import train_estimator

    return train_estimator(
        out,
        classes=classes,
        assets=assets,
        robot_name=robot,
        objects=objects,
        objects_of=_counts(objects_of),
        others=others,
        looks=looks,
        steps=steps,
        batch=batch,
        start=start,
        stand_ins=stand_ins,
        progress=progress,
        **given,
    )


def _counts(given: tuple[str, ...]) -> dict[str, int]:
    """Read the number of objects by class in the values of ``--objects-of``, CLASS=COUNT."""
    found: dict[str, int] = {}
    for text in given:
        name, _, number = text.partition("=")
        if not number.isdecimal() or int(number) == 0:
            remedy = "give CLASS=COUNT, for example drawer=120"
            wrong = f"{text!r} does not contain a class and a positive count"
            raise InputError(wrong, field="--objects-of", remedy=remedy)
        found[name] = int(number)
    return found


@command("assets", "robot", "seed", show=_show_measure)
def measure(
    estimator: Annotated[str, Option(metavar="DIR|builtin")],
    *,
    out: Folder | None = None,
    instances: Annotated[str, Option(metavar="all|train|test|new|ID")] = "new",
    classes: Classes = (),
    objects: Count = 4,
    looks: Count = 4,
    noisy: bool = False,
    robot: str,
    progress: Progress,
    **given: Any,
) -> dict[str, Any]:
    """Measure the errors of an estimator.

    The command gives point clouds of single objects to the estimator DIR, or to the estimator of the package (builtin),
    and compares its estimates with the simulated objects. If the estimator does not find the object in a cloud, the
    command counts fixed large errors for this cloud.

    Args:
        out: Folder for worst.png, a picture of the ten clouds with the largest errors.  [default: no picture]
        instances: Objects to measure on.
        classes: Class to measure; can be repeated.  [default: all classes of the estimator]
        objects: Maximum number of objects of each class.
        looks: Number of point clouds of each object.
        noisy: Add noise to the depth images: the preset deployed, which is the noise d435 plus random calibration and
            clock errors.
    """
    from gensim2.perception.estimation.measuring import measure as function

    return function(
        estimator,
        out=out,
        instances=instances,
        classes=classes,
        objects=objects,
        looks=looks,
        noisy=noisy,
        robot_name=robot,
        progress=progress,
        **given,
    )


def _show_estimates(result: dict[str, Any]) -> None:
    line(result["episode"])
    heads = ("step", "class", "axis, degrees", "axis, mm", "keypoints, mm", "openness", "part IoU")
    table(
        heads,
        [
            (
                str(each["step"]),
                each.get("likeliest", "no object"),
                f"{each['axis_degrees']:.1f}",
                "" if each["axis_m"] is None else f"{1000 * each['axis_m']:.0f}",
                f"{1000 * each['keypoint_m']:.0f}",
                f"{each['openness']:.2f}",
                f"{each['part_iou']:.2f}",
            )
            for each in result["instants"]
        ],
    )
    line(f"the object is a {result['class']}; numbers are errors of the estimates")
    line(f"picture: {result['picture']}")


@command("assets", "seed", show=_show_estimates)
def show(
    what: Annotated[Path, Option(metavar="EPISODE|DATA")],
    *,
    out: Folder,
    estimator: Annotated[str, Option(metavar="DIR|builtin")] = "builtin",
    task: Name | None = None,
    episode: Annotated[int | None, click.IntRange(0), Option(metavar="N")] = None,
    instants: Count = 5,
    noisy: bool = False,
    **given: Any,
) -> dict[str, Any]:
    """Compare estimates with the true object in an episode.

    The argument is an EPISODE file or the folder DATA of a data set. The command estimates the object at several
    instants and draws estimates and truth: parts, joint axis and keypoints.

    Args:
        out: Output folder.
        estimator: Folder of an estimator, or builtin for the estimator of the package.
        task: Task of a data set.  [default: the first task]
        episode: Number of an episode in a data set.  [default: the first successful episode]
        instants: Number of instants, from the start of the episode to its end.
        noisy: Add the noise of a deployed depth camera.
    """
    from gensim2.perception.estimation.episodes import show as function

    return function(what, estimator, out=out, task=task, episode=episode, instants=instants, noisy=noisy, **given)


perceive = click.Group(
    "perceive", commands=[train, measure, show], help="Train and measure estimators of scenes, and show estimates."
)
