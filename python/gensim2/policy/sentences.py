"""Sentences of an episode: the task's own or a replacement, as a row for the policy's text encoder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, get_args

import torch

from gensim2.core.errors import InputError
from gensim2.policy.checkpoint import PolicyCheckpoint, unknown_sentence
from gensim2.policy.text import prepare

Unknown = Literal["refuse", "embed"]
"""Handling of a sentence that was not trained on."""


def embeds(word: str) -> bool:
    """Whether unknown sentences are embedded.

    Raises:
        InputError: the word is none of :data:`Unknown`.
    """
    if word not in get_args(Unknown):
        raise InputError(f"must be one of {', '.join(get_args(Unknown))}, is {word!r}", field="unknown_sentences")
    return word == "embed"


def substitutes(says: Mapping[str, str] | None) -> Mapping[str, str]:
    """Return sentences by the ones that they replace; none where ``says`` is None.

    Raises:
        InputError: it is something else than sentences by sentences.
    """
    if says is None:
        return {}
    if not isinstance(says, Mapping) or not all(isinstance(each, str) for pair in says.items() for each in pair):
        raise InputError("must give sentences by sentences", field="says")
    return says


def sentence_row(
    policy: PolicyCheckpoint, sentence: str, folder: Path, *, embed: bool, text_model: str | None = None
) -> torch.Tensor:
    """The row (1, ...) of a sentence: of the checkpoint's table, else by its text encoder.

    Action chunks that look at no sentence take any. Keyposes do not: their classes are of tasks.

    Args:
        policy: its checkpoint.
        sentence: what it is told.
        folder: of the checkpoint, for errors.
        embed: whether a sentence that was not trained on is embedded.
        text_model: weights of the text encoder that the user gave, where gensim2 does not name them itself.

    Raises:
        CheckpointError: it was not trained on, and is not to be embedded, or the checkpoint alone names the encoder.
        InputError: the weights of the text encoder cannot be had.
    """
    looks_at_none = policy.config.text == "none" and policy.action.kind != "keypose"
    if sentence in policy.sentences or looks_at_none:
        return policy.row_of(sentence, folder)
    if not embed:
        raise unknown_sentence(policy, sentence, folder)
    policy.require_text_model(text_model, folder)
    return prepare([sentence], policy.config)
