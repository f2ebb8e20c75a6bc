"""``dataset.json``: everything that the episodes of a data set follow from, and what they came to."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from gensim2.scenes.config import Circumstances
from gensim2.seeding import scene_seeds

DATASET_SCHEMA: Literal[1] = 1

Count = Annotated[int, Field(ge=0)]


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
        tried, held, strict: episodes; None until all are there.
        causes: why the others do not count as held.
    """

    digest: str
    instances: str
    tried: Count | None = None
    held: Count | None = None
    strict: Count | None = None
    causes: dict[str, int] = {}


class DatasetRecord(_Record):
    """``dataset.json``.

    Attributes:
        arguments: what all episodes follow from, as :class:`~gensim2.scenes.config.Circumstances` has it:
            ``assets``, ``physics``, ``robot``, ``open_loop``, ``disturbance``, ``randomization`` and ``attempts``.
        seed: of the collection.
        episodes: tried of each task.
        keep_failures: whether the states of failures are kept, too.
        tasks: by name, in the order in which they were named.
        listings: digest of which objects there are, by class: episodes draw from the list.
        versions: of what decides the outcome.
        objects: those that episodes were run with, by ``class/id``; filled at the end.
        complete: all episodes of all tasks are there.
    """

    schema_version: Literal[1] = DATASET_SCHEMA
    arguments: dict[str, Any]
    seed: Count
    episodes: Annotated[int, Field(ge=1)]
    keep_failures: bool
    tasks: dict[str, TaskRecord]
    listings: dict[str, str]
    versions: dict[str, str]
    objects: dict[str, ObjectUsed] = {}
    complete: bool = False

    @property
    def circumstances(self) -> Circumstances:
        """What all episodes follow from, beside their task."""
        return Circumstances(**{field.name: self.arguments[field.name] for field in fields(Circumstances)})

    def scene_seed(self, task: str, index: int) -> int:
        """Seed of an episode's reset: a function of the collection's seed, the task's name and the index alone."""
        return scene_seeds(self.seed, task, "collect", 1, start=index)[0]
