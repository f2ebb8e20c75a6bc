"""Names of the physics presets, known without a simulator."""

from __future__ import annotations

from typing import Any, Literal, get_args

from gensim2.errors import InputError

PhysicsName = Literal["default", "original"]
"""Joint friction, densities, materials and default poses: the project's own, or those of the original GenSim2."""

PHYSICS_NAMES: tuple[PhysicsName, ...] = get_args(PhysicsName)
DEFAULT_PHYSICS: PhysicsName = "default"

_FORMER = {"ours": DEFAULT_PHYSICS}
"""Words of files that were written before."""


def physics_name(word: object) -> PhysicsName:
    """Return the name of a physics preset; ``"ours"``, as earlier files and commands have it, is ``"default"``.

    Raises:
        InputError: there is no such preset.
    """
    name = _FORMER.get(word, word) if isinstance(word, str) else word
    if name not in PHYSICS_NAMES:
        raise InputError(f"no physics {word!r}", field="physics", remedy=f"one of {', '.join(PHYSICS_NAMES)}")
    return name


def with_current_physics(record: Any) -> Any:
    """Return the fields of a file with today's name of the physics, whatever release wrote them."""
    if isinstance(record, dict) and isinstance(word := record.get("physics"), str):
        return {**record, "physics": _FORMER.get(word, word)}
    return record
