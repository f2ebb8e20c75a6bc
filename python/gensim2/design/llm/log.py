"""Log of questions and their outcomes, on disk: ``conversations.json`` in the run's ``model`` folder."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from gensim2.core.files import write_json
from gensim2.core.record_files import read_record

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
