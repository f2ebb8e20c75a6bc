"""Define questions to a language model, its answers, and the cost of answers."""

from __future__ import annotations

import hashlib
import json
import threading
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from gensim2.core.errors import GenSim2Error
from gensim2.design.pictures import LazyPicture


class BudgetSpent(GenSim2Error):
    """The next question might cost more than the remaining budget."""


@dataclass(frozen=True)
class Account:
    """Number, tokens and cost of a model's answers.

    Attributes:
        asked: number of answers that the endpoint gave during this run. All other answers were read from a record.
        retries: number of requests that failed and were repeated.
        tokens_in, tokens_out: number of tokens in questions and in answers.
        counted: whether the endpoint reported all token counts; otherwise some counts are estimates.
        cost: total cost in USD; None if the prices are unknown.
    """

    answers: int = 0
    asked: int = 0
    retries: int = 0
    tokens_in: int = 0
    tokens_out: int = 0
    counted: bool = True
    cost: float | None = 0.0

    def plus(self, answer: ModelAnswer, *, asked: bool) -> Account:
        """Return the totals including one more answer."""
        cost = None if self.cost is None or answer.cost is None else self.cost + answer.cost
        return Account(
            self.answers + 1,
            self.asked + asked,
            self.retries + answer.retries,
            self.tokens_in + answer.tokens_in,
            self.tokens_out + answer.tokens_out,
            self.counted and answer.counted,
            cost,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON."""
        return asdict(self)


class Ledger:
    """Counts the cost of answers and enforces a budget. Threads may share one ledger.

    Args:
        budget: maximum USD; None: no limit.
    """

    def __init__(self, budget: float | None) -> None:
        self.budget = budget
        self.account = Account()
        self._reserved = 0.0
        self._lock = threading.Lock()

    def reserve(self, max_cost: float | None) -> None:
        """Reserve up to ``max_cost`` USD of the budget for the next question, until :meth:`release`.

        Raises:
            BudgetSpent: the remaining budget is smaller.
        """
        with self._lock:
            spent, max_cost = self.account.cost or 0.0, max_cost or 0.0
            if self.budget is not None and spent + self._reserved + max_cost > self.budget:
                wrong = f"{spent:.4f} of {self.budget:g} USD are spent, and the next question might cost {max_cost:.4f}"
                raise BudgetSpent(wrong)
            self._reserved += max_cost

    def release(self, max_cost: float | None) -> None:
        """Release a reservation of ``max_cost`` USD."""
        with self._lock:
            self._reserved -= max_cost or 0.0

    def add(self, answer: ModelAnswer, *, asked: bool) -> None:
        """Count an answer; ``asked`` says that the endpoint gave the answer in this call."""
        with self._lock:
            self.account = self.account.plus(answer, asked=asked)


@dataclass(frozen=True)
class Message:
    """A message of a conversation."""

    role: Literal["system", "user", "assistant"]
    text: str
    pictures: tuple[LazyPicture, ...] = ()


@dataclass(frozen=True)
class ModelQuestion:
    """Question to the model: a conversation whose last message needs an answer.

    Attributes:
        subject: task or class that the question is about, for readers of the record.
        messages: messages so far.
        schema: JSON schema of the answer, for endpoints that support one.
        sample: numbers that distinguish questions with the same text, such as seed, proposal and round.
    """

    stage: str
    subject: str
    messages: tuple[Message, ...]
    schema: dict[str, Any]
    sample: tuple[int, ...] = ()

    def digest(self, model: str, temperature: float | None, max_tokens: int) -> str:
        """Return the digest (hex) of the question and the model's settings. The answer is stored under this digest."""
        said = [[m.role, m.text, [picture.of for picture in m.pictures]] for m in self.messages]
        content = [model, temperature, max_tokens, self.stage, list(self.sample), said]
        return hashlib.sha256(json.dumps(content, ensure_ascii=False).encode("utf-8", "replace")).hexdigest()

    def shared_digest(self, endpoint: str, structured: str, digest: str) -> str:
        """Return the digest (hex) of all inputs that determine the answer. It is the key of the cache that runs share.

        The digest covers the question, the model settings (``digest``), the address, the JSON schema, and the setting
        of structured answers.
        """
        content = [endpoint, structured, self.schema, digest]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def followed_by(self, answer: str, reply: str, round: int) -> ModelQuestion:
        """Return the question with ``answer`` and ``reply`` appended; ``round`` makes its digest unique."""
        said = (Message("assistant", answer), Message("user", reply))
        return replace(self, messages=(*self.messages, *said), sample=(*self.sample, round))


@dataclass(frozen=True)
class ModelAnswer:
    """Answer of a model.

    Attributes:
        text: text of the answer; empty if the reply is unreadable.
        problem: fault of the reply, for example truncation; None if the reply has no fault.
        tokens_in, tokens_out: tokens of question and answer.
        counted: whether the endpoint reported the number of tokens; otherwise it is estimated from the text's length.
        retries: number of failed attempts before the answer.
        cost: total cost in USD; None if the prices are unknown.
    """

    text: str
    problem: str | None
    tokens_in: int
    tokens_out: int
    counted: bool
    retries: int
    cost: float | None
