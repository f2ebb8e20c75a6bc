"""Configuration of episodes: their scenes, and what is done in them beside the controller's strategies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal, get_args

from gensim2.core.errors import InputError
from gensim2.core.processes import ExecutionArguments
from gensim2.scenes.config import SceneArguments, SceneConfig, SceneOptions
from gensim2.scenes.physics import with_current_scene
from gensim2.tasks.spec import TaskSpec

Disturbance = Literal["push", "drop"]
"""Kind of disturbance of an episode, once, at a seeded moment."""

DISTURBANCES: tuple[Disturbance, ...] = get_args(Disturbance)

MAX_NOISE = 0.2
"""Largest standard deviation (rad) of noise on joint targets."""


class RolloutArguments(SceneArguments, total=False):
    """Keywords of scenes, and of the chain of planned steps that works in them.

    Keys:
        open_loop: everything is planned at the start of an episode, each step by the first of its strategies that is
            planned whole.
    """

    open_loop: bool


class RunArguments(RolloutArguments, ExecutionArguments, total=False):
    """Keywords of commands that run the chain of steps: of its scenes, of the chain, and of the worker processes."""


class EvaluationArguments(SceneArguments, ExecutionArguments, total=False):
    """Keywords of commands that run any controller: of its scenes, and of the worker processes."""


@dataclass(frozen=True)
class RolloutOptions:
    """Options that all episodes of a run share beside their scenes.

    Attributes:
        open_loop: everything is planned at the start, each step by the first of its strategies that is planned whole.
        one_plan: each step is planned once, by its first strategy; deviations are recorded and not reacted to.
        disturbance: ``"push"`` or ``"drop"``, once an episode at a seeded moment; None: nothing is disturbed.
        attempts: resets to the same start that an episode has at most, until one holds.
        noise: standard deviation (rad) of noise on joint targets now and then; the noise-free action is recorded.

    Raises:
        InputError: the noise is out of range.
    """

    open_loop: bool = False
    one_plan: bool = False
    disturbance: Disturbance | None = None
    attempts: int = 1
    noise: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.noise <= MAX_NOISE:
            raise InputError(f"must lie in 0..{MAX_NOISE} rad, is {self.noise}", field="noise")

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> RolloutOptions:
        """Options from the fields of a file, other fields beside them left alone."""
        return cls(**{each.name: record[each.name] for each in fields(cls) if each.name in record})

    def to_record(self) -> dict[str, Any]:
        """Fields of a file; of episodes without noise it says nothing."""
        return {name: value for name, value in asdict(self).items() if name != "noise" or value}


DEFAULT_ROLLOUT = RolloutOptions()
"""A chain of steps, planned again where something goes otherwise, undisturbed, once."""


@dataclass(frozen=True)
class EpisodeConfig:
    """Inputs of the episodes of one task beside strategies and seed: plain values that pickle.

    Attributes:
        scene: of the task.
        rollout: what else its episodes have in common.
    """

    scene: SceneConfig
    rollout: RolloutOptions = field(default_factory=RolloutOptions)

    @property
    def task(self) -> TaskSpec:
        """Task of the episodes."""
        return self.scene.task


def nested_options(record: Any) -> Any:
    """Return the fields of a file with those of scenes under ``scene`` and those of rollouts under ``rollout``."""
    if not isinstance(record, dict):
        return record
    current = with_current_scene(record)
    names = {kind: {each.name for each in fields(kind)} for kind in (SceneOptions, RolloutOptions)}
    scene, rollout = ({name: current[name] for name in own if name in current} for own in names.values())
    rest = {name: value for name, value in current.items() if name not in scene and name not in rollout}
    return {**rest, "scene": scene, "rollout": rollout}
