"""Read reset options, which replace random values of a scene."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gensim2.core.errors import InputError, near

RESET_OPTIONS = frozenset({"instance", "openness", "offset", "pose"})
"""Reset options of this project; ManiSkill also has ``reconfigure``, ``env_idx`` and ``reset_to_env_states``."""
FARTHEST = 10.0
"""Maximum distance (m) of an object from the world's origin, to avoid numerical overflow."""

_MANISKILL_OPTIONS = frozenset({"reconfigure", "env_idx", "reset_to_env_states"})
_NUMBERS = {"offset": (3, "x, y, yaw"), "pose": (7, "x, y, z, qw, qx, qy, qz"), "openness": (0, "")}

ObjectOptions = Mapping[str, Any]
"""Options of one object by name."""


def read_options(options: Mapping[str, Any] | None, names: Sequence[str]) -> Mapping[str, ObjectOptions]:
    """Check all reset options and return gensim2's own options by object. ManiSkill reads its own options itself.

    Args:
        options: values by option. A value of gensim2's options is a mapping from object names, or a plain value if the
            task has one object.

    Raises:
        InputError: an option or object is unknown, or a value is invalid; the message names it.
    """
    if options is not None and not isinstance(options, Mapping):
        raise InputError(f"must be a mapping, but is {options!r}", field="options")
    found: dict[str, dict[str, Any]] = {name: {} for name in names}
    for option, value in (options or {}).items():
        if option in _MANISKILL_OPTIONS:
            _check_maniskill(option, value)
            continue
        if option not in RESET_OPTIONS:
            remedy = near(option, sorted(RESET_OPTIONS))
            raise InputError("unknown reset option", field=str(option), remedy=remedy)
        if value is None:
            continue
        if isinstance(value, Mapping):
            for name, own in value.items():
                if name not in found:
                    raise InputError(f"there is no object {name!r}", field=option, remedy=near(name, names))
                if own is not None:
                    _check(option, own, f"{option}.{name}")
                    found[name][option] = own
        elif len(names) == 1:
            _check(option, value, option)
            found[names[0]][option] = value
        else:
            wrong = "must be a mapping from the name of each object to its value"
            raise InputError(wrong, field=option, remedy=", ".join(names))
    for given in found.values():
        if "offset" in given and "pose" in given:
            raise InputError("must not be given together with pose", field="offset")
    return found


def _check_maniskill(option: str, value: Any) -> None:
    if option == "env_idx" and value is not None and np.any(np.asarray(value) != 0):
        raise InputError("must be 0, because a reset resets a single environment", field="env_idx")
    has_states = value is None or (isinstance(value, Mapping) and "env_states" in value)
    if option == "reset_to_env_states" and not has_states:
        raise InputError("must be a mapping with the key env_states", field="reset_to_env_states")


def _check(option: str, given: Any, field: str) -> None:
    if option == "instance":
        if not isinstance(given, str):
            raise InputError("must be the id of an instance, as a string", field=field)
        return
    size, what = _NUMBERS[option]
    try:
        value = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError("must be numbers", field=field) from error
    if value.shape != ((size,) if size else ()) or not np.isfinite(value).all():
        raise InputError(f"must be {size} finite numbers ({what})" if size else "must be a finite number", field=field)
    if option == "openness":
        if not 0.0 <= float(value) <= 1.0:
            raise InputError("must lie in 0..1", field=field)
        return
    if np.abs(value[:2] if option == "offset" else value[:3]).max() > FARTHEST:
        raise InputError(f"the coordinates must lie between -{FARTHEST:g} m and {FARTHEST:g} m", field=field)
    if option == "pose" and abs(math.hypot(*value[3:]) - 1.0) > 1e-3:
        raise InputError("the quaternion (w, x, y, z) must have length 1", field=field)
