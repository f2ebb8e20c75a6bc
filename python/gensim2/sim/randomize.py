"""What differs between episodes of one task: drawn from (seed, task), as plain values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from gensim2.tasks.spec import Randomization

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Draw:
    """What is drawn for one object, apart from what the object itself says.

    Attributes:
        instance: id of the instance.
        x, y, yaw: offset from where it stands before, m and rad, about the world's z axis.
        openness_offset: added to the mean openness.
    """

    instance: str
    x: float
    y: float
    yaw: float
    openness_offset: float


def draw_object(generator: np.random.Generator, ranges: Randomization, instances: Sequence[str]) -> Draw:
    """Five uniform numbers: every value is drawn whether it will be used or not, so that none shifts another."""
    # One uniform number whatever there is to choose from, so that the rest of the scene does not depend on it.
    instance = instances[int(generator.random() * len(instances))]
    x, y, yaw = _placement(generator, ranges)
    spread = float(generator.uniform(-ranges.openness_spread, ranges.openness_spread))
    return Draw(instance, x, y, yaw, spread)


def redraw_placement(generator: np.random.Generator, ranges: Randomization, draw: Draw) -> Draw:
    """The same object elsewhere: three uniform numbers."""
    x, y, yaw = _placement(generator, ranges)
    return replace(draw, x=x, y=y, yaw=yaw)


def _placement(generator: np.random.Generator, ranges: Randomization) -> tuple[float, float, float]:
    x = float(generator.uniform(*ranges.x))
    y = float(generator.uniform(*ranges.y))
    turn = float(generator.uniform(0.0, ranges.yaw))
    return x, y, turn if y > 0 else -turn


def openness_at_reset(ranges: Randomization, draw: Draw, default_openness: float) -> float:
    """Mean of the task (or of the instance) plus the drawn offset, clipped to 0..1."""
    mean = ranges.openness_mean
    return float(np.clip((default_openness if mean is None else mean) + draw.openness_offset, 0.0, 1.0))


def placed(position: Array, quaternion: Array, x: float, y: float, yaw: float) -> tuple[Array, Array]:
    """Shift a placement by (x, y) and turn it by ``yaw`` about the vertical through its own position."""
    turned = Rotation.from_euler("z", yaw) * Rotation.from_quat(quaternion, scalar_first=True)
    return np.asarray(position, dtype=np.float64) + np.array([x, y, 0.0]), turned.as_quat(scalar_first=True)
