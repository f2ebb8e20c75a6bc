"""Define presets of scene randomization: the task's own ranges, half of them, or wider ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from gensim2.core.errors import InputError

PresetName = Literal["paper", "paper-half", "wide"]
"""``"paper"``: the ranges of the task; ``"paper-half"``: half of them; ``"wide"``: see docs/reference/simulation.md."""

PRESET_NAMES: tuple[PresetName, ...] = get_args(PresetName)
DEFAULT_PRESET: PresetName = "paper"


@dataclass(frozen=True)
class Preset:
    """Preset of ``--randomization``. A preset scales the ranges of the task, and can switch on more randomization.

    Attributes:
        name: value of ``--randomization``.
        scale: factor by which the ranges of offsets, yaw and openness are multiplied.
        turns_either_way: whether the sign of an object's yaw is random. If False, the sign depends on the sign of the
            object's y offset.
        varies: whether the physics of the objects and the robot's initial joint positions are also randomized.
    """

    name: PresetName
    scale: float
    turns_either_way: bool = False
    varies: bool = False


_PRESETS: dict[str, Preset] = {
    "paper": Preset("paper", 1.0),
    "paper-half": Preset("paper-half", 0.5),
    "wide": Preset("wide", 1.5, turns_either_way=True, varies=True),
}


def preset(name: object) -> Preset:
    """Return the preset with the given name.

    Raises:
        InputError: no preset has this name.
    """
    if not isinstance(name, str) or name not in _PRESETS:
        wrong = f"unknown randomization {name!r:.80}"
        raise InputError(wrong, field="randomization", remedy=f"one of {', '.join(PRESET_NAMES)}")
    return _PRESETS[name]
