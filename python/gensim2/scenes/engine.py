"""Physics engines by name, and what each of them can do."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Literal, get_args

from gensim2.errors import InputError
from gensim2.scenes.physics import DEFAULT_PHYSICS, PRESETS, PhysicsSwitches, physics_switches

Engine = Literal["sapien", "mujoco"]
"""``"sapien"``: PhysX, with ManiSkill's environments, renderer and tools. ``"mujoco"``: MuJoCo, headless."""

ENGINES: tuple[Engine, ...] = get_args(Engine)
DEFAULT_ENGINE: Engine = "sapien"

_ONLY_SAPIEN = ("joint_friction", "densities", "materials", "solver", "gripper")
"""Switches whose other values are numbers of PhysX."""


def check_engine(engine: object, physics: str = DEFAULT_PHYSICS) -> Engine:
    """Return the engine of a name.

    Args:
        engine: the name.
        physics: the word for the switches that it is to simulate.

    Raises:
        InputError: there is no such engine, or a switch has a value that the engine cannot simulate.
    """
    found = next((name for name in ENGINES if name == engine), None)
    if found is None:
        raise InputError(f"no engine {engine!r}", field="engine", remedy=f"one of {', '.join(ENGINES)}")
    if found != "sapien":
        _check_switches(found, physics_switches(physics))
    return found


def _check_switches(engine: Engine, switches: PhysicsSwitches) -> None:
    default = PRESETS[DEFAULT_PHYSICS]
    for each in fields(switches):
        value: Any = getattr(switches, each.name)
        if each.name in _ONLY_SAPIEN and value != getattr(default, each.name):
            raise InputError(
                f"{engine} has no {each.name}={value}, which is made of numbers of PhysX",
                field="physics",
                remedy=f"leave {each.name} at {getattr(default, each.name)}, or use the engine sapien",
            )
