"""Check the arguments of ``gymnasium.make``, ``reset`` and ``step``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

from gensim2.core.errors import InputError
from gensim2.core.seeding import check_seed


def check_one_of(value: Any, known: Sequence[str], field: str) -> None:
    """Check that a value is None or one of the known words."""
    if value is not None and value not in known:
        raise InputError(f"must be one of {', '.join(known)}, but is {value!r}", field=field)


OBS_MODES = (
    "raycast",
    "state",
    "state_dict",
    "none",
    "pointcloud",
    "rgb",
    "depth",
    "segmentation",
    "rgb+depth",
    "sensor_data",
)
"""Observation modes listed in errors: ``raycast``, and ManiSkill's most common modes, which can be joined by ``+``."""


def check_obs_mode(obs_mode: str | None, error: Exception) -> None:
    """Raise an InputError if ``error`` of ManiSkill is about the unknown mode ``obs_mode``.

    Raises:
        InputError: ``error`` is about the observation mode.
    """
    if obs_mode is not None and obs_mode != "raycast" and obs_mode in str(error):
        remedy = f"one of {', '.join(OBS_MODES)}; raycast needs no renderer"
        raise InputError(f"no observation mode {obs_mode!r}", field="obs_mode", remedy=remedy) from error


def checked_seed(seed: Any) -> int | None:
    """Return a reset's seed as an integer or None; a vector environment may give a list of one."""
    if isinstance(seed, list | tuple | np.ndarray) and np.ndim(seed) == 1:
        if len(seed) != 1:
            raise InputError(f"must be a single seed for a single environment, not {len(seed)}", field="seed")
        seed = seed[0]
    return None if seed is None else check_seed(seed)


def checked_action(action: Any, size: int, control_modes: Sequence[str]) -> Any:
    """Check and return an action: None, a finite array (size,) or (1, size), or a mapping.

    The mapping is ManiSkill's form ``{"control_mode": ..., "action": ...}``. The number of values depends on the
    control mode, so the function does not check it.
    """
    if action is None:
        return None
    if isinstance(action, Mapping):
        if set(action) != {"control_mode", "action"}:
            raise InputError("a mapping must have the keys control_mode and action", field="action")
        check_one_of(action["control_mode"], control_modes, "control_mode")
        return {**action, "action": _finite(action["action"])}
    values = _finite(action)
    if values.shape not in ((size,), (1, size)):
        raise InputError(f"must be {size} numbers, but has the shape {tuple(values.shape)}", field="action")
    return values


def _finite(action: Any) -> np.ndarray[Any, np.dtype[np.float32]]:
    try:
        values = np.asarray(action.cpu() if isinstance(action, torch.Tensor) else action, dtype=np.float32)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError("must be numbers", field="action") from error
    if not np.isfinite(values).all():
        raise InputError("must be finite", field="action")
    return values
