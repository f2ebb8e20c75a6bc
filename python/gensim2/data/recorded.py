"""Check that a recording belongs to an episode and that its arrays are valid."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.core.foreign.hdf5 import fits, shown_shape
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import Recording

MAX_STEPS = 100_000
"""Largest number of control steps of an episode, 83 minutes at 20 Hz. Tasks allow a few hundred."""

ROOT = 13
"""Number of values of a root's pose (7) and velocities (6) in ManiSkill's states."""


def check_recording(recording: Recording, episode: Episode, file: Path | str, at: str = "") -> None:
    """Check that the steps, seed, objects, types and shapes of a recording fit its episode.

    The values of a successful episode must be finite.

    Args:
        file: file of the recording, for error messages.
        at: position of the recording in the file, for error messages.

    Raises:
        InputError: the recording does not match, or has a number that is not finite; the message names the field.
    """
    steps = len(recording.actions) if recording.actions.ndim else 0

    def refuse(field: str, wrong: str) -> InputError:
        return InputError(wrong, file=file, field=f"{at}.{field}" if at else field, remedy="export or collect it again")

    if not 1 <= steps <= MAX_STEPS:
        raise refuse("actions", f"the recording has {steps} steps, but must have 1 to {MAX_STEPS}")
    if steps != episode.control_steps:
        raise refuse("actions", f"has {steps} steps, but the episode's record says {episode.control_steps}")
    if recording.seed != episode.seed:
        raise refuse("seed", f"is {recording.seed}, but the episode's record says {episode.seed}")
    ids = {name: thing.id for name, thing in episode.objects.items()}
    if recording.instances != ids:
        raise refuse("instances", "the object ids do not match the episode's record")
    for name, values, dtype, shape in _arrays(recording, steps):
        if values.dtype != dtype or not fits(values.shape, shape):
            needed = f"must have the type {dtype} and the shape {shown_shape(shape)}"
            raise refuse(name, f"{needed}, but has the type {values.dtype} and the shape {values.shape}")
        if not values.size:
            raise refuse(name, "is empty")
        if name.startswith("env_states") and values.shape[1] < ROOT:
            wrong = f"has {values.shape[1]} numbers for each step; a pose and its velocities need {ROOT}"
            raise refuse(name, wrong)
        if episode.held and values.dtype.kind == "f" and not np.isfinite(values).all():
            step = int(np.argmin(np.isfinite(values.reshape(len(values), -1)).all(axis=1)))
            raise refuse(name, f"contains a number that is not finite at step {step}")


def _arrays(
    recording: Recording, steps: int
) -> Iterator[tuple[str, npt.NDArray[Any], np.dtype[Any], tuple[int | None, ...]]]:
    """Yield name, array, required type and required shape of every array in a recording."""
    numbers, truth = np.dtype(np.float32), np.dtype(np.bool_)
    yield "actions", recording.actions, numbers, (steps, None)
    yield "obs", recording.obs, numbers, (steps + 1, None)
    yield "rewards", recording.rewards, numbers, (steps,)
    for name in ("terminated", "truncated", "success"):
        yield name, getattr(recording, name), truth, (steps,)
    for kind, things in recording.env_states.items():
        if not isinstance(things, dict):
            yield f"env_states.{kind}", np.asarray(things), numbers, (steps + 1, None)
            continue
        for name, values in things.items():
            yield f"env_states.{kind}.{name}", values, numbers, (steps + 1, None)
