"""A model as the stages see it: a question in, an answer out, wherever it comes from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gensim2.core.errors import InputError
from gensim2.design.llm.client import Client, estimated_tokens
from gensim2.design.llm.options import ModelOptions
from gensim2.design.llm.questions import BudgetSpent, Ledger, ModelAnswer, ModelQuestion
from gensim2.design.llm.store import NO_ANSWER, AnswerStore, ModelRecord


class LanguageModel:
    """Answers from the run's store, else from the cache of all runs, else from the model itself.

    Args:
        options: which model, and how it is asked.
        prompts: digest of the prompts, for the record.
        asking: what is asked for, for the record.
        cache: folder of answers that all runs share; None: there is none.
        replay: folder of a run's answers, which are used in place of a model; None: the model is asked.

    Raises:
        MissingExtraError: the ``openai`` library is not installed.
    """

    def __init__(
        self,
        options: ModelOptions,
        prompts: str = "",
        asking: Mapping[str, Any] | None = None,
        *,
        cache: Path | None = None,
        replay: Path | None = None,
    ) -> None:
        self.options = options
        self.ledger = Ledger(options.budget)
        self._replay = replay
        self._store = AnswerStore(replay, None if replay is not None else cache)
        self._client = Client(options) if replay is None else None
        endpoint = self._client.endpoint if self._client is not None else None
        self._record = ModelRecord.of(options, prompts, asking or {}, endpoint)

    def open(self, folder: Path) -> None:
        """Keep answers in ``folder``, and use those that an earlier call of the run kept there.

        Raises:
            InputError: that call asked another model, or for something else.
        """
        self._store = AnswerStore(folder, self._store.cache)
        self._store.write_model(self._record)
        if self._replay is not None:
            self._store.copy(self._replay)

    def close(self) -> None:
        """Give connections back."""
        if self._client is not None:
            self._client.close()

    def digest(self, question: ModelQuestion) -> str:
        """Of a question to this model."""
        return question.digest(self.options.model, self.options.temperature, self.options.max_tokens)

    def answer(self, question: ModelQuestion) -> ModelAnswer:
        """One answer.

        Raises:
            BudgetSpent: it might cost more than what is left.
            ModelError: the endpoint gives none.
            InputError: the endpoint refuses the question, or the record to replay does not have it.
        """
        digest = self.digest(question)
        if self._client is None:
            answer = self._recorded(digest, question)
            self.ledger.add(answer, asked=False)
            return answer
        shared = question.shared_digest(self._client.endpoint, self.options.structured, digest)
        known = self._store.record(digest, shared)
        if known is not None and known.spent is None:  # an earlier call may have had less to spend
            self.ledger.add(known.answer, asked=False)
            self._store.put(digest, question, known.answer)
            return known.answer
        max_cost = self._max_cost(question)
        try:
            self.ledger.reserve(max_cost)
        except BudgetSpent as error:
            self._store.put(digest, question, NO_ANSWER, spent=str(error))
            raise
        try:
            answer = self._client.ask(question)
        finally:
            self.ledger.release(max_cost)
        self.ledger.add(answer, asked=True)
        self._store.put(digest, question, answer, shared if answer.problem is None else None)
        return answer

    def _recorded(self, digest: str, question: ModelQuestion) -> ModelAnswer:
        found = self._store.record(digest)
        if found is None:
            what = f"holds no answer to this question of the stage {question.stage} ({question.subject})"
            remedy = "replay with the arguments, objects and prompts of the run that was recorded"
            raise InputError(what, file=self._replay, remedy=remedy)
        return found.answer

    def _max_cost(self, question: ModelQuestion) -> float | None:
        """USD that a question may cost."""
        return self.options.priced(estimated_tokens(question), self.options.max_tokens)
