"""Define ``dataset.json``, which records the settings and the results of a data set.

The settings are all inputs that determine the episodes of the data set.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, model_validator

from gensim2.core.errors import InputError
from gensim2.core.resumable import RunSettings, differing
from gensim2.core.seeding import scene_seeds
from gensim2.rollout.config import RolloutOptions
from gensim2.scenes.config import SceneOptions, SceneRecord

DATASET_SCHEMA: Literal[1] = 1

Count = Annotated[int, Field(ge=0)]
TaskName = Annotated[str, Field(pattern=r"^[A-Z][A-Za-z0-9]*$", max_length=100)]
"""Pattern of task names, which are also folder names; the same as in :class:`~gensim2.tasks.spec.TaskSpec`."""

_OPTIONS: tuple[TypeAdapter[Any], ...] = (TypeAdapter(SceneOptions), TypeAdapter(RolloutOptions))


class _Record(BaseModel):
    """Base of records, which are validated strictly: no type conversion, no unknown fields."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class ObjectUsed(_Record):
    """An object that episodes of the data set use.

    Attributes:
        content_hash: hash of the object's files, or of the parameters from which it was generated.
        license: license of the object, which also applies to data made with the object.
    """

    content_hash: str
    license: str


class TaskRecord(_Record):
    """One task of a data set.

    Attributes:
        digest: digest of ``task.yaml`` and the strategies.
        instances: set from which the objects of the episodes are sampled, such as ``"test"`` (the test split).
        objects: number of generated objects of each class from which to sample, instead of ``instances``.
        tried: number of all episodes; None until all episodes are finished.
        held: number of successful episodes (verdict `held`). None until all episodes are finished.
        strict: number of episodes that also pass the verdict `strict`; None until all episodes are finished.
        causes: number of failed episodes by cause.
    """

    digest: str
    instances: str
    objects: int | None = None
    tried: Count | None = None
    held: Count | None = None
    strict: Count | None = None
    causes: dict[str, int] = {}


class DatasetRecord(RunSettings):
    """Content of ``dataset.json``.

    Attributes:
        arguments: options that all episodes share. The options are the fields of
            :class:`~gensim2.scenes.config.SceneOptions` and of :class:`~gensim2.rollout.config.RolloutOptions`.
        seed: seed from which the seeds of all scenes are derived.
        episodes: number of episodes to run for each task.
        keep_failures: whether the states of failed episodes are stored as well.
        tasks: tasks by name, in the order of the command.
        listings: for each object class, the digest of the list of objects from which the episodes are sampled.
        versions: versions of the packages that determine the results.
        objects: objects that the episodes of finished tasks use, by ``class/id``.
        complete: whether all episodes of all tasks are finished.
    """

    model_config = _Record.model_config

    schema_version: Literal[1] = DATASET_SCHEMA
    arguments: SceneRecord
    seed: Count
    episodes: Annotated[int, Field(ge=1)]
    keep_failures: bool
    tasks: dict[TaskName, TaskRecord]
    listings: dict[str, str]
    versions: dict[str, str]
    objects: dict[str, ObjectUsed] = Field(default_factory=dict)
    complete: bool = False

    @model_validator(mode="after")
    def _usable(self) -> DatasetRecord:
        for kind, adapter in zip((SceneOptions, RolloutOptions), _OPTIONS, strict=True):
            given = {each.name: self.arguments[each.name] for each in fields(kind) if each.name in self.arguments}
            try:
                adapter.validate_python(given)
            except InputError as error:
                raise ValueError(str(error)) from error
        return self

    def differences(self, now: Self) -> Iterator[tuple[str, str]]:
        """Yield the differences from ``now`` that prevent resuming. Episodes and tasks may be added."""
        for name in ("arguments", "versions", "seed", "keep_failures"):
            yield from differing(name, getattr(self, name), getattr(now, name))
        if now.episodes < self.episodes:
            yield "episodes", f"was begun with {self.episodes}; the number may grow but not shrink"
        if list(now.tasks)[: len(self.tasks)] != list(self.tasks):
            text = "was begun with these tasks in this order; more tasks may be appended"
            yield "tasks", f"{text}: {', '.join(self.tasks)}"
        for name, listing in sorted(self.listings.items()):
            if now.listings.get(name) != listing:
                yield f"listings.{name}", f"the objects of class {name} have changed since the collection began"
        fixed = {"digest", "instances", "objects"}
        for name, task in self.tasks.items():
            was, given = (each.model_dump(include=fixed) for each in (task, now.tasks[name]))
            yield from differing(f"tasks.{name}", was, given)

    def resumed_by(self, now: Self) -> Self:
        """Return the record of a resumed collection.

        The new record has the settings of ``now`` and the objects of this record. The results stay unless ``now`` adds
        tasks or episodes.
        """
        update: dict[str, Any] = {"objects": dict(self.objects)}
        if (now.episodes, list(now.tasks)) == (self.episodes, list(self.tasks)):
            update |= {"tasks": dict(self.tasks), "complete": self.complete}
        return now.model_copy(update=update)

    @property
    def scene(self) -> SceneOptions:
        """Scene options that all tasks share."""
        return SceneOptions.from_record(self.arguments)

    @property
    def rollout(self) -> RolloutOptions:
        """Rollout options of all episodes."""
        return RolloutOptions.from_record(self.arguments)

    def scene_seed(self, task: str, index: int) -> int:
        """Return the scene seed of an episode, which depends only on the collection's seed, the task and the index."""
        return scene_seeds(self.seed, task, "collect", 1, start=index)[0]
