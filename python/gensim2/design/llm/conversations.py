"""One question after the other, each until its answer can be used: what is wrong goes back to the model in words."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict

from gensim2.core.errors import GenSim2Error, InputError
from gensim2.core.files import write_json
from gensim2.core.record_files import read_record
from gensim2.design.llm.extraction import Data, mappings
from gensim2.design.llm.model import LanguageModel
from gensim2.design.llm.questions import Message, ModelQuestion
from gensim2.design.llm.store import MODEL_FOLDER
from gensim2.design.llm.templating import Prompts
from gensim2.design.pictures import LazyPicture

CONVERSATIONS = "conversations.json"

Outcome = Literal["used", "dropped", "refused"]
"""``"refused"``: could be read, and was not wanted: reflection found it bad, or it repeats what is there."""


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class TurnRecord(_Record):
    """One question and its answer.

    Attributes:
        answer: digest of the question; ``answers/<its first 32 digits>.json`` holds both.
        problems: what was wrong with the answer, in the words that the model was told.
    """

    answer: str
    problems: list[str]


class ConversationRecord(_Record):
    """One question until it was answered well, or dropped.

    Attributes:
        stage: which prompt.
        subject: name of the task; empty where it came to none.
        about: which part of it.
        outcome: what became of it.
        reason: why it was dropped or refused; empty where it was used.
        turns: in order.
    """

    stage: str
    subject: str
    about: str
    outcome: Outcome
    reason: str
    turns: list[TurnRecord]


class LogRecord(_Record):
    """``conversations.json``."""

    schema_version: Literal[1] = 1
    conversations: list[ConversationRecord] = []


class ConversationLog:
    """The conversations of a run, written whenever one ends. Threads may share it."""

    def __init__(self) -> None:
        self._path: Path | None = None
        self._found: dict[str, ConversationRecord] = {}
        self._lock = threading.Lock()

    def open(self, folder: Path) -> None:
        """Write to ``folder``, and go on with what an earlier call of the run has written there.

        Raises:
            InputError: the file there is damaged.
        """
        self._path = folder / CONVERSATIONS
        for record in read_log(folder).conversations:
            self._found.setdefault(_key(record), record)
        self._write()

    def add(self, record: ConversationRecord) -> None:
        """Keep a conversation; one that begins with the same question takes the place of the former."""
        with self._lock:
            self._found[_key(record)] = record
            self._write()

    def settle(self, record: ConversationRecord, subject: str, outcome: Outcome, reason: str = "") -> None:
        """Say what became of an answer that could be read."""
        self.add(record.model_copy(update={"subject": subject, "outcome": outcome, "reason": reason}))

    @property
    def conversations(self) -> list[ConversationRecord]:
        """So far; the order does not depend on which was answered first."""
        return sorted(self._found.values(), key=lambda each: (each.subject, each.about, each.stage, _key(each)))

    def _write(self) -> None:
        if self._path is not None:
            write_json(self._path, LogRecord(conversations=self.conversations).model_dump())


def read_log(folder: Path) -> LogRecord:
    """The conversations of a run; none where no question was asked.

    Raises:
        InputError: the file is damaged.
    """
    path = folder / CONVERSATIONS
    if not os.path.lexists(path):
        return LogRecord()
    return read_record(path, LogRecord, "delete the file and resume")


def _key(record: ConversationRecord) -> str:
    return record.turns[0].answer


#: Characters of a wrong answer that are shown to the model again.
SHOWN_AGAIN = 6000

#: Problems told at once: more are not read.
MAX_PROBLEMS = 12

T = TypeVar("T")


class Wrong(GenSim2Error):
    """An answer can be read and not be used.

    Args:
        problems: each names what is wrong, in words for the model.
    """

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = tuple(problems)


class Dropped(GenSim2Error):
    """A question had no answer that could be used, after all rounds."""


@dataclass(frozen=True)
class Ask(Generic[T]):
    """Question of a stage.

    Attributes:
        stage: which prompt.
        subject: name of the task; empty where there is none yet.
        about: which part of it, to tell questions of one stage apart.
        prompt: the text.
        schema: JSON schema of the answer.
        read: makes a value of what an answer holds.

            Raises:
                Wrong, InputError: it cannot be used.
        pictures: that go along.
        sample: number among equal questions.
        prose: ``read`` is given the answer as it is, as the only field ``text``.
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


class Conversations:
    """Asks a model, and keeps what was said.

    Args:
        model: who is asked.
        prompts: in which words.
        max_rounds: answers to one question before it is dropped.

    Attributes:
        seed: of the run: runs with other seeds get other answers to the same questions.
        log: of what was asked.
    """

    def __init__(self, model: LanguageModel, prompts: Prompts, max_rounds: int) -> None:
        self.model, self.prompts, self.max_rounds = model, prompts, max_rounds
        self.seed = 0
        self.log = ConversationLog()

    def open(self, folder: Path) -> None:
        """Keep everything in the run folder ``folder``."""
        self.model.open(folder / MODEL_FOLDER)
        self.log.open(folder / MODEL_FOLDER)

    def ask(self, ask: Ask[T]) -> tuple[T, ConversationRecord]:
        """A value that could be read, and the record of how it came about, which says that it was used.

        Raises:
            Dropped: no answer could be used; the record says why.
            BudgetSpent: asking might cost more than is left.
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
                record = self._record(ask, [*turns, TurnRecord(answer=digest, problems=[])], "")
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
