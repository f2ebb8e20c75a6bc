"""Sample the random values of a task's episodes; seed, task and preset determine them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.robots import RobotProfile
from gensim2.tasks.presets import Preset
from gensim2.tasks.spec import Randomization

LIGHTEST, HEAVIEST = 0.5, 2.0
"""Minimum and maximum factor on masses in the ``wide`` preset."""
SLIPPERIEST, ROUGHEST = 0.5, 2.0
"""Minimum and maximum factor on contact friction in the ``wide`` preset."""
LOOSEST, STIFFEST = 0.8, 2.0
"""Extreme factors on joint friction in the preset ``wide``. Lids would fall by themselves with factors below 0.77."""
START_SPREAD = 0.1
"""Maximum offset (rad) of each arm joint from its start in the ``wide`` preset."""


@dataclass(frozen=True)
class Draw:
    """Random values of one object in a scene.

    Attributes:
        instance: id of the instance.
        x, y: horizontal offset from the default pose, m.
        yaw: rotation about the world's z axis, relative to the default pose, rad.
        openness_offset: offset from the mean openness.
    """

    instance: str
    x: float
    y: float
    yaw: float
    openness_offset: float


@dataclass(frozen=True)
class Factors:
    """Factors on an object's physical properties.

    Attributes:
        mass: factor on masses and inertias of all links.
        contact_friction: factor on static and dynamic friction of all surfaces.
        joint_friction: factor on friction and damping, in addition to ``mass``; 1 for rigid objects.
    """

    mass: float = 1.0
    contact_friction: float = 1.0
    joint_friction: float = 1.0


AS_IT_IS = Factors()


def draw_object(
    generator: np.random.Generator, ranges: Randomization, preset: Preset, instances: Sequence[str]
) -> Draw:
    """Sample the values of an object. The number of random values is always five, whatever the ranges are."""
    # One random number selects the instance, so that later samples do not depend on the number of instances.
    instance = instances[int(generator.random() * len(instances))]
    x, y, yaw = _placement(generator, ranges, preset)
    spread = preset.scale * ranges.openness_spread
    return Draw(instance, x, y, yaw, float(generator.uniform(-spread, spread)))


def openness_range(ranges: Randomization, preset: Preset, default_openness: float) -> tuple[float, float]:
    """Return the smallest and the largest openness that an object can have at the reset."""
    mean = default_openness if ranges.openness_mean is None else ranges.openness_mean
    spread = preset.scale * ranges.openness_spread
    return max(mean - spread, 0.0), min(mean + spread, 1.0)


def redraw_placement(generator: np.random.Generator, ranges: Randomization, preset: Preset, draw: Draw) -> Draw:
    """Sample a new placement of the same object from three uniform random numbers."""
    x, y, yaw = _placement(generator, ranges, preset)
    return replace(draw, x=x, y=y, yaw=yaw)


def _placement(generator: np.random.Generator, ranges: Randomization, preset: Preset) -> tuple[float, float, float]:
    x, y = (float(generator.uniform(preset.scale * low, preset.scale * high)) for low, high in (ranges.x, ranges.y))
    most = preset.scale * abs(ranges.yaw)
    if preset.turns_either_way:
        return x, y, float(generator.uniform(-most, most))
    turn = float(generator.uniform(0.0, most))
    return x, y, turn if (y > 0) == (ranges.yaw >= 0) else -turn


def draw_factors(generator: np.random.Generator, has_joint: bool) -> Factors:
    """Sample factors from log-uniform distributions.

    The number of random values is always three, also without a joint.
    """
    mass, contact, joint = (
        float(np.exp(generator.uniform(np.log(low), np.log(high))))
        for low, high in ((LIGHTEST, HEAVIEST), (SLIPPERIEST, ROUGHEST), (LOOSEST, STIFFEST))
    )
    return Factors(mass, contact, joint if has_joint else 1.0)


def draw_start(generator: np.random.Generator, robot: RobotProfile) -> tuple[float, ...]:
    """Sample a start configuration (n,): add uniform offsets to the arm joints and clip them to the joint limits."""
    size = robot.arm_size
    start = np.array(robot.reset_qpos)
    start[:size] += generator.uniform(-START_SPREAD, START_SPREAD, size)
    start[:size] = np.clip(start[:size], robot.model.lower[:size], robot.model.upper[:size])
    return tuple(map(float, start))


def openness_at_reset(ranges: Randomization, draw: Draw, default_openness: float) -> float:
    """Return the openness of an object at the reset: the mean plus the sampled offset, clipped to 0..1.

    The task may give the mean openness in ``ranges``. Otherwise it is ``default_openness``, the value of the object.
    """
    mean = ranges.openness_mean
    return float(np.clip((default_openness if mean is None else mean) + draw.openness_offset, 0.0, 1.0))


def placed(position: Array, quaternion: Array, x: float, y: float, yaw: float) -> tuple[Array, Array]:
    """Shift a pose by (x, y) and rotate it by ``yaw`` about the vertical through its position."""
    turned = Rotation.from_euler("z", yaw) * Rotation.from_quat(quaternion, scalar_first=True)
    return np.asarray(position, dtype=np.float64) + np.array([x, y, 0.0]), turned.as_quat(scalar_first=True)
