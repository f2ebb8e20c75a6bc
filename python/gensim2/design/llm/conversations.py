"""Ask a model, and send the faults of its answer back until an answer is valid or all rounds are used."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

from pydantic import Field

from gensim2.core.errors import GenSim2Error, InputError
from gensim2.core.files import write_json
from gensim2.core.record_files import Record, read_record
from gensim2.design.llm.extraction import Data, mappings
from gensim2.design.llm.model import LanguageModel
from gensim2.design.llm.questions import Message, ModelQuestion
from gensim2.design.llm.store import MODEL_FOLDER
from gensim2.design.llm.templating import Prompts
from gensim2.design.pictures import LazyPicture

CONVERSATIONS = "conversations.json"

Outcome = Literal["used", "dropped", "refused"]
"""Outcome of a conversation; ``"refused"``: the answer is valid, but reflection rejected it or it repeats a task."""


class TurnRecord(Record):
    """Record of one prompt and its answer.

    Attributes:
        answer: digest of the question. The question and its answer are in ``answers/<first 32 digits>.json``.
        problems: faults. All faults are sent back to the model if the whole answer is unusable; otherwise faulty parts
            are left out.
    """

    answer: str
    problems: list[str]


class ConversationRecord(Record):
    """Record of a conversation: one question and all rounds of answers and corrections.

    Attributes:
        subject: name of the task; empty if no task resulted.
        about: part of the task that the question is about.
        outcome: whether the answer was used, dropped (no valid answer) or refused.
        reason: why the answer was dropped or refused; empty if the answer was used.
        turns: questions and answers in order.
    """

    stage: str
    subject: str
    about: str
    outcome: Outcome
    reason: str
    turns: list[TurnRecord]


class LogRecord(Record):
    """Content of ``conversations.json``."""

    schema_version: Literal[1] = 1
    conversations: list[ConversationRecord] = Field(default_factory=list)


class ConversationLog:
    """All conversations of a run; the file is rewritten after each conversation. Threads may share the log."""

    def __init__(self) -> None:
        self._path: Path | None = None
        self._found: dict[str, ConversationRecord] = {}
        self._lock = threading.Lock()

    def open(self, folder: Path) -> None:
        """Store conversations in ``folder``, and keep the conversations of earlier calls of the run.

        Raises:
            InputError: the existing file is damaged.
        """
        self._path = folder / CONVERSATIONS
        for record in read_log(folder).conversations:
            self._found.setdefault(_key(record), record)
        self._write()

    def add(self, record: ConversationRecord) -> None:
        """Add a conversation to the log, in place of an older conversation that begins with the same question."""
        with self._lock:
            self._found[_key(record)] = record
            self._write()

    def settle(self, record: ConversationRecord, subject: str, outcome: Outcome, reason: str = "") -> None:
        """Record the outcome of a conversation: whether its answer was used, dropped or refused."""
        self.add(record.model_copy(update={"subject": subject, "outcome": outcome, "reason": reason}))

    @property
    def conversations(self) -> list[ConversationRecord]:
        """All conversations, sorted by task, part of the task and stage instead of the time of arrival."""
        return sorted(self._found.values(), key=lambda each: (each.subject, each.about, each.stage, _key(each)))

    def _write(self) -> None:
        if self._path is not None:
            write_json(self._path, LogRecord(conversations=self.conversations).model_dump())


def read_log(folder: Path) -> LogRecord:
    """Read the conversations of a run; the list is empty if the run asked no model.

    Raises:
        InputError: the file is damaged.
    """
    path = folder / CONVERSATIONS
    if not os.path.lexists(path):
        return LogRecord()
    return read_record(path, LogRecord, "delete the file and resume")


def _key(record: ConversationRecord) -> str:
    return record.turns[0].answer


#: Maximum number of characters of a wrong answer that are sent back to the model.
SHOWN_AGAIN = 6000

#: Maximum number of faults of an answer that are sent back to the model at once.
MAX_PROBLEMS = 12

T = TypeVar("T")


class Wrong(GenSim2Error):
    """An answer was parsed, but its content is invalid.

    Args:
        problems: faults of the answer, as sentences that are sent to the model.
    """

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = tuple(problems)


class Dropped(GenSim2Error):
    """A question was dropped, because no round gave a valid answer."""


@dataclass(frozen=True)
class Ask(Generic[T]):
    """Question to a model in one stage of a design.

    Attributes:
        subject: name of the task; empty if the task has no name yet.
        about: part of the task that the question is about, which distinguishes questions of one stage.
        prompt: text of the question.
        schema: JSON schema of the answer.
        read: function that converts an answer's data to a value, or raises Wrong or InputError if they are invalid.
        pictures: pictures sent with the prompt.
        sample: number of the repetition of a question.
        remarks: list for the faults of parts that ``read`` leaves out. The record of the conversation stores them.
        prose: whether ``read`` gets the unparsed text of the answer, under the key ``text``.
    """

    stage: str
    subject: str
    about: str
    prompt: str
    schema: dict[str, Any]
    read: Callable[[list[Data]], T]
    pictures: tuple[LazyPicture, ...] = ()
    sample: int = 0
    prose: bool = False
    remarks: list[str] = field(default_factory=list)


class Conversations:
    """Asks a model and records the conversations.

    Args:
        model: language model.
        prompts: prompt templates.
        max_rounds: number of invalid answers after which a question is dropped.

    Attributes:
        seed: seed of the run; runs with different seeds get different answers to the same question.
        log: record of the conversations.
    """

    def __init__(self, model: LanguageModel, prompts: Prompts, max_rounds: int) -> None:
        self.model, self.prompts, self.max_rounds = model, prompts, max_rounds
        self.seed = 0
        self.log = ConversationLog()

    def open(self, folder: Path) -> None:
        """Store questions and answers in the run folder ``folder``."""
        self.model.open(folder / MODEL_FOLDER)
        self.log.open(folder / MODEL_FOLDER)

    def ask(self, ask: Ask[T]) -> tuple[T, ConversationRecord]:
        """Return the value of a valid answer, and the record of its conversation with the outcome ``"used"``.

        Raises:
            Dropped: no answer was valid; the record says why.
            BudgetSpent: the question might cost more than the remaining budget.
            ModelError: the endpoint gives no answer.
        """
        first = (Message("system", self.prompts.text("system")), Message("user", ask.prompt, ask.pictures))
        start = ModelQuestion(ask.stage, ask.subject or ask.about, first, ask.schema, (self.seed, ask.sample))
        question = start
        turns: list[TurnRecord] = []
        for number in range(1, self.max_rounds + 1):
            answer = self.model.answer(question)
            digest = self.model.digest(question)
            try:
                value = self._read(ask, answer.text, answer.problem)
            except (Wrong, InputError) as wrong:
                problems = list(wrong.problems[:MAX_PROBLEMS]) if isinstance(wrong, Wrong) else [str(wrong)]
                turns.append(TurnRecord(answer=digest, problems=problems))
            else:
                left_out = ask.remarks[:MAX_PROBLEMS]
                record = self._record(ask, [*turns, TurnRecord(answer=digest, problems=left_out)], "")
                self.log.add(record)
                return value, record
            shown = answer.text if len(answer.text) <= SHOWN_AGAIN else f"{answer.text[:SHOWN_AGAIN]} ..."
            reply = self.prompts.text("correction", problems=problems)
            question = start.followed_by(shown or "(nothing)", reply, number)
        reason = f"{len(turns)} answers could not be used; the last: {'; '.join(turns[-1].problems)}"
        self.log.add(self._record(ask, turns, reason))
        raise Dropped(f"{ask.stage}{f' ({ask.about})' if ask.about else ''}: {reason}")

    @staticmethod
    def _read(ask: Ask[T], text: str, problem: str | None) -> T:
        if problem is not None:
            raise Wrong([problem])
        return ask.read([{"text": text}] if ask.prose else mappings(text))

    @staticmethod
    def _record(ask: Ask[T], turns: list[TurnRecord], reason: str) -> ConversationRecord:
        return ConversationRecord(
            stage=ask.stage,
            subject=ask.subject,
            about=ask.about,
            outcome="dropped" if reason else "used",
            reason=reason,
            turns=list(turns),
        )
