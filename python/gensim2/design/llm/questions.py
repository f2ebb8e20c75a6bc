"""Questions to a model and its answers, as plain values."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from typing import Any, Literal

from gensim2.design.pictures import LazyPicture


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
