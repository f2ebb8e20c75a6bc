"""Get answers of a language model from the run's records, from a cache shared by runs, or from the endpoint."""

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
    """Source of answers: first the run's records, then the cache shared by all runs, then the model's endpoint.

    Args:
        options: model and request settings.
        prompts: digest of the prompt templates, for the record.
        asking: settings of the requested designs, for the record.
        cache: folder of answers shared by all runs, or None.
        replay: folder with recorded answers to use instead of the endpoint; None: query the endpoint.

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
        """Store answers in ``folder``, and reuse the answers of earlier calls of the run.

        Raises:
            InputError: an earlier call of the run used another model or other settings.
        """
        self._store = AnswerStore(folder, self._store.cache)
        self._store.write_model(self._record)
        if self._replay is not None:
            self._store.copy(self._replay)

    def close(self) -> None:
        """Close the connections."""
        if self._client is not None:
            self._client.close()

    def digest(self, question: ModelQuestion) -> str:
        """Return the digest of a question to this model."""
        return question.digest(self.options.model, self.options.temperature, self.options.max_tokens)

    def answer(self, question: ModelQuestion) -> ModelAnswer:
        """Return the answer to a question.

        Raises:
            BudgetSpent: the question might cost more than the remaining budget.
            ModelError: the endpoint gives no answer.
            InputError: the endpoint refuses the question, or the replayed record has no answer to the question.
        """
        digest = self.digest(question)
        if self._client is None:
            answer = self._recorded(digest, question)
            self.ledger.add(answer, asked=False)
            return answer
        shared = question.shared_digest(self._client.endpoint, self.options.structured, digest)
        known = self._store.record(digest, shared)
        # Ask a question that an earlier call left out because its budget was spent (``spent``). The budget of this call
        # may be higher.
        if known is not None and known.spent is None:
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
        return self.options.priced(estimated_tokens(question), self.options.max_tokens)
