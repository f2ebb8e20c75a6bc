"""Physics as named switches, each the project's own or the original GenSim2's, and the engines that simulate it.

A mixture is a word: ``original`` and ``default`` are presets, ``original+gripper=default`` is the first but for one
switch. It says all that it is, so it travels to other processes and stands in records. Users may give a file of
switches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, get_type_hints

from gensim2.core.errors import InputError, near
from gensim2.core.renamed import current
from gensim2.core.yaml_files import read_yaml

if TYPE_CHECKING:
    from gensim2.robots import RobotProfile

PhysicsSource = Literal["default", "original"]
Gripper = Literal["default", "soft", "original"]
Redraw = Literal["placement", "none"]
Engine = Literal["sapien", "mujoco"]
"""``"sapien"``: PhysX, with ManiSkill's environments and renderer. ``"mujoco"``: MuJoCo, headless."""

ENGINES: tuple[Engine, ...] = get_args(Engine)
DEFAULT_ENGINE: Engine = "sapien"


@dataclass(frozen=True)
class PhysicsSwitches:
    """Switches of the physics of a scene; ``"default"`` is the project's own, ``"original"`` the original's.

    Attributes:
        joint_friction: Coulomb friction and damping of the object, or a coefficient on the joint's load by class.
        densities: masses of the objects, or hulls times a density by class.
        materials: contact materials of objects, fingers and all else but the table.
        solver: settings and contact offsets of the engine, or those that PhysX has in the original.
        poses: default poses computed from the geometry, or the original's of the released models.
        gripper: drives of the fingers: the profile's, ``"soft"`` ones, with which the original's solver holds things,
            or the original's.
        hulls: collision parts of real objects that leave their cavities open, or each connected piece of a file as its
            convex hull; the planner knows the same parts.
        redraw: ``"placement"``: placements of several objects are drawn again until there is room for all;
            ``"none"``: the first draw counts.
        criteria_rate: criteria of the verdict ``paper`` are read every control step, or every 0.85 s.
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
        """Control steps between two evaluations of the criteria of ``paper``."""
        return 1 if self.criteria_rate == "default" else robot.steps(ORIGINAL_CRITERIA_SECONDS)


ORIGINAL_CRITERIA_SECONDS = 0.85
"""Of physics between two looks at the criteria in the original, whose control steps take 0.81 to 0.9."""

DEFAULT_PHYSICS = "default"
PRESETS: Mapping[str, PhysicsSwitches] = {
    DEFAULT_PHYSICS: PhysicsSwitches(),
    "original": PhysicsSwitches("original", "original", "original", "original", "original", "soft", "none"),
}
"""Mixtures with a name. ``original`` is what is compared with the paper: all of the original's but what
docs/reference/simulation.md says of its fingers."""

PHYSICS_NAMES: tuple[str, ...] = tuple(PRESETS)
SWITCHES: Mapping[str, tuple[str, ...]] = {
    name: get_args(choices) for name, choices in get_type_hints(PhysicsSwitches).items()
}
"""Values of each switch."""

_RENAMED = {"ours": DEFAULT_PHYSICS}
"""Today's words by those of the release before."""
_ONLY_SAPIEN = ("joint_friction", "densities", "materials", "solver", "gripper")
"""Switches whose other values are numbers of PhysX."""
_FILES = (".yaml", ".yml", ".json")


@cache
def physics_switches(word: str) -> PhysicsSwitches:
    """Return what a word stands for.

    Args:
        word: name of a preset, and after each ``+`` a switch and its value.

    Raises:
        InputError: there is no such preset, switch or value.
    """
    name, *changes = word.split("+")
    name = current(name, _RENAMED, "physics")
    if name not in PRESETS:
        raise InputError(f"no physics {word!r}", field="physics", remedy=near(name, PHYSICS_NAMES))
    given = dict(change.partition("=")[::2] for change in changes)
    return _changed(PRESETS[name], given, None)


def physics_name(word: object, redraw: str | None = None) -> str:
    """Return the one word for what a user gave on the command line or in Python.

    Args:
        word: as :func:`physics_word` takes it, or the path of a YAML or JSON file of switches, in which ``base`` names
            the preset that holds for the others.
        redraw: value of that switch, whatever ``word`` says of it; None: as ``word`` says.

    Raises:
        InputError: there is no such preset, switch or value, or the file cannot be read.
    """
    if isinstance(word, str | Path) and str(word).endswith(_FILES):
        word = _word(_read(Path(word)))
    word = physics_word(word)
    return word if redraw is None else physics_word(f"{word}+redraw={redraw}")


def physics_word(word: object) -> str:
    """Return the one word for a mixture that a file names; ``"ours"``, as earlier files have it, is ``"default"``.

    Args:
        word: as :func:`physics_switches` takes it.

    Raises:
        InputError: there is no such preset, switch or value.
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
    """The shortest, the default's where two are as short."""
    words = []
    for name, preset in PRESETS.items():
        own = [each.name for each in fields(preset) if getattr(switches, each.name) != getattr(preset, each.name)]
        words.append((len(own), "+".join([name, *(f"{each}={getattr(switches, each)}" for each in own)])))
    return min(words, key=lambda found: found[0])[1]


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
    """Return the fields of a file with today's name of the physics, and with the engine of releases that had one."""
    if isinstance(record, dict) and isinstance(word := record.get("physics"), str):
        return {"engine": DEFAULT_ENGINE, **record, "physics": current(word, _RENAMED, "physics")}
    return record
