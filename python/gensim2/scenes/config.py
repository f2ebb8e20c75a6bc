"""Configure scenes. Configuration and seed together determine an initial state.

Users give the keyword arguments of :class:`SceneArguments`. A run stores :class:`SceneOptions`, which all its tasks
share. A :class:`SceneConfig` determines the scenes of one task. Command-line options and files use the same names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, Self, TypedDict, Unpack, cast

from pydantic import BeforeValidator

from gensim2.objects import open_library
from gensim2.robots import DEFAULT_ROBOT, robot_key
from gensim2.scenes.arguments import ObjectSource, Words, check_words
from gensim2.scenes.physics import (
    DEFAULT_ENGINE,
    DEFAULT_PHYSICS,
    Engine,
    Engines,
    check_engine,
    default_engine,
    physics_name,
    physics_word,
    require_engine,
    with_current_scene,
)
from gensim2.tasks.presets import DEFAULT_PRESET, PresetName, preset
from gensim2.tasks.spec import TaskSpec

Drawn = str | tuple[str, ...] | frozenset[tuple[str, str | tuple[str, ...]]]
"""Instances that scenes choose from: a split or id, several ids, or (name, split or ids) for each object."""

SceneRecord = Annotated[dict[str, Any], BeforeValidator(with_current_scene)]
"""Fields of :class:`SceneOptions` in a file of any release, converted to the present names."""


class SceneArguments(TypedDict, total=False):
    """Keyword arguments for the scenes of a task.

    Keys:
        assets: folder of objects, or ``"builtin"`` for the built-in library. By default the environment variable
            ``GENSIM2_ASSETS`` names the folder; if the variable is not set, the built-in library is used. A simulation
            environment also accepts a library that is already open.
        instances: selection of the objects that a reset may choose. A task may allow only some of them. The value is
            ``all``, ``train``, ``test``, ``new`` (generated objects that the library does not list), an id, or
            ``random`` (one id, determined by the seed of a run). A simulation environment also accepts a list, or a
            mapping from object names to selections.
        physics: physics settings (docs/reference/simulation.md). The value is ``"default"``, ``"original"``, a preset
            with changed settings such as ``"original+gripper=default"``, or a settings file.
        redraw: ``"placement"`` or ``"none"``. The value replaces the setting ``redraw`` of ``physics``. By default the
            setting of ``physics`` applies.
        robot: name of a robot. To use your own robot, first load it with :func:`gensim2.load_robot`.
        randomization: ``"paper"`` for the task's ranges, ``"paper-half"`` or ``"wide"`` (docs/reference/simulation.md).
        engine: ``"sapien"`` or ``"mujoco"`` (docs/reference/simulation.md). The default is ``"sapien"`` if SAPIEN is
            installed, and otherwise ``"mujoco"``.
    """

    assets: str | Path | ObjectSource | None
    instances: Words | Mapping[str, Words]
    physics: str
    redraw: str | None
    robot: str
    randomization: str
    engine: str


SCENE_FIELDS: tuple[str, ...] = tuple(SceneArguments.__annotations__)


@dataclass(frozen=True)
class SceneOptions:
    """Scene options that all tasks of a run share, created from arguments (:meth:`of`) or from a file.

    Attributes:
        assets: folder of objects or ``"builtin"``.
        physics: name of the physics settings (:mod:`gensim2.scenes.physics`). Settings from a file are converted to a
            name.
        robot: name of a robot that this process has already loaded. The name never causes a robot to be loaded, because
            loading a robot runs Python code of the user, and the name may come from an untrusted file.
        engine: simulation engine.

    Raises:
        InputError: physics, robot, randomization or engine are unknown, or the engine cannot simulate the physics.
    """

    assets: str
    physics: str = DEFAULT_PHYSICS
    robot: str = DEFAULT_ROBOT
    randomization: PresetName = DEFAULT_PRESET
    engine: Engine = DEFAULT_ENGINE

    def __post_init__(self) -> None:
        object.__setattr__(self, "physics", physics_word(self.physics))
        object.__setattr__(self, "robot", robot_key(self.robot))
        preset(self.randomization)
        check_engine(self.engine, self.physics)

    @classmethod
    def of(cls, **scene: Unpack[SceneArguments]) -> SceneOptions:
        """Create options from a user's arguments. ``instances`` is ignored, because each task has its own.

        Raises:
            InputError: the folder, the robot or a preset cannot be used.
            MissingExtraError: the engine, or a package with the robot's model, is not installed.
        """
        words = {name: scene[name] for name in ("physics", "robot", "randomization", "engine") if name in scene}
        if words.get("robot", "") is None:
            del words["robot"]
        check_words(**words)
        words["physics"] = physics_name(words.get("physics", DEFAULT_PHYSICS), scene.get("redraw"))
        options = cls("", **cast(Any, {"engine": default_engine(), **words}))
        require_engine(options.engine)
        assets = scene.get("assets")
        library = open_library(assets) if assets is None or isinstance(assets, str | Path) else assets
        return replace(options, assets=str(getattr(library, "location", "")))

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> SceneOptions:
        """Read the options from the fields of a file; other fields are ignored.

        Args:
            record: fields of the file.

        Raises:
            InputError: physics, robot or randomization is unknown.
        """
        return cls(**{each.name: record[each.name] for each in fields(SceneOptions) if each.name in record})

    def to_record(self) -> dict[str, Any]:
        return {each.name: getattr(self, each.name) for each in fields(SceneOptions)}

    def second_engine(self, engines: Engines) -> Engine | None:
        """Return the engine in which episodes are repeated; None if a single engine is used.

        Raises:
            InputError: the second engine cannot simulate the physics.
            MissingExtraError: the second engine is not installed.
        """
        if engines == "one":
            return None
        second = replace(self, engine="mujoco" if self.engine == "sapien" else "sapien").engine
        require_engine(second)
        return second

    def in_engines(self, engines: Engines) -> tuple[Self, ...]:
        """Return the options for each engine: these options, and a copy with the other engine for ``"both"``.

        Raises:
            InputError, MissingExtraError: as for :meth:`second_engine`.
        """
        second = self.second_engine(engines)
        return (self,) if second is None else (self, replace(self, engine=second))

    def with_task(self, task: TaskSpec, instances: Drawn = "all") -> SceneConfig:
        """Return these options with a task, as the configuration of the task's scenes."""
        return SceneConfig(**self.to_record(), task=task, instances=instances)

    @property
    def environment(self) -> dict[str, str]:
        """Arguments of ``gym.make`` for an environment with these options.

        Arguments with default values are left out.
        """
        usual = SceneOptions(self.assets).to_record()
        return {name: value for name, value in self.to_record().items() if value != usual[name]}


@dataclass(frozen=True, kw_only=True)
class SceneConfig(SceneOptions):
    """Configuration of the scenes of one task. A configuration and a seed determine a scene. All values can be pickled.

    Attributes:
        instances: instances to choose from.
    """

    task: TaskSpec
    instances: Drawn = "all"

    def __hash__(self) -> int:
        """Return a hash of the task's name, because the mappings in a spec cannot be hashed."""
        return hash((self.task.name, self.instances, *self.to_record().values()))

    @property
    def options(self) -> SceneOptions:
        """Options shared with the scenes of other tasks."""
        return SceneOptions(**self.to_record())

    @property
    def drawn(self) -> Words | Mapping[str, Words]:
        """Selection of instances, as in :class:`SceneArguments`."""
        return dict(self.instances) if isinstance(self.instances, frozenset) else self.instances


def split_arguments(given: Mapping[str, Any]) -> tuple[SceneArguments, dict[str, Any]]:
    """Split arguments into scene arguments and other arguments."""
    scene = {name: value for name, value in given.items() if name in SCENE_FIELDS}
    return cast(SceneArguments, scene), {name: value for name, value in given.items() if name not in scene}
