"""What differs between episodes of one task: drawn once, from (seed, task), as plain values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.errors import InputError
from gensim2.seeding import rng
from gensim2.tasks.spec import Randomization, TaskSpec

Array = npt.NDArray[np.float64]

RESET_OPTIONS = frozenset({"instance", "openness", "offset", "pose"})
"""Reset options of ours; ManiSkill knows ``reconfigure``, ``env_idx`` and ``reset_to_env_states`` besides."""
FARTHEST = 10.0
"""Metres from the world's origin at which an object may be put: far beyond the table, and no overflow."""

_MANISKILL_OPTIONS = frozenset({"reconfigure", "env_idx", "reset_to_env_states"})


@dataclass(frozen=True)
class Draw:
    """One episode's initial scene, apart from what the instance itself says.

    Attributes:
        instance: id of the instance.
        x, y, yaw: offset of the object from its default placement, m and rad, about the world's z axis.
        openness_offset: added to the mean openness.
    """

    instance: str
    x: float
    y: float
    yaw: float
    openness_offset: float


def draw_scene(task: TaskSpec, seed: int, instances: Sequence[str]) -> Draw:
    """Draw the initial scene of one episode; every value is drawn whether it will be used or not."""
    generator = rng(seed, task.name)
    ranges: Randomization = task.randomization
    # One uniform number whatever there is to choose from, so that the rest of the scene does not depend on it.
    instance = instances[int(generator.random() * len(instances))]
    x = float(generator.uniform(-ranges.x, ranges.x))
    y = float(generator.uniform(-ranges.y, ranges.y))
    turn = float(generator.uniform(0.0, ranges.yaw))
    spread = float(generator.uniform(-ranges.openness_spread, ranges.openness_spread))
    return Draw(instance, x, y, turn if y > 0 else -turn, spread)


def openness_at_reset(task: TaskSpec, draw: Draw, default_openness: float) -> float:
    """Mean of the task (or of the instance) plus the drawn offset, clipped to 0..1."""
    mean = task.randomization.openness_mean
    return float(np.clip((default_openness if mean is None else mean) + draw.openness_offset, 0.0, 1.0))


def placed(position: Array, quaternion: Array, x: float, y: float, yaw: float) -> tuple[Array, Array]:
    """Shift a placement by (x, y) and turn it by ``yaw`` about the vertical through its own position."""
    half = 0.5 * yaw
    w, i, j, k = quaternion
    c, s = np.cos(half), np.sin(half)
    turned = np.array([c * w - s * k, c * i - s * j, c * j + s * i, c * k + s * w])
    return np.asarray(position, dtype=np.float64) + np.array([x, y, 0.0]), turned


def check_options(options: Mapping[str, Any] | None) -> None:
    """Refuse reset options that nobody knows, or of the wrong form.

    Raises:
        InputError: names the option.
    """
    if options is not None and not isinstance(options, Mapping):
        raise InputError(f"must be a mapping, is {options!r}", field="options")
    given = dict(options or {})
    for name in given:
        if name not in RESET_OPTIONS | _MANISKILL_OPTIONS:
            raise InputError(
                "unknown reset option", field=str(name), remedy=f"known: {', '.join(sorted(RESET_OPTIONS))}"
            )
    if "offset" in given and "pose" in given:
        raise InputError("give either offset or pose", field="offset")
    if given.get("instance") is not None and not isinstance(given["instance"], str):
        raise InputError("must be the id of an instance, as a string", field="instance")
    if given.get("env_idx") is not None and np.any(np.asarray(given["env_idx"]) != 0):
        raise InputError("there is one environment, 0", field="env_idx")
    state = given.get("reset_to_env_states")
    if state is not None and not (isinstance(state, Mapping) and "env_states" in state):
        raise InputError("must be a mapping with env_states", field="reset_to_env_states")
    for name, size, what in (
        ("offset", 3, "x, y, yaw"),
        ("pose", 7, "x, y, z, qw, qx, qy, qz"),
        ("openness", 0, ""),
    ):
        if given.get(name) is None:
            continue
        try:
            value = np.asarray(given[name], dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError("must be numbers", field=name) from error
        if value.shape != ((size,) if size else ()) or not np.isfinite(value).all():
            raise InputError(
                f"must be {size} finite numbers ({what})" if size else "must be a finite number", field=name
            )
        if name != "openness" and np.abs(value[:2] if name == "offset" else value[:3]).max() > FARTHEST:
            raise InputError(f"must lie within {FARTHEST:g} m", field=name)
        if name == "openness" and not 0.0 <= float(value) <= 1.0:
            raise InputError("must lie in 0..1", field=name)
        if name == "pose" and abs(np.linalg.norm(value[3:]) - 1.0) > 1e-3:
            raise InputError("the quaternion (w, x, y, z) must have length 1", field=name)
