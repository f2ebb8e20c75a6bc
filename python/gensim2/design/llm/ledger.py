"""Ledger of a run's questions: their cost, and whether the budget allows the next one."""

from __future__ import annotations

import threading
from dataclasses import asdict, dataclass
from typing import Any

from gensim2.core.errors import GenSim2Error
from gensim2.design.llm.questions import ModelAnswer


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
