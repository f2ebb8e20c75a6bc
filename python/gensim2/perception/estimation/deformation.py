"""Deform labelled clouds at random, so that the training sees shapes that no generator makes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.perception.cloud import from_steps, to_steps
from gensim2.perception.estimation.examples import SETTINGS
from gensim2.perception.estimation.network import TARGET

Example = Mapping[str, npt.NDArray[Any]]

DEFORMED = 0.8
"""Fraction of the training clouds that are deformed."""
SMALLEST, LARGEST = 0.8, 1.8
"""Range of the common factor by which all lengths are scaled."""
STRETCH = 0.2
"""Standard deviation of the logarithm of the additional factor of each axis."""
SHORTEST, LONGEST = 0.25, 0.8
"""Range of the wavelength of a warp, m."""
STEEPNESS = 0.2
"""Maximum slope of a warp."""
ADDED, REMOVED = 0.4, 0.4
"""Fraction of the deformed clouds with an added box, and fraction with a hole."""
MOST_ADDED, MOST_REMOVED = 120, 350
"""Maximum number of points of an added box, and maximum number of points that a hole removes."""
LARGEST_BOX, LARGEST_HOLE = 0.08, 0.10
"""Maximum half edge of an added box and maximum radius of a hole, m."""
LEAST_KEPT = 64
"""Minimum number of points on the object. If a hole and the limits of the workspace together would leave fewer points,
no point is replaced."""


def deformed(example: Example, generator: np.random.Generator) -> dict[str, npt.NDArray[Any]]:
    """Return a labelled cloud that is deformed at random, and labels that fit the deformed object.

    The fraction ``DEFORMED`` of the clouds is deformed. The whole cloud is scaled by different factors along the axes
    of the object's frame, and then warped smoothly. Some clouds get an additional box, and some a hole. The number of
    points stays the same: points of a new box replace random points, and copies of random points replace points in a
    hole and points that leave the workspace.

    Args:
        example: arrays of one cloud, as :func:`~gensim2.perception.estimation.examples.example` returns them, with the
            array ``features``. The base frame must have the same orientation as the world.
        generator: random generator.

    Returns:
        The arrays of the deformed cloud, with the names, shapes and units of ``example``.
    """
    if generator.random() >= DEFORMED:
        return dict(example)
    xyz = from_steps(example["points"]).astype(np.float64)
    features = example["features"].astype(np.float64) / 127
    found = dict(example)
    factors = np.exp(
        generator.uniform(np.log(SMALLEST), np.log(LARGEST)) + STRETCH * generator.standard_normal(3).clip(-2, 2)
    )
    # The axes of the object's frame are the world's axes, rotated by the yaw.
    frame = np.asarray(Rotation.from_euler("z", np.arctan2(example["yaw"][1], example["yaw"][0])).as_matrix())
    stretch = frame @ np.diag(factors) @ frame.T
    middle = np.append(np.median(xyz[example["group"] == TARGET, :2], axis=0), 0.0)
    axis = stretch @ example["axis"]
    axis /= np.linalg.norm(axis)
    if example["revolute"]:
        found["openness"] = np.asarray(_stretched_openness(example, stretch), dtype=np.float32)
    else:
        along = np.linalg.norm(stretch @ example["axis"])
        found["limits"] = (example["limits"] * along).astype(np.float32)
    wave = _Wave(axis, generator)

    def moved(points: Array) -> Array:
        return wave.moved(middle + (points - middle) @ stretch.T)

    normals = features[:, :3] @ np.linalg.inv(stretch)
    normals = wave.rotated(middle + (xyz - middle) @ stretch.T, normals)
    xyz = moved(xyz)
    group, moving = example["group"].copy(), example["moving"].copy()
    rest = features[:, 3:]
    if generator.random() < ADDED:
        # The box lies on the outer side of the surface at a random point of the object.
        place = generator.choice(np.flatnonzero(group == TARGET))
        rows = generator.choice(len(xyz), int(generator.integers(12, MOST_ADDED)), replace=False)
        xyz[rows], normals[rows] = _box(xyz[place], normals[place], frame, len(rows), generator)
        rest[rows] = np.array([0.0, 0.6])
        group[rows], moving[rows] = TARGET, moving[place]
    lost = ((xyz < SETTINGS.low) | (xyz > SETTINGS.high)).any(axis=1)
    if generator.random() < REMOVED:
        center = xyz[generator.choice(np.flatnonzero(group == TARGET))]
        hole = np.linalg.norm(xyz - center, axis=1) < generator.uniform(0.02, LARGEST_HOLE)
        lost |= hole if hole.sum() <= MOST_REMOVED else False
    rows = np.arange(len(xyz))
    if (group[~lost] == TARGET).sum() >= LEAST_KEPT:
        rows[lost] = generator.choice(np.flatnonzero(~lost), int(lost.sum()))
    xyz, normals = xyz[rows], normals[rows]
    inward = (normals * (xyz - np.median(xyz, axis=0))).sum(axis=1) < 0
    normals = np.where(inward[:, None], -normals, normals)
    return found | {
        "points": to_steps(xyz.astype(np.float32)),
        "features": np.rint(127 * np.concatenate([normals, rest[rows]], axis=1)).astype(np.int8),
        "group": group[rows],
        "moving": moving[rows],
        "axis": axis.astype(np.float32),
        "origin": moved(example["origin"][None])[0].astype(np.float32),
        "keypoints": (moved(example["keypoints"]) * example["known"][:, None]).astype(np.float32),
        "size": (example["size"] * factors).astype(np.float32),
    }


class _Wave:
    """Random displacement of points along one direction, which is a sine of the position.

    The displacement is constant along the joint axis, so a straight axis stays straight.
    """

    def __init__(self, axis: Array, generator: np.random.Generator) -> None:
        across = np.cross(axis, generator.standard_normal(3))
        length = generator.uniform(SHORTEST, LONGEST)
        self._wave = 2 * np.pi / length * across / np.linalg.norm(across)
        direction = generator.standard_normal(3)
        slope = generator.uniform(0.0, STEEPNESS)
        self._by = slope * length / (2 * np.pi) * direction / np.linalg.norm(direction)
        self._phase = generator.uniform(0.0, 2 * np.pi)

    def moved(self, points: Array) -> Array:
        """Return displaced points (N, 3)."""
        return np.asarray(points + np.sin(points @ self._wave + self._phase)[:, None] * self._by)

    def rotated(self, points: Array, normals: Array) -> Array:
        """Return the unit normals of the displaced surface. ``points`` (N, 3) are the positions before the
        displacement, and ``normals`` (N, 3) the normals there.
        """
        # The Jacobian of the displacement is I + c b k^T, so that the normals are multiplied by the transpose of its
        # inverse, which is I - c k b^T / (1 + c b.k).
        c = np.cos(points @ self._wave + self._phase)
        by = c / (1 + c * (self._by @ self._wave)) * (normals @ self._by)
        found = normals - by[:, None] * self._wave
        return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9))


def _stretched_openness(example: Example, stretch: Array) -> float:
    """Return the openness (0 to 1) of a revolute joint after the object was stretched. The angle between the moving
    part and its closed position changes, because the stretch differs between the axes.
    """
    lower, upper = map(float, example["limits"])
    value = lower + float(example["openness"]) * (upper - lower)
    axis = example["axis"].astype(np.float64)
    out = example["keypoints"][0] - example["origin"].astype(np.float64)
    out -= (out @ axis) * axis
    closed = Rotation.from_rotvec((lower - value) * axis).apply(out)
    across = stretch @ axis
    across /= np.linalg.norm(across)

    def angle(arm: Array) -> float:
        """Return the angle (rad) about the axis by which the stretch rotates a vector that starts at the axis."""
        longer = stretch @ arm
        longer -= (longer @ across) * across
        return float(np.arctan2(np.cross(arm, longer) @ axis, arm @ longer))

    found = value + angle(out) - angle(closed)
    return float(np.clip((found - lower) / max(upper - lower, 1e-6), 0.0, 1.0))


def _box(at: Array, normal: Array, frame: Array, count: int, generator: np.random.Generator) -> tuple[Array, Array]:
    """Return ``count`` random points (N, 3) on a box centred at ``at``, and their normals (N, 3).

    Points behind the plane through ``at`` with the given normal are mirrored to its front. The edges of the box are
    parallel to the columns of ``frame``.
    """
    half = generator.uniform(0.005, LARGEST_BOX, 3)
    points = generator.uniform(-1.0, 1.0, (count, 3))
    side = generator.choice(3, count, p=np.roll(half, 1) * np.roll(half, 2) / _face_areas(half))
    rows = np.arange(count)
    points[rows, side] = np.where(points[rows, side] < 0, -1.0, 1.0)
    normals = np.zeros((count, 3))
    normals[rows, side] = points[rows, side]
    points, normals = (points * half) @ frame.T, normals @ frame.T
    behind = points @ normal < 0
    for vectors in (points, normals):
        vectors[behind] -= 2 * (vectors[behind] @ normal)[:, None] * normal
    return at + points, normals


def _face_areas(half: Array) -> float:
    return float((np.roll(half, 1) * np.roll(half, 2)).sum())
