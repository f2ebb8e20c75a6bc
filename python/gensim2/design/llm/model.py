"""A model as the stages see it: a question in, an answer out, wherever it comes from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gensim2.design.llm.client import Client, estimated_tokens
from gensim2.design.llm.ledger import BudgetSpent, Ledger
from gensim2.design.llm.options import ModelOptions
from gensim2.design.llm.questions import Answer, Question
from gensim2.design.llm.store import AnswerStore, ModelRecord
from gensim2.errors import InputError


class Model:
    """Answers from what the run knows already, else from what others know, else from the model itself.

    Args:
        options: which model, and how it is asked.
        prompts: digest of the prompts, for the record.
        asking: what is asked for, for the record.
        cache: folder of answers that all runs share; None: there is none.
        record: folder that gets every answer of the run beside the run's own; None: there is none.
        replay: folder that all answers come from, and no model is asked; None: one is.

    Raises:
        InputError: the folder to replay from holds no record, or one of another model.
        MissingExtraError: the ``openai`` library is not installed.
    """

    def __init__(
        self,
        options: ModelOptions,
        prompts: str = "",
        asking: Mapping[str, Any] | None = None,
        *,
        cache: Path | None = None,
        record: Path | None = None,
        replay: Path | None = None,
    ) -> None:
        self.options = options
        self.ledger = Ledger(options.budget)
        self._replay = AnswerStore(replay) if replay is not None else None
        self._record = AnswerStore(record) if record is not None else None
        self._cache = AnswerStore(cache) if cache is not None and replay is None else None
        self._run: AnswerStore | None = None
        self._client = Client(options) if replay is None else None
        endpoint = self._client.endpoint if self._client is not None else None
        self._model_record = ModelRecord.of(options, prompts, asking or {}, endpoint)
        if self._record is not None:
            self._record.write_model(self._model_record)

    def open(self, folder: Path) -> None:
        """Keep answers in ``folder``, and take from there what an earlier call of the run has asked.

        Raises:
            InputError: that call asked another model, or for something else.
        """
        self._run = AnswerStore(folder)
        self._run.write_model(self._model_record)

    def close(self) -> None:
        """Give connections back."""
        if self._client is not None:
            self._client.close()

    def digest(self, question: Question) -> str:
        """Of a question to this model."""
        return question.digest(self.options.model, self.options.temperature, self.options.max_tokens)

    def answer(self, question: Question) -> Answer:
        """One answer.

        Raises:
            BudgetSpent: it might cost more than what is left.
            ModelError: the endpoint gives none.
            InputError: the endpoint refuses the question, or the record to replay does not have it.
        """
        digest = self.digest(question)
        known = self._known(digest, question)
        if known is not None:
            self.ledger.add(known, asked=False)
            self._keep(digest, question, known)
            return known
        max_cost = self._max_cost(question)
        try:
            self.ledger.reserve(max_cost)
        except BudgetSpent as error:
            for store in self._stores():
                store.put_spent(digest, question, str(error))
            raise
        try:
            assert self._client is not None
            answer = self._client.ask(question)
        finally:
            self.ledger.release(max_cost)
        self.ledger.add(answer, asked=True)
        self._keep(digest, question, answer)
        if self._cache is not None and answer.problem is None:
            self._cache.put(self._shared(question), question, answer)
        return answer

    def _shared(self, question: Question) -> str:
        """Digest of a question in the cache that all runs share."""
        assert self._client is not None
        return question.shared_digest(self._client.endpoint, self.options.structured, self.digest(question))

    def _known(self, digest: str, question: Question) -> Answer | None:
        if self._replay is not None:
            found = self._replay.get(digest)
            if found is None:
                what = f"holds no answer to this question of the stage {question.stage} ({question.subject})"
                remedy = "replay with the arguments, objects and prompts of the run that was recorded"
                raise InputError(what, file=self._replay.path, remedy=remedy)
            return found
        if self._run is not None:
            try:
                found = self._run.get(digest)
            except BudgetSpent:
                found = None  # of an earlier call, which may have had less to spend
            if found is not None:
                return found
        return self._cached(question)

    def _cached(self, question: Question) -> Answer | None:
        """Return the cached answer; an entry that cannot be read counts as missing and is replaced."""
        if self._cache is None:
            return None
        try:
            return self._cache.get(self._shared(question))
        except (InputError, BudgetSpent):
            return None

    def _keep(self, digest: str, question: Question, answer: Answer) -> None:
        for store in self._stores():
            store.put(digest, question, answer)

    def _stores(self) -> list[AnswerStore]:
        return [store for store in (self._run, self._record) if store is not None]

    def _max_cost(self, question: Question) -> float | None:
        """USD that a question may cost."""
        return self.options.priced(estimated_tokens(question), self.options.max_tokens)
