"""Answers on disk by the digest of their question: what a run is recorded in, resumed from and replayed from.

DIR/model.json                 who was asked, and how
DIR/answers/<digest>.json      a question, its answer, and what they cost
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gensim2.design.llm.ledger import BudgetSpent
from gensim2.design.llm.options import ModelOptions, model_options
from gensim2.design.llm.questions import Answer, Question
from gensim2.errors import InputError
from gensim2.files import write_json
from gensim2.special_files import is_special

MODEL_JSON = "model.json"

#: Bytes of the longest file of an answer.
MAX_BYTES = 30_000_000


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


_R = TypeVar("_R", bound=_Record)


class ModelRecord(_Record):
    """``model.json``: what questions and answers follow from, and what a replay's costs follow from.

    Attributes:
        model, temperature, max_tokens, price_in, price_out, budget: as of :class:`ModelOptions`.
        prompts: digest of the prompts.
        asking: what was asked for, as plain data.
        endpoint: address that was asked; None: a replay, or a record of an earlier version.
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
        """Options of a replay.

        Raises:
            InputError: they are none; names the field.
        """
        shared = ModelRecord.model_fields.keys() & ModelOptions.model_fields.keys()
        return model_options(**{name: getattr(self, name) for name in shared})

    @staticmethod
    def of(options: ModelOptions, prompts: str, asking: Mapping[str, Any], endpoint: str | None) -> ModelRecord:
        """Of the options, of the digest of the prompts, of what is asked for, and of who is asked."""
        shared = ModelRecord.model_fields.keys() & ModelOptions.model_fields.keys()
        fields = {name: getattr(options, name) for name in shared}
        return ModelRecord(prompts=prompts, asking=dict(asking), endpoint=endpoint, **fields)


class AnswerRecord(_Record):
    """``answers/<digest>.json``; ``spent`` says why there is no answer: the budget was."""

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


class AnswerStore:
    """Folder of a model's answers by the digest of their question; threads and processes may share it.

    An answer is whole or absent.

    Args:
        path: the folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def model(self) -> ModelRecord:
        """Record of the model that was asked.

        Raises:
            InputError: the folder holds no record, or one that cannot be read.
        """
        return _read(self.path / MODEL_JSON, ModelRecord)

    def write_model(self, record: ModelRecord) -> None:
        """Write ``model.json``; a folder holds the answers of one model to one kind of questions.

        Raises:
            InputError: it holds those of another.
        """
        path = self.path / MODEL_JSON
        if path.exists():
            before = self.model()
            for name in ("model", "temperature", "max_tokens", "prompts", "asking"):
                was, now = getattr(before, name), getattr(record, name)
                if was != now:
                    remedy = "ask as before, or choose another folder"
                    raise InputError(f"was begun with {was!r}, not {now!r}", file=path, field=name, remedy=remedy)
            was, now = before.endpoint, record.endpoint
            if was is not None and now is not None and was != now:
                remedy = "ask there, or choose another folder"
                raise InputError(f"holds answers of {was}, not {now}", file=path, field="endpoint", remedy=remedy)
        write_json(self.path / MODEL_JSON, record.model_dump())

    def get(self, digest: str) -> Answer | None:
        """The answer to a question; None where there is none.

        Raises:
            InputError: the file is damaged.
            BudgetSpent: in place of an answer it is recorded that the budget was spent.
        """
        record = self.record(digest)
        if record is None:
            return None
        if record.spent is not None:
            raise BudgetSpent(record.spent)
        fields = {name: getattr(record, name) for name in Answer.__dataclass_fields__}
        return Answer(**fields)

    def record(self, digest: str) -> AnswerRecord | None:
        """All that is known of a question, for the report.

        Raises:
            InputError: the file is damaged.
        """
        path = self._file(digest)
        return _read(path, AnswerRecord) if os.path.lexists(path) else None

    def put(self, digest: str, question: Question, answer: Answer) -> None:
        """Keep an answer."""
        fields = {name: getattr(answer, name) for name in Answer.__dataclass_fields__}
        self._write(digest, question, fields)

    def put_spent(self, digest: str, question: Question, why: str) -> None:
        """Keep that there is no answer because the budget was spent: a replay ends there, too."""
        nothing = Answer("", None, 0, 0, True, 0, None)
        fields = {name: getattr(nothing, name) for name in Answer.__dataclass_fields__}
        self._write(digest, question, {**fields, "spent": why})

    def _write(self, digest: str, question: Question, fields: Mapping[str, Any]) -> None:
        said = [
            {"role": m.role, "text": m.text, **({"pictures": [p.of for p in m.pictures]} if m.pictures else {})}
            for m in question.messages
        ]
        record = AnswerRecord(stage=question.stage, subject=question.subject, messages=said, **fields)
        write_json(self._file(digest), record.model_dump())

    def _file(self, digest: str) -> Path:
        return self.path / "answers" / f"{digest[:32]}.json"


def _read(path: Path, kind: type[_R]) -> _R:
    try:
        if is_special(path):
            raise InputError("is not a regular file", file=path)
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise InputError("is too large to be what was recorded", file=path)
        return kind.model_validate_json(data)
    except OSError as error:
        remedy = "give the folder that --record made"
        raise InputError(f"cannot read: {error.strerror}", file=path, remedy=remedy) from error
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or None
        remedy = "restore the file; a run asks again where it is deleted"
        raise InputError(f"is damaged: {first['msg']}", file=path, field=field, remedy=remedy) from error
