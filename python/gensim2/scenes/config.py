"""Configuration of scenes: what initial states follow from beside their seed, spelled once for everybody who takes it.

Users give the keywords of :class:`SceneArguments`; a run keeps :class:`SceneOptions`, which its tasks share; the scenes
of one task follow from a :class:`SceneConfig`. Command-line options and files carry the same names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, TypedDict, Unpack, cast

from pydantic import BeforeValidator

from gensim2.core.errors import MissingExtraError
from gensim2.objects import open_library
from gensim2.robots import DEFAULT_ROBOT, robot_key
from gensim2.scenes.arguments import ObjectSource, Words, check_words
from gensim2.scenes.physics import (
    DEFAULT_ENGINE,
    DEFAULT_PHYSICS,
    Engine,
    check_engine,
    physics_name,
    physics_word,
    with_current_scene,
)
from gensim2.tasks.presets import DEFAULT_PRESET, PresetName, preset
from gensim2.tasks.spec import TaskSpec

Drawn = str | tuple[str, ...] | frozenset[tuple[str, str | tuple[str, ...]]]
"""Instances that scenes draw from: one word, several ids, or (object's name, word or ids) pairs."""

SceneRecord = Annotated[dict[str, Any], BeforeValidator(with_current_scene)]
"""Fields of a file that hold those of :class:`SceneOptions`, whatever release wrote them."""


class SceneArguments(TypedDict, total=False):
    """Inputs of the scenes of a task beside their seed, by keyword; nothing else in the package spells it.

    Keys:
        assets: folder of objects, ``"builtin"``, or None for ``GENSIM2_ASSETS`` or else the built-in library. An
            environment takes an opened library, too.
        instances: what is drawn from, where the task does not say itself: ``all``, ``train``, ``test``, ``new``
            (generated ones beyond the listed ones), an id, or ``random``: one, drawn by the seed of a run. An
            environment takes several of them, too, also by object.
        physics: ``"default"``, ``"original"``, a mixture of both, or a file of switches (docs/reference/simulation.md).
        redraw: ``"placement"`` or ``"none"``, in place of what ``physics`` says of it; None: as it says.
        robot: name of a known robot (:func:`gensim2.load_robot` makes one's own known).
        randomization: ``"paper"`` for the task's ranges, ``"paper-half"`` or ``"wide"`` (docs/reference/simulation.md).
        engine: ``"sapien"`` or ``"mujoco"`` (docs/reference/simulation.md).
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
    """Options that the scenes of all tasks of a run share, from a user's keywords (:meth:`of`) or from a file.

    Attributes:
        assets: a folder of objects or ``"builtin"``.
        physics: the word for its switches (:mod:`gensim2.scenes.physics`); never a file's name.
        robot: word of a known robot; none is loaded.
        randomization: name of the preset, which says what becomes of the tasks' ranges.
        engine: that simulates the scenes.

    Raises:
        InputError: there is no such physics, robot, randomization or engine, or the engine cannot simulate the physics.
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
        """Options from a user's keywords; ``instances`` is a matter of each task.

        Raises:
            InputError: the folder, the robot or a preset cannot be used.
            MissingExtraError: the engine, or a package with the robot's model, is not installed.
        """
        words = {name: scene[name] for name in ("physics", "robot", "randomization", "engine") if name in scene}
        if words.get("robot", "") is None:
            del words["robot"]
        check_words(**words)
        words["physics"] = physics_name(words.get("physics", DEFAULT_PHYSICS), scene.get("redraw"))
        options = cls("", **cast(Any, words))
        if options.engine == "mujoco" and find_spec("mujoco") is None:
            raise MissingExtraError("mujoco", "mujoco")
        assets = scene.get("assets")
        library = open_library(assets) if assets is None or isinstance(assets, str | Path) else assets
        return replace(options, assets=str(getattr(library, "location", "")))

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> SceneOptions:
        """Read the options from the fields of a file; other fields are ignored.

        Args:
            record: the file's fields.

        Raises:
            InputError: there is no such physics, robot or randomization.
        """
        return cls(**{each.name: record[each.name] for each in fields(SceneOptions) if each.name in record})

    def to_record(self) -> dict[str, Any]:
        """Fields of a file."""
        return {each.name: getattr(self, each.name) for each in fields(SceneOptions)}

    def with_task(self, task: TaskSpec, instances: Drawn = "all") -> SceneConfig:
        """Configuration of the scenes of one task."""
        return SceneConfig(**self.to_record(), task=task, instances=instances)

    @property
    def environment(self) -> dict[str, str]:
        """Arguments of the registered environment, where they are not its defaults."""
        usual = SceneOptions(self.assets).to_record()
        return {name: value for name, value in self.to_record().items() if value != usual[name]}


@dataclass(frozen=True, kw_only=True)
class SceneConfig(SceneOptions):
    """Inputs of the scenes of one task beside their seed: plain values that pickle.

    Attributes:
        task: what is to be done.
        instances: which instances are drawn from.
    """

    task: TaskSpec
    instances: Drawn = "all"

    def __hash__(self) -> int:
        """By the task's name: a spec holds mappings."""
        return hash((self.task.name, self.instances, *self.to_record().values()))

    @property
    def options(self) -> SceneOptions:
        """Options shared with the scenes of other tasks."""
        return SceneOptions(**self.to_record())

    @property
    def drawn(self) -> Words | Mapping[str, Words]:
        """Instances as :class:`SceneArguments` has them."""
        return dict(self.instances) if isinstance(self.instances, frozenset) else self.instances


def split_arguments(given: Mapping[str, Any]) -> tuple[SceneArguments, dict[str, Any]]:
    """Keywords of scenes, and all others."""
    scene = {name: value for name, value in given.items() if name in SCENE_FIELDS}
    return cast(SceneArguments, scene), {name: value for name, value in given.items() if name not in scene}
