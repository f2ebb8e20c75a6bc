"""Questions to a model and its answers, as plain values."""

from __future__ import annotations

import hashlib
import json
import threading
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from gensim2.core.errors import GenSim2Error
from gensim2.design.pictures import LazyPicture


class BudgetSpent(GenSim2Error):
    """The next question might cost more than what is left of the budget."""


@dataclass(frozen=True)
class Account:
    """Sums over answers.

    Attributes:
        answers: how many.
        asked: how many of them were asked of the model, and not known before.
        retries: tries that failed.
        tokens_in, tokens_out: of questions and answers.
        counted: whether the endpoint counted all of them.
        cost: USD; None where no prices are known.
    """

    answers: int = 0
    asked: int = 0
    retries: int = 0
    tokens_in: int = 0
    tokens_out: int = 0
    counted: bool = True
    cost: float | None = 0.0

    def plus(self, answer: ModelAnswer, *, asked: bool) -> Account:
        """With one answer more."""
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
        """Plain data."""
        return asdict(self)


class Ledger:
    """Counts what answers cost. Threads may share it.

    Args:
        budget: USD; None: any amount.
    """

    def __init__(self, budget: float | None) -> None:
        self.budget = budget
        self.account = Account()
        self._reserved = 0.0
        self._lock = threading.Lock()

    def reserve(self, max_cost: float | None) -> None:
        """Reserve up to ``max_cost`` USD for the next request, until :meth:`settle`.

        Raises:
            BudgetSpent: the rest of the budget is smaller.
        """
        with self._lock:
            spent, max_cost = self.account.cost or 0.0, max_cost or 0.0
            if self.budget is not None and spent + self._reserved + max_cost > self.budget:
                raise BudgetSpent(
                    f"{spent:.4f} of {self.budget:g} USD are spent, and the next question might cost {max_cost:.4f}"
                )
            self._reserved += max_cost

    def release(self, max_cost: float | None) -> None:
        """Give back what was set aside."""
        with self._lock:
            self._reserved -= max_cost or 0.0

    def add(self, answer: ModelAnswer, *, asked: bool) -> None:
        """Count an answer; ``asked``: of the model, in this call."""
        with self._lock:
            self.account = self.account.plus(answer, asked=asked)


@dataclass(frozen=True)
class Message:
    """One message of a conversation."""

    role: Literal["system", "user", "assistant"]
    text: str
    pictures: tuple[LazyPicture, ...] = ()


@dataclass(frozen=True)
class ModelQuestion:
    """A conversation that waits for the model's answer.

    Attributes:
        stage: which prompt it is.
        subject: the task or class that it is about, for people.
        messages: so far.
        schema: JSON schema of the answer, for endpoints that keep to one.
        sample: tells equal questions apart that are to have answers of their own: the run's seed, the number of the
            proposal, the round of complaints.
    """

    stage: str
    subject: str
    messages: tuple[Message, ...]
    schema: dict[str, Any]
    sample: tuple[int, ...] = ()

    def digest(self, model: str, temperature: float | None, max_tokens: int) -> str:
        """Hex digest of what is asked: equal questions to one model at one endpoint, equal digests."""
        said = [[m.role, m.text, [picture.of for picture in m.pictures]] for m in self.messages]
        content = [model, temperature, max_tokens, self.stage, list(self.sample), said]
        return hashlib.sha256(json.dumps(content, ensure_ascii=False).encode("utf-8", "replace")).hexdigest()

    def shared_digest(self, endpoint: str, structured: str, digest: str) -> str:
        """Hex digest of all that the answer follows from, wherever it is asked; ``digest`` is that of the question."""
        content = [endpoint, structured, self.schema, digest]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def followed_by(self, answer: str, reply: str, round: int) -> ModelQuestion:
        """The question after an answer that was replied to; ``round`` tells it from one in which the same was said."""
        said = (Message("assistant", answer), Message("user", reply))
        return replace(self, messages=(*self.messages, *said), sample=(*self.sample, round))


@dataclass(frozen=True)
class ModelAnswer:
    """Answer of a model.

    Attributes:
        text: empty where the endpoint gave nothing that can be read.
        problem: what is wrong with it as a message, whatever it says; None: nothing.
        tokens_in, tokens_out: of question and answer.
        counted: whether the endpoint counted them; else they are estimated from the number of characters.
        retries: tries that failed before it.
        cost: USD; None where no prices are known.
    """

    text: str
    problem: str | None
    tokens_in: int
    tokens_out: int
    counted: bool
    retries: int
    cost: float | None
