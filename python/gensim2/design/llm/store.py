"""Store the answers of a run, each under the digest of its question, to resume or replay the run.

DIR/model.json                 the model and its settings
DIR/answers/<digest>.json      a question, its answer and their cost
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from gensim2.core.errors import InputError
from gensim2.core.files import write_json
from gensim2.core.record_files import Record, read_record
from gensim2.design.llm.options import ModelOptions, model_options
from gensim2.design.llm.questions import BudgetSpent, ModelAnswer, ModelQuestion

MODEL_FOLDER = "model"
"""Folder of a run for the records of its designer."""
MODEL_JSON = "model.json"
ANSWERS = "answers"

NO_ANSWER = ModelAnswer("", None, 0, 0, True, 0, None)

_REMEDY = "give the folder of a run that a language model designed, or restore the file"


class ModelRecord(Record):
    """Content of ``model.json``: everything that determines the questions, answers and costs of a run.

    Attributes:
        model, temperature, max_tokens, price_in, price_out, budget: as in :class:`ModelOptions`.
        prompts: digest of the prompts.
        asking: settings of the requested designs, as JSON data.
        endpoint: address of the endpoint; None in a replay and in records of earlier versions.
    """

    schema_version: Literal[1] = 1
    model: str
    temperature: float | None
    max_tokens: int
    price_in: float | None
    price_out: float | None
    budget: float | None
    prompts: str
    asking: dict[str, Any]
    endpoint: str | None = None

    @property
    def options(self) -> ModelOptions:
        """Return the options of a replay.

        Raises:
            InputError: a field is invalid; the message names the field.
        """
        shared = ModelRecord.model_fields.keys() & ModelOptions.model_fields.keys()
        return model_options(**{name: getattr(self, name) for name in shared})

    @staticmethod
    def of(options: ModelOptions, prompts: str, asking: Mapping[str, Any], endpoint: str | None) -> ModelRecord:
        """Build the record from options, digest of the prompts, requested designs and address of the endpoint."""
        shared = ModelRecord.model_fields.keys() & ModelOptions.model_fields.keys()
        fields = {name: getattr(options, name) for name in shared}
        return ModelRecord(prompts=prompts, asking=dict(asking), endpoint=endpoint, **fields)


class AnswerRecord(Record):
    """Content of ``answers/<digest>.json``.

    The file has a question with its answer, or with the reason ``spent`` for the lack of an answer.
    """

    schema_version: Literal[1] = 1
    stage: str
    subject: str
    messages: list[dict[str, Any]]
    text: str
    problem: str | None
    tokens_in: Annotated[int, Field(ge=0)]
    tokens_out: Annotated[int, Field(ge=0)]
    counted: bool
    retries: Annotated[int, Field(ge=0)]
    cost: Annotated[float, Field(ge=0)] | None
    spent: str | None = None

    @property
    def answer(self) -> ModelAnswer:
        """Return the answer.

        Raises:
            BudgetSpent: the record says that the budget was spent.
        """
        if self.spent is not None:
            raise BudgetSpent(self.spent)
        return ModelAnswer(**{name: getattr(self, name) for name in ModelAnswer.__dataclass_fields__})


class AnswerStore:
    """Folder with the answers of a run, one file for each question. Threads and processes may share the folder.

    Each file is written atomically.

    Args:
        path: folder, such as ``OUT/model``; None: store answers only in the cache.
        cache: folder with the answers of all runs; None: no cache.
    """

    def __init__(self, path: Path | None, cache: Path | None = None) -> None:
        self.path, self.cache = path, cache

    def model(self) -> ModelRecord:
        """Return the record of the model that was asked.

        Raises:
            InputError: the folder holds no readable record.
        """
        assert self.path is not None
        return read_record(self.path / MODEL_JSON, ModelRecord, _REMEDY)

    def write_model(self, record: ModelRecord) -> None:
        """Write ``model.json``. If the file exists, check that the model and the settings are the same for all answers.

        Raises:
            InputError: the folder holds answers of another model or with other settings.
        """
        assert self.path is not None
        path = self.path / MODEL_JSON
        if path.exists():
            before = self.model()
            for name in ("model", "temperature", "max_tokens", "prompts", "asking"):
                was, now = getattr(before, name), getattr(record, name)
                if was != now:
                    remedy = "use the recorded value, or choose another folder"
                    wrong = f"the recorded answers were requested with {was!r}, but this run uses {now!r}"
                    raise InputError(wrong, file=path, field=name, remedy=remedy)
            was, now = before.endpoint, record.endpoint
            if was is not None and now is not None and was != now:
                remedy = "use the same endpoint, or choose another folder"
                wrong = f"contains answers from the endpoint {was}, but this run uses {now}"
                raise InputError(wrong, file=path, field="endpoint", remedy=remedy)
        write_json(path, record.model_dump())

    def copy(self, source: Path) -> None:
        """Copy the answers of another run's folder.

        Raises:
            InputError: an answer in ``source`` is damaged.
        """
        for path in sorted((source / ANSWERS).glob("*.json")):
            write_json(self._file(path.stem), read_record(path, AnswerRecord, _REMEDY).model_dump())

    def record(self, digest: str, shared: str | None = None) -> AnswerRecord | None:
        """Return the stored record of a question; None if no answer is stored.

        Args:
            digest: digest of the question.
            shared: digest of question and endpoint, the key of the cache; None: skip the cache.

        Raises:
            InputError: the run's file is damaged. A damaged entry of the cache counts as missing.
        """
        if self.path is not None and os.path.lexists(path := self._file(digest)):
            return read_record(path, AnswerRecord, _REMEDY)
        if self.cache is None or shared is None:
            return None
        try:
            return read_record(_file(self.cache, shared), AnswerRecord, _REMEDY)
        except InputError:
            return None

    def put(
        self,
        digest: str,
        question: ModelQuestion,
        answer: ModelAnswer,
        shared: str | None = None,
        spent: str | None = None,
    ) -> None:
        """Store an answer.

        Args:
            digest: digest of the question.
            question: the question.
            answer: the answer; ``NO_ANSWER`` if the budget was spent before the question was asked.
            shared: digest of question and endpoint, the key of the cache; None: do not cache the answer.
            spent: message that the budget was spent before the question. A replay stops there. None otherwise.
        """
        said = [
            {"role": m.role, "text": m.text, **({"pictures": [p.of for p in m.pictures]} if m.pictures else {})}
            for m in question.messages
        ]
        fields = {name: getattr(answer, name) for name in ModelAnswer.__dataclass_fields__}
        record = AnswerRecord(
            stage=question.stage, subject=question.subject, messages=said, spent=spent, **fields
        ).model_dump()
        if self.path is not None:
            write_json(self._file(digest), record)
        if self.cache is not None and shared is not None:
            write_json(_file(self.cache, shared), record)

    def _file(self, digest: str) -> Path:
        assert self.path is not None
        return _file(self.path, digest)


def recorded_answers(folder: Path) -> Path:
    """Return the folder with a run's answers; ``folder`` is either the run folder or the folder with the answers."""
    inside = folder / MODEL_FOLDER
    return inside if (inside / MODEL_JSON).exists() else folder


def _file(folder: Path, digest: str) -> Path:
    return folder / ANSWERS / f"{digest[:32]}.json"
