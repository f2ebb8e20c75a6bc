"""``dataset.json``: everything that the episodes of a data set follow from, and what they came to."""

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
"""A task's name is its folder's, too; the same rule as in :class:`~gensim2.tasks.spec.TaskSpec`."""

_OPTIONS: tuple[TypeAdapter[Any], ...] = (TypeAdapter(SceneOptions), TypeAdapter(RolloutOptions))


class _Record(BaseModel):
    """Nothing is converted and nothing is let pass."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class ObjectUsed(_Record):
    """An object that episodes were run with.

    Attributes:
        content_hash: of the files that it was made from, or of what it was generated from.
        license: its terms, which the data carries on.
    """

    content_hash: str
    license: str


class TaskRecord(_Record):
    """One task of a data set.

    Attributes:
        digest: of ``task.yaml`` and the strategies.
        instances: which objects its episodes draw from, one word.
        objects: generated ones of each articulated class that are drawn from in their place; None: those.
        tried, held, strict: episodes; None until all are there.
        causes: why the others do not count as held.
    """

    digest: str
    instances: str
    objects: int | None = None
    tried: Count | None = None
    held: Count | None = None
    strict: Count | None = None
    causes: dict[str, int] = {}


class DatasetRecord(RunSettings):
    """``dataset.json``.

    Attributes:
        arguments: what all episodes follow from: fields of :class:`~gensim2.scenes.config.SceneOptions` and of
            :class:`~gensim2.rollout.config.RolloutOptions`.
        seed: of the collection.
        episodes: tried of each task.
        keep_failures: whether the states of failures are kept, too.
        tasks: by name, in the order in which they were named.
        listings: digest of which objects there are, by class: episodes draw from the list.
        versions: of what decides the outcome.
        objects: those that episodes were run with, by ``class/id``; filled at the end.
        complete: all episodes of all tasks are there.
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
        """Let no arguments in that episodes cannot follow from."""
        for kind, adapter in zip((SceneOptions, RolloutOptions), _OPTIONS, strict=True):
            given = {each.name: self.arguments[each.name] for each in fields(kind) if each.name in self.arguments}
            try:
                adapter.validate_python(given)
            except InputError as error:
                raise ValueError(str(error)) from error
        return self

    def differences(self, now: Self) -> Iterator[tuple[str, str]]:
        """Yield the differences; a collection may get more episodes and more tasks."""
        for name in ("arguments", "versions", "seed", "keep_failures"):
            yield from differing(name, getattr(self, name), getattr(now, name))
        if now.episodes < self.episodes:
            yield "episodes", f"was begun with {self.episodes}; it may get more, not fewer than that"
        if list(now.tasks)[: len(self.tasks)] != list(self.tasks):
            text = "was begun with these tasks in this order; further ones may follow"
            yield "tasks", f"{text}: {', '.join(self.tasks)}"
        for name, listing in sorted(self.listings.items()):
            if now.listings.get(name) != listing:
                yield f"listings.{name}", f"the objects of class {name} have changed since the collection was begun"
        fixed = {"digest", "instances", "objects"}
        for name, task in self.tasks.items():
            was, given = (each.model_dump(include=fixed) for each in (task, now.tasks[name]))
            yield from differing(f"tasks.{name}", was, given)

    def resumed_by(self, now: Self) -> Self:
        """Return the record of ``now`` with what is known of the episodes; without new ones the outcome stays."""
        update: dict[str, Any] = {"objects": dict(self.objects)}
        if (now.episodes, list(now.tasks)) == (self.episodes, list(self.tasks)):
            update |= {"tasks": dict(self.tasks), "complete": self.complete}
        return now.model_copy(update=update)

    @property
    def scene(self) -> SceneOptions:
        """Options that the scenes of all tasks share."""
        return SceneOptions.from_record(self.arguments)

    @property
    def rollout(self) -> RolloutOptions:
        """Options that all episodes share beside their scenes."""
        return RolloutOptions.from_record(self.arguments)

    def scene_seed(self, task: str, index: int) -> int:
        """Seed of an episode's reset: a function of the collection's seed, the task's name and the index alone."""
        return scene_seeds(self.seed, task, "collect", 1, start=index)[0]
