"""Draw estimates and ground truth: parts, joint axis and keypoints, from the front and from above."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gensim2.core.arrays import Array
from gensim2.core.files import write_atomic
from gensim2.perception.cloud import from_steps
from gensim2.perception.estimation.estimator import ObjectEstimate, SceneEstimator
from gensim2.policy.array_file import Arrays

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw


SIDE, WORST, COLUMNS = 240, 10, 5
"""Side length of a view (pixels), number of drawn clouds, and number of clouds in a row of the picture."""
FRAME = 0.7
"""Width of the scene that a view shows, m."""
VIEWS = ((1, 2), (1, 0))
"""Axes of the base frame that point left and up, in the view from the robot and in the view from above."""
STILL, MOVING, ELSE = (90, 110, 140), (230, 140, 30), (205, 205, 205)
TRUE, ESTIMATED = (30, 150, 60), (200, 30, 60)
AXIS = 0.25
"""Length of a drawn joint axis to each side of its centre, m."""


def save_worst(path: Path, estimator: SceneEstimator, arrays: Arrays, rows: Sequence[Mapping[str, Any]]) -> None:
    """Save a picture of the clouds with the largest keypoint errors, the worst cloud first. :func:`save_estimates`
    describes the picture.
    """
    worst = [int(row) for row in np.argsort([-row["keypoint_m"] for row in rows])[:WORST]]
    titles = [f"{rows[row]['name']}: {1000 * rows[row]['keypoint_m']:.0f} mm" for row in worst]
    save_estimates(path, estimator, arrays, rows, worst, titles)


def save_estimates(
    path: Path,
    estimator: SceneEstimator,
    arrays: Arrays,
    rows: Sequence[Mapping[str, Any]],
    shown: Sequence[int],
    titles: Sequence[str],
) -> None:
    """Save a picture of clouds with the estimates for the true class, from the front and from above.

    Points of the estimated fixed part are blue, points of the moving part orange. Axes are drawn as lines and keypoints
    as circles: the truth is green, estimates are red.

    Args:
        path: PNG file.
        estimator: estimator whose estimates are drawn.
        arrays: labelled clouds.
        rows: errors of the estimates for these clouds.
        shown: rows of the clouds that are drawn, in this order.
        titles: a line of text for each drawn cloud.

    Raises:
        WriteError: the file cannot be written.
    """
    from PIL import Image, ImageDraw

    height = (2 * SIDE + 20) * -(-len(shown) // COLUMNS)
    image = Image.new("RGB", (SIDE * min(COLUMNS, len(shown)), height), "white")
    draw = ImageDraw.Draw(image)
    for place, (row, title) in enumerate(zip(shown, titles, strict=True)):
        x, y = SIDE * (place % COLUMNS), (2 * SIDE + 20) * (place // COLUMNS)
        draw.text((x + 4, y + 4), title, fill="black")
        cloud = from_steps(arrays["points"][row])
        found = estimator.estimate(cloud, rows[row]["name"]).objects
        middle = np.median(cloud, axis=0).astype(np.float64)
        for view, axes in enumerate(VIEWS):
            at = np.array([x, y + 20 + SIDE * view])
            _draw(draw, at, list(axes), middle, cloud.astype(np.float64), found[0] if found else None)
            _mark(draw, at, list(axes), middle, arrays["origin"][row], arrays["axis"][row], TRUE)
            known = arrays["known"][row].astype(bool)
            _circle(draw, at, list(axes), middle, arrays["keypoints"][row][known], TRUE)
    content = io.BytesIO()
    image.save(content, format="PNG")
    write_atomic(path, content.getvalue())


def _draw(
    draw: ImageDraw, at: Array, axes: list[int], middle: Array, cloud: Array, found: ObjectEstimate | None
) -> None:
    colors = np.tile(ELSE, (len(cloud), 1))
    if found is not None:
        colors[found.points] = np.where(found.moving[:, None], MOVING, STILL)
    for (x, y), color in zip(_pixels(cloud, at, axes, middle), colors, strict=True):
        draw.point((x, y), fill=tuple(map(int, color)))
    if found is not None:
        _mark(draw, at, axes, middle, found.joint.origin, found.joint.axis, ESTIMATED)
        _circle(draw, at, axes, middle, np.array(list(found.keypoints.values())), ESTIMATED)


def _mark(
    draw: ImageDraw, at: Array, axes: list[int], middle: Array, origin: Array, axis: Array, color: tuple[int, int, int]
) -> None:
    """Draw a segment of a joint axis. The segment is centred at the point of the axis that is closest to the centre of
    the view.
    """
    nearest = origin + ((middle - origin) @ axis) * axis
    ends = _pixels(np.stack([nearest - AXIS * axis, nearest + AXIS * axis]), at, axes, middle)
    draw.line([tuple(map(float, end)) for end in ends], fill=color, width=2)


def _circle(
    draw: ImageDraw, at: Array, axes: list[int], middle: Array, points: Array, color: tuple[int, int, int]
) -> None:
    for x, y in _pixels(points, at, axes, middle):
        draw.ellipse((x - 4, y - 4, x + 4, y + 4), outline=color, width=2)


def _pixels(points: Array, at: Array, axes: list[int], middle: Array) -> Array:
    """Project points to pixels of the picture, which shows the scene in two views: from the robot and from above.

    Args:
        points: (N, 3) points in the base frame, m.
        at: (2,) pixel of the view's upper left corner in the picture.
        axes: indices of the two coordinates in the base frame that increase to the left and upwards in the view.
        middle: (3,) point in the base frame that is drawn at the centre of the view.

    Returns:
        (N, 2) pixel coordinates in the picture. Points outside the view are moved to its edge.
    """
    seen = (np.asarray(points, dtype=np.float64) - middle)[:, axes] * [-1.0, -1.0] * SIDE / FRAME + SIDE / 2
    return np.asarray(at + np.clip(seen, 0, SIDE - 1))
