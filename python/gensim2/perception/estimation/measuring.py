"""Measure the errors of an estimator on labelled clouds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.seeding import rng
from gensim2.objects import open_library
from gensim2.perception.cloud import from_steps
from gensim2.perception.estimation.classes import by_name
from gensim2.perception.estimation.estimator import DEVIATIONS, ObjectEstimate, SceneEstimator
from gensim2.perception.estimation.examples import Example, example, object_looks, stacked
from gensim2.policy.array_file import Arrays
from gensim2.robots import DEFAULT_ROBOT, robot

MISSED = {
    "axis_degrees": 180.0,
    "axis_m": 0.5,
    "keypoint_m": 0.5,
    "openness": 1.0,
    "part_iou": 0.0,
    "yaw_degrees": 180.0,
}
"""Errors that count for an object that was not found."""
ONE_SIGMA = 0.6827


def row_of(arrays: Arrays, row: int, found: ObjectEstimate | None) -> dict[str, Any]:
    """Return the errors of one estimate.

    Args:
        arrays: labelled clouds.
        row: index of the cloud.
        found: estimated object; None if no object was found.
    """
    revolute = bool(arrays["revolute"][row])
    if found is None:
        return {**MISSED, "missed": True, "revolute": revolute}
    known = arrays["known"][row].astype(bool)
    axis, origin = arrays["axis"][row].astype(np.float64), arrays["origin"][row].astype(np.float64)
    angle = float(np.degrees(np.arccos(np.clip(axis @ found.joint.axis, -1.0, 1.0))))
    away = found.joint.origin - origin
    distance = float(np.linalg.norm(away - (away @ axis) * axis))
    truth = arrays["keypoints"][row][known]
    places = np.array(list(found.keypoints.values()))
    same = len(places) == len(truth)
    errors = np.linalg.norm(places - truth, axis=1) if same else np.full(len(truth), MISSED["keypoint_m"])
    moving = np.zeros(arrays["group"].shape[1], dtype=bool)
    moving[found.points[found.moving]] = True
    still = np.zeros_like(moving)
    still[found.points[~found.moving]] = True
    on_it = arrays["group"][row] == 2
    parts = [(moving, on_it & (arrays["moving"][row] > 0)), (still, on_it & (arrays["moving"][row] == 0))]
    ious = [float((ours & theirs).sum() / (ours | theirs).sum()) for ours, theirs in parts if theirs.any()]
    yaw = np.arctan2(arrays["yaw"][row][1], arrays["yaw"][row][0])
    off = abs((found.yaw - yaw + np.pi) % (2 * np.pi) - np.pi)
    likeliest = max(found.classes, key=lambda name: found.classes[name])
    deviations = list(found.keypoint_deviations.values()) if same else []
    return {
        "likeliest": likeliest,
        "missed": False,
        "revolute": revolute,
        "axis_degrees": angle,
        "axis_m": distance if revolute else None,
        "keypoint_m": float(errors.mean()),
        "openness": abs(found.joint.openness - float(arrays["openness"][row])),
        "part_iou": float(np.mean(ious)),
        "yaw_degrees": float(np.degrees(off)),
        "ratios": {
            "openness": [abs(found.joint.openness - float(arrays["openness"][row])) / found.joint.openness_deviation],
            "axis": [distance / found.joint.origin_deviation] if revolute else [],
            "keypoints": [float(error / each) for error, each in zip(errors, deviations, strict=False)],
        },
    }


def measured(estimator: SceneEstimator, arrays: Arrays, *, given: bool = False) -> list[dict[str, Any]]:
    """Return the errors of the estimates for all clouds; with ``given`` the estimator gets the true class."""
    names = [each.name for each in estimator.classes]
    rows = []
    for row, number in enumerate(arrays["class"]):
        truth = names[int(number)]
        found = estimator.estimate(from_steps(arrays["points"][row]), truth if given else None).objects
        each = row_of(arrays, row, found[0] if found else None)
        rows.append({**each, "name": truth, "class": not each["missed"] and each["likeliest"] == truth})
    return rows


def figures(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the median and the 90th percentile of each kind of error. An object that the estimator did not find
    contributes the errors in ``MISSED``.
    """

    def of(name: str) -> list[float]:
        return [row[name] for row in rows if row.get(name) is not None]

    found: dict[str, Any] = {
        "clouds": len(rows),
        "missed": sum(row["missed"] for row in rows),
        "class": float(np.mean([row["class"] for row in rows])),
        "part_iou": float(np.mean(of("part_iou"))),
    }
    for name in ("axis_degrees", "axis_m", "keypoint_m", "openness", "yaw_degrees"):
        values = of(name)
        if values:
            found[name] = [round(float(np.median(values)), 4), round(float(np.quantile(values, 0.9)), 4)]
    ratios = [row["ratios"] for row in rows if "ratios" in row]
    found["within_one_deviation"] = {
        name: round(float(np.mean([ratio <= 1 for each in ratios for ratio in each[name]])), 3)
        for name in DEVIATIONS
        if any(each[name] for each in ratios)
    }
    return found


def measure(
    folder: Path | str,
    *,
    out: Path | None = None,
    assets: Path | str | None = None,
    instances: str = "new",
    objects: int = 4,
    looks: int = 4,
    noisy: bool = False,
    classes: Sequence[str] = (),
    robot_name: str = DEFAULT_ROBOT,
    seed: int = 0,
    progress: Progress = NULL_PROGRESS,
) -> dict[str, Any]:
    """Measure an estimator on clouds of articulated objects that stand alone.

    Args:
        folder: estimator, as for :meth:`SceneEstimator.load`.
        out: folder for ``worst.png``, a picture of the clouds with the largest errors; None: no picture.
        assets: library of the objects, as for :func:`~gensim2.objects.open_library`.
        instances: selection of objects, as in ``--instances``.
        objects: maximum number of objects of each class.
        looks: number of clouds of each object.
        noisy: whether the depth pictures have the noise of a deployed camera.
        classes: classes to measure; empty: all classes of the estimator.
        robot_name: name of the robot in the scenes.
        seed: seed of all random values.
        progress: listener.

    Returns:
        Plain data with the settings and the error statistics. In the statistics ``estimated`` the estimator also
        estimates the class of the object. In the statistics ``given`` the estimator is told the true class. ``classes``
        contains the statistics ``given`` for each class separately. For each true class, ``estimated_classes`` counts
        how many clouds were assigned to each estimated class.

    Raises:
        InputError: the estimator cannot be read, or a class or object does not exist.
    """
    from gensim2.perception.estimation.pictures import save_worst

    profile = robot(robot_name)
    estimator, library = SceneEstimator.load(folder, profile), open_library(assets)
    names = [each.name for each in estimator.classes]
    drawn = [names[by_name(estimator.classes, name)] for name in classes] or names
    ids = [(name, each) for name in drawn for each in library.choose(name, instances)[:objects]]
    progress.start("looking at objects", len(ids))
    clouds: list[Example] = []
    for name, each in ids:
        generator = rng(seed, f"perception/measure/{name}/{each}")
        found = object_looks(library, profile, name, each, looks, generator, noisy=float(noisy), accompanied=0.0)
        clouds += [example(look, names, profile) for look in found]
        progress.advance()
    if not clouds:
        raise InputError("the cameras see none of the objects", field="classes", remedy="give other classes")
    arrays = stacked(clouds)
    rows, given = measured(estimator, arrays), measured(estimator, arrays, given=True)
    if out is not None:
        save_worst(out / "worst.png", estimator, arrays, given)
    return {
        "schema_version": 1,
        "estimator": str(folder),
        "assets": str(library.location),
        "instances": instances,
        "noise": "deployed" if noisy else None,
        "objects": len(ids),
        "estimated": figures(rows),
        "given": figures(given),
        "classes": {name: figures([row for row in given if row["name"] == name]) for name in drawn},
        "estimated_classes": {
            name: Counter(row.get("likeliest", "no object") for row in rows if row["name"] == name) for name in drawn
        },
    }


def calibrated(estimator: SceneEstimator, arrays: Arrays) -> dict[str, Any]:
    """Calibrate the standard deviations that an estimator predicts. The standard deviations are multiplied by factors.
    The factors are chosen such that the fraction ``ONE_SIGMA`` of the errors is smaller than the scaled standard
    deviations.

    Args:
        estimator: estimator to calibrate. The function sets the scale factors in its attribute ``scales``.
        arrays: labelled clouds of objects that were not used for training.

    Returns:
        Error statistics after calibration.
    """
    estimator.scales = dict.fromkeys(DEVIATIONS, 1.0)
    rows = measured(estimator, arrays, given=True)
    for name in DEVIATIONS:
        ratios = [ratio for row in rows if "ratios" in row for ratio in row["ratios"][name]]
        if ratios:
            estimator.scales[name] = max(float(np.quantile(ratios, ONE_SIGMA)), 1e-3)
    return figures(measured(estimator, arrays, given=True))
