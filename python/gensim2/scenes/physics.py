"""Physics as named settings, each either the project's own or the original GenSim2's, and the engines that simulate it.

A mixture has a name: ``original`` and ``default`` are presets, and ``original+gripper=default`` changes one setting of
a preset. The name defines the physics completely, so it is used in records and worker processes. Users may give a file
of settings.
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
"""Engines: ``"sapien"`` is PhysX with ManiSkill's environments and renderer, ``"mujoco"`` is MuJoCo without rendering.
"""

Engines = Literal["one", "both"]
"""Whether a verification is simulated in one engine or in both."""

ENGINES: tuple[Engine, ...] = get_args(Engine)
DEFAULT_ENGINE: Engine = "sapien"
"""Engine of records that name none."""

_EXTRAS: Mapping[Engine, str] = {"sapien": "sim", "mujoco": "mujoco"}


@dataclass(frozen=True)
class PhysicsSwitches:
    """Settings of a scene's physics; ``"default"`` is the project's own, ``"original"`` the original GenSim2's.

    Attributes:
        joint_friction: Coulomb friction and damping of the object, or a coefficient on the joint's load by class.
        densities: masses of the objects, or a density for hulls by class.
        materials: contact materials of objects, fingers and everything except the table.
        solver: settings and contact offsets of the engine, or the original's PhysX settings.
        poses: default poses computed from the geometry, or the original's for released models.
        gripper: drives of the fingers: the profile's; ``"soft"`` ones, with which the original's solver holds objects;
            or the original's.
        hulls: collision hulls of real objects that keep cavities open, or the convex hull of each connected part of a
            file; the planner uses the same hulls.
        redraw: ``"placement"``: placements of several objects are sampled again until all fit; ``"none"``: the first
            sample is used.
        criteria_rate: evaluate the steps' criteria for ``paper`` every control step, or every 0.85 s.
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
        """Return the number of control steps between evaluations of the steps' criteria for ``paper``."""
        return 1 if self.criteria_rate == "default" else robot.steps(ORIGINAL_CRITERIA_SECONDS)


ORIGINAL_CRITERIA_SECONDS = 0.85
"""Time (s) between evaluations of criteria in the original, whose control steps take 0.81 to 0.9 s."""

DEFAULT_PHYSICS = "default"
PRESETS: Mapping[str, PhysicsSwitches] = {
    DEFAULT_PHYSICS: PhysicsSwitches(),
    "original": PhysicsSwitches("original", "original", "original", "original", "original", "soft", "none"),
}
"""Presets. ``original`` is the one for comparisons with the paper: all settings are the original's except for the
fingers (docs/reference/simulation.md).
"""

PHYSICS_NAMES: tuple[str, ...] = tuple(PRESETS)
SWITCHES: Mapping[str, tuple[str, ...]] = {
    name: get_args(choices) for name, choices in get_type_hints(PhysicsSwitches).items()
}
"""Allowed values of each setting."""

_RENAMED = {"ours": DEFAULT_PHYSICS}
"""Present names by those of the previous release."""
_ONLY_SAPIEN = ("joint_friction", "densities", "materials", "solver", "gripper")
"""Settings whose non-default values only PhysX can simulate."""
_FILES = (".yaml", ".yml", ".json")


@cache
def physics_switches(word: str) -> PhysicsSwitches:
    """Return the settings of a physics name.

    Args:
        word: name of a preset, followed by ``+setting=value`` for each change.

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
        word: as for :func:`physics_word`, or the path of a YAML or JSON file of settings, in which ``base`` names the
            preset for all others.
        redraw: value of this setting; None: as in ``word``.

    Raises:
        InputError: a preset, setting or value is unknown, or the file cannot be read.
    """
    if isinstance(word, str | Path) and str(word).endswith(_FILES):
        word = _word(_read(Path(word)))
    word = physics_word(word)
    return word if redraw is None else physics_word(f"{word}+redraw={redraw}")


def physics_word(word: object) -> str:
    """Check and normalize the name of a combination of physics settings, as stored in files.

    ``"ours"``, the name of the default in older files, becomes ``"default"``.


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
    """Return the shortest name of settings, preferring the default preset."""
    words = []
    for name, preset in PRESETS.items():
        own = [each.name for each in fields(preset) if getattr(switches, each.name) != getattr(preset, each.name)]
        words.append((len(own), "+".join([name, *(f"{each}={getattr(switches, each)}" for each in own)])))
    return min(words, key=lambda found: found[0])[1]


def default_engine() -> Engine:
    """Return ``"sapien"`` where SAPIEN is installed, else ``"mujoco"``."""
    return "mujoco" if find_spec("sapien") is None else "sapien"


def require_engine(engine: Engine) -> None:
    """Refuse an engine that is not installed.

    Raises:
        MissingExtraError: the engine is not installed.
    """
    if find_spec(engine) is None:
        raise MissingExtraError(engine, _EXTRAS[engine])


def check_engine(engine: object, physics: str = DEFAULT_PHYSICS) -> Engine:
    """Return the engine with a name.

    Args:
        engine: the name.
        physics: name of the physics that it must simulate.

    Raises:
        InputError: the engine is unknown, or cannot simulate a setting.
    """
    found = next((name for name in ENGINES if name == engine), None)
    if found is None:
        raise InputError(f"no engine {engine!r}", field="engine", remedy=f"one of {', '.join(ENGINES)}")
    if found != "sapien":
        switches, usual = physics_switches(physics), PRESETS[DEFAULT_PHYSICS]
        for name in _ONLY_SAPIEN:
            value, default = getattr(switches, name), getattr(usual, name)
            if value != default:
                raise InputError(
                    f"{found} has no {name}={value}, whose numbers are PhysX's",
                    field="physics",
                    remedy=f"leave {name} at {default}, or use the engine sapien",
                )
    return found


def with_current_scene(record: Any) -> Any:
    """Return a file's fields with the present physics name and, for old files, the engine."""
    if isinstance(record, dict) and isinstance(word := record.get("physics"), str):
        return {"engine": DEFAULT_ENGINE, **record, "physics": current(word, _RENAMED, "physics")}
    return record
