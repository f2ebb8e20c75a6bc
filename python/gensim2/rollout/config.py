"""Configure episodes: scenes, and options of the execution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal, get_args

from gensim2.core.errors import InputError
from gensim2.core.processes import ExecutionArguments
from gensim2.scenes.config import SceneArguments, SceneConfig, SceneOptions
from gensim2.scenes.physics import Engines, with_current_scene
from gensim2.tasks.spec import TaskSpec

Disturbance = Literal["push", "drop"]
"""Kind of disturbance, applied once in an episode at a random time."""

DISTURBANCES: tuple[Disturbance, ...] = get_args(Disturbance)

TRUE_SCENE = "true"
"""Name of the scene that the simulator knows, for :attr:`RolloutOptions.scene_source`."""
PERCEIVED_SCENE = "perceived"
"""Name of the scene that the estimator of the package computes from point clouds."""

MAX_NOISE = 0.2
"""Maximum standard deviation (rad) of noise on joint targets."""


class RolloutArguments(SceneArguments, total=False):
    """Options of scenes and of the planned execution of steps.

    Keys:
        open_loop: whether to plan all steps at the start, each with the first strategy that has a complete plan.
        scene_source: scene that the planner gets, as in :class:`RolloutOptions`.
        depth_noise: noise of the depth cameras, as in :class:`RolloutOptions`.
    """

    open_loop: bool
    scene_source: str
    depth_noise: str | None


class RunArguments(RolloutArguments, ExecutionArguments, total=False):
    """Options of commands that execute planned steps: scenes, execution, and worker processes."""


class EvaluationArguments(SceneArguments, ExecutionArguments, total=False):
    """Options for scenes and worker processes, shared by all commands that run a controller."""


@dataclass(frozen=True)
class RolloutOptions:
    """Options for all episodes of a run. Options of scenes are in :class:`~gensim2.scenes.config.SceneOptions`.

    Attributes:
        open_loop: whether to plan all steps at the start, each with the first strategy that has a complete plan.
        one_plan: whether each step is planned only once, with its first strategy. Deviations are then only recorded.
        disturbance: ``"push"`` or ``"drop"``, applied once in an episode at a random time; None for no disturbance.
        attempts: maximum number of attempts from the same initial scene. No attempt follows a success.
        noise: standard deviation (rad) of the noise that is added to joint targets in random periods. Targets without
            noise are recorded, too.
        engines: ``"both"`` also runs each demonstration in the other engine. The demonstration must succeed in both.
        scene_source: ``"true"``: the state of the simulator; ``"perceived"``: an estimate from point clouds by the
            estimator of the package; otherwise the folder of an estimator (``gensim2 perceive train``).
        depth_noise: noise of the depth images for estimated scenes (:func:`~gensim2.perception.noise.read_noise`).
            None: exact depth.

    Raises:
        InputError: the noise is out of range, or an option cannot be combined with an estimated scene.
    """

    open_loop: bool = False
    one_plan: bool = False
    disturbance: Disturbance | None = None
    attempts: int = 1
    noise: float = 0.0
    engines: Engines = "one"
    scene_source: str = TRUE_SCENE
    depth_noise: str | None = None

    def __post_init__(self) -> None:
        if self.is_estimated:
            excluded = {
                "open_loop": self.open_loop,
                "one_plan": self.one_plan,
                "disturbance": self.disturbance is not None,
                "attempts": self.attempts > 1,
            }
            for name, is_set in excluded.items():
                if is_set:
                    said = "cannot be combined with an estimated scene"
                    raise InputError(said, field=name, remedy="leave one of them out")
        elif self.depth_noise is not None:
            wrong = "has no effect, because only an estimated scene is computed from depth images"
            raise InputError(wrong, field="depth_noise", remedy="also give an estimator, or leave depth_noise out")
        if not 0.0 <= self.noise <= MAX_NOISE:
            raise InputError(f"must lie in 0..{MAX_NOISE} rad, but is {self.noise}", field="noise")

    @property
    def is_estimated(self) -> bool:
        """Whether the planner gets an estimated scene."""
        return self.scene_source != TRUE_SCENE

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> RolloutOptions:
        """Read the options from the fields of a record; other fields are ignored."""
        return cls(**{each.name: record[each.name] for each in fields(cls) if each.name in record})

    def to_record(self) -> dict[str, Any]:
        """Return the options as fields of a record. Zero noise, a single engine and the true scene are left out."""
        left_out = {"noise": 0.0, "engines": "one", "scene_source": TRUE_SCENE, "depth_noise": None}
        return {name: value for name, value in asdict(self).items() if name not in left_out or value != left_out[name]}


DEFAULT_ROLLOUT = RolloutOptions()
"""Default options: one attempt with replanning and without disturbance."""


@dataclass(frozen=True)
class EpisodeConfig:
    """Configuration of a task's episodes, as plain values that can be pickled, without strategies and seed.

    Attributes:
        scene: settings of the task's scenes.
        rollout: options of the execution.
    """

    scene: SceneConfig
    rollout: RolloutOptions = field(default_factory=RolloutOptions)

    @property
    def task(self) -> TaskSpec:
        return self.scene.task


def nested_options(record: Any) -> Any:
    """Return the record of a run with its options in the fields ``scene`` and ``rollout``.

    Files store the record flat.
    """
    if not isinstance(record, dict):
        return record
    current = with_current_scene(record)
    names = {kind: {each.name for each in fields(kind)} for kind in (SceneOptions, RolloutOptions)}
    scene, rollout = ({name: current[name] for name in own if name in current} for own in names.values())
    rest = {name: value for name, value in current.items() if name not in scene and name not in rollout}
    return {**rest, "scene": scene, "rollout": rollout}
