"""Define names for physics settings, and select the engines that can simulate them.

A name is a preset, ``default`` or ``original`` (the original GenSim2), with changes such as
``original+gripper=default``. A name defines the physics completely, so records and workers keep only the name. A file
of settings is converted to a name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, get_type_hints

from gensim2.core.errors import InputError, MissingExtraError, near
from gensim2.core.renamed import current
from gensim2.core.yaml_files import read_yaml

if TYPE_CHECKING:
    from gensim2.robots import RobotProfile

PhysicsSource = Literal["default", "original"]
Gripper = Literal["default", "soft", "original"]
Redraw = Literal["placement", "none"]
Engine = Literal["sapien", "mujoco"]
"""Physics engines: ``"sapien"`` is PhysX with ManiSkill's environments and renderer; ``"mujoco"`` is MuJoCo."""

Engines = Literal["one", "both"]
"""Whether a verification is simulated in one engine or in both."""

ENGINES: tuple[Engine, ...] = get_args(Engine)
DEFAULT_ENGINE: Engine = "sapien"
"""Engine of records that do not name an engine."""

_EXTRAS: Mapping[Engine, str] = {"sapien": "sim", "mujoco": "mujoco"}


@dataclass(frozen=True)
class PhysicsSwitches:
    """Settings of a scene's physics. Each setting has the value of gensim2 (default) or of the original GenSim2.

    Most settings have the value ``"default"`` or ``"original"``. The values mean:

    Attributes:
        joint_friction: resistance of joints. Default: Coulomb friction and damping. Original: coefficient of the class
            times the load.
        densities: source of masses. Default: mass stored with the object. Original: volume of the hulls times the
            density of the class.
        materials: friction and restitution. Default: separate values for pads, rigid objects and other bodies.
            Original: one value for all.
        solver: solver settings. Default: solver settings and contact offsets of the engine. Original: PhysX settings of
            GenSim2.
        poses: poses before randomization. Default: computed from the geometry. Original: published by GenSim2.
        gripper: drives of the fingers. Default: drives of the robot. Original: drives of GenSim2. ``"soft"``: drives
            that hold objects with GenSim2's solver.
        hulls: collision hulls of real objects. Default: hulls that keep cavities open. Original: one hull for each
            connected part.
        redraw: reaction to objects that do not fit. ``"placement"``: sample again until all fit; ``"none"``: use the
            first sample.
        criteria_rate: interval between evaluations of the steps' criteria for ``paper``. Default: every control step.
            Original: 0.85 s.
    """

    joint_friction: PhysicsSource = "default"
    densities: PhysicsSource = "default"
    materials: PhysicsSource = "default"
    solver: PhysicsSource = "default"
    poses: PhysicsSource = "default"
    gripper: Gripper = "default"
    redraw: Redraw = "placement"
    criteria_rate: PhysicsSource = "default"
    hulls: PhysicsSource = "default"

    def criteria_steps(self, robot: RobotProfile) -> int:
        """Return the number of control steps between evaluations of the steps' criteria for the ``paper`` verdict."""
        return 1 if self.criteria_rate == "default" else robot.steps(ORIGINAL_CRITERIA_SECONDS)


ORIGINAL_CRITERIA_SECONDS = 0.85
"""Time (s) between evaluations of criteria in the original GenSim2, whose control steps take 0.81 to 0.9 s."""

DEFAULT_PHYSICS = "default"
PRESETS: Mapping[str, PhysicsSwitches] = {
    DEFAULT_PHYSICS: PhysicsSwitches(),
    "original": PhysicsSwitches("original", "original", "original", "original", "original", "soft", "none"),
}
"""Presets; ``original`` has the original GenSim2's settings except for fingers (docs/reference/simulation.md)."""

PHYSICS_NAMES: tuple[str, ...] = tuple(PRESETS)
SWITCHES: Mapping[str, tuple[str, ...]] = {
    name: get_args(choices) for name, choices in get_type_hints(PhysicsSwitches).items()
}
"""Allowed values of each setting."""

_RENAMED = {"ours": DEFAULT_PHYSICS}
"""Current names, by the names in the previous release."""
_ONLY_SAPIEN = ("joint_friction", "densities", "materials", "solver", "gripper")
"""Settings that only PhysX can simulate if their value is not the default."""
_FILES = (".yaml", ".yml", ".json")


@cache
def physics_switches(word: str) -> PhysicsSwitches:
    """Return the physics settings that a name stands for.

    Args:
        word: preset, followed by ``+setting=value`` for each change, such as ``original+gripper=default``.

    Raises:
        InputError: a preset, setting or value is unknown.
    """
    name, *changes = word.split("+")
    name = current(name, _RENAMED, "physics")
    if name not in PRESETS:
        raise InputError(f"no physics {word!r}", field="physics", remedy=near(name, PHYSICS_NAMES))
    given = dict(change.partition("=")[::2] for change in changes)
    return _changed(PRESETS[name], given, None)


def physics_name(word: object, redraw: str | None = None) -> str:
    """Return the normalized name of the physics settings that a user gave on the command line or in Python.

    Args:
        word: name as for :func:`physics_word`, or a YAML or JSON file. In a file, ``base`` is the preset for the
            missing settings.
        redraw: value of the setting ``redraw``. With None the value in ``word`` is kept.

    Raises:
        InputError: a preset, setting or value is unknown, or the file cannot be read.
    """
    if isinstance(word, str | Path) and str(word).endswith(_FILES):
        word = _word(_read(Path(word)))
    word = physics_word(word)
    return word if redraw is None else physics_word(f"{word}+redraw={redraw}")


def physics_word(word: object) -> str:
    """Check and normalize the name of physics settings, as stored in files.

    In older files the default is named ``"ours"``; this name becomes ``"default"``.


    Args:
        word: as for :func:`physics_switches`.

    Raises:
        InputError: a preset, setting or value is unknown.
    """
    if not isinstance(word, str):
        raise InputError(f"no physics {word!r}", field="physics", remedy=f"one of {', '.join(PHYSICS_NAMES)}")
    return _word(physics_switches(word))


def _read(path: Path) -> PhysicsSwitches:
    given = dict(read_yaml(path))
    base = given.pop("base", DEFAULT_PHYSICS)
    if not isinstance(base, str) or base not in PRESETS:
        raise InputError(f"no physics {base!r}", file=path, field="base", remedy=f"one of {', '.join(PHYSICS_NAMES)}")
    return _changed(PRESETS[base], given, path)


def _changed(base: PhysicsSwitches, given: Mapping[str, Any], file: Path | None) -> PhysicsSwitches:
    for name, value in given.items():
        if name not in SWITCHES:
            where = name if file else "physics"
            raise InputError(f"no switch {name!r}", file=file, field=where, remedy=near(name, SWITCHES))
        if value not in SWITCHES[name]:
            remedy = f"one of {', '.join(SWITCHES[name])}"
            raise InputError(f"no {name} {value!r}", file=file, field=name if file else "physics", remedy=remedy)
    return replace(base, **given)


def _word(switches: PhysicsSwitches) -> str:
    """Return the shortest name of physics settings; prefer a name that starts with ``default``."""
    words = []
    for name, preset in PRESETS.items():
        own = [each.name for each in fields(preset) if getattr(switches, each.name) != getattr(preset, each.name)]
        words.append((len(own), "+".join([name, *(f"{each}={getattr(switches, each)}" for each in own)])))
    return min(words, key=lambda found: found[0])[1]


def default_engine() -> Engine:
    """Return ``"sapien"`` if SAPIEN is installed, else ``"mujoco"``."""
    return "mujoco" if find_spec("sapien") is None else "sapien"


def require_engine(engine: Engine) -> None:
    """Check that an engine is installed.

    Raises:
        MissingExtraError: the engine is not installed.
    """
    if find_spec(engine) is None:
        raise MissingExtraError(engine, _EXTRAS[engine])


def check_engine(engine: object, physics: str = DEFAULT_PHYSICS) -> Engine:
    """Check that an engine exists and can simulate the given physics settings; return the engine's name.

    Raises:
        InputError: the engine is unknown, or cannot simulate one of the settings.
    """
    found = next((name for name in ENGINES if name == engine), None)
    if found is None:
        raise InputError(f"no engine {engine!r}", field="engine", remedy=f"one of {', '.join(ENGINES)}")
    if found != "sapien":
        switches, usual = physics_switches(physics), PRESETS[DEFAULT_PHYSICS]
        for name in _ONLY_SAPIEN:
            value, default = getattr(switches, name), getattr(usual, name)
            if value != default:
                wrong = f"only the engine sapien supports {name}={value}, but the engine is {found}"
                raise InputError(wrong, field="physics", remedy=f"leave {name} at {default}, or use sapien")
    return found


def with_current_scene(record: Any) -> Any:
    """Convert the scene description of an older version: use the current names of settings, and add the engine."""
    if isinstance(record, dict) and isinstance(word := record.get("physics"), str):
        return {"engine": DEFAULT_ENGINE, **record, "physics": current(word, _RENAMED, "physics")}
    return record
