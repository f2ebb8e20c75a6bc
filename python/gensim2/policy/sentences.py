"""Encode the instruction of an episode, or a replacement for the instruction."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, get_args

import torch

from gensim2.core.errors import InputError
from gensim2.instructions import SentenceError, parse
from gensim2.policy.checkpoint import PolicyCheckpoint, unknown_sentence
from gensim2.policy.text import prepare

Unknown = Literal["parse", "embed"]
"""Handling of instructions that were not in the training data."""


def embeds(word: str) -> bool:
    """Return whether unknown instructions are encoded.

    Otherwise they are parsed to find a known one with the same steps.

    Args:
        word: value of the option ``unknown_sentences``.

    Raises:
        InputError: ``word`` is not one of :data:`Unknown`.
    """
    if word not in get_args(Unknown):
        raise InputError(f"must be one of {', '.join(get_args(Unknown))}, but is {word!r}", field="unknown_sentences")
    return word == "embed"


def taught_sentence(policy: PolicyCheckpoint, sentence: str, folder: Path) -> str:
    """Return the training instruction of a policy that has the same steps as an instruction in other words.

    Args:
        sentence: the instruction.
        folder: folder of the checkpoint, for error messages.

    Raises:
        CheckpointError: the instruction is not understood, or the policy was not trained on its steps.
    """
    if sentence in policy.sentences:
        return sentence
    try:
        wanted = parse(sentence)
    except SentenceError as error:
        raise unknown_sentence(policy, sentence, folder, str(error)) from error
    for taught in policy.sentences:
        with contextlib.suppress(SentenceError):
            if parse(taught) == wanted:
                return taught
    raise unknown_sentence(policy, sentence, folder, " and ".join(step.text for step in wanted))


def substitutes(says: Mapping[str, str] | None) -> Mapping[str, str]:
    """Check ``says``, a mapping from instructions to their replacements, and return it. None gives an empty mapping.

    Raises:
        InputError: ``says`` does not map strings to strings.
    """
    if says is None:
        return {}
    if not isinstance(says, Mapping) or not all(isinstance(each, str) for pair in says.items() for each in pair):
        raise InputError("must be a dictionary from instructions to the instructions that replace them", field="says")
    return says


def sentence_row(
    policy: PolicyCheckpoint, sentence: str, folder: Path, *, embed: bool, text_model: str | None = None
) -> torch.Tensor:
    """Return an encoded instruction (1, ...), from the checkpoint's table or from its text encoder.

    An action-chunk policy without a text encoder ignores the instruction, so it accepts any instruction.

    Args:
        sentence: the instruction.
        folder: folder of the checkpoint, for error messages.
        embed: whether to encode an instruction that the policy was not trained on.
        text_model: folder or Hugging Face name of the text encoder's weights, if they are not gensim2's default.

    Raises:
        CheckpointError: ``embed`` is false and the instruction is not understood or has steps without training. Or the
            weights are neither gensim2's default nor ``text_model``.
        InputError: the weights of the text encoder cannot be loaded.
    """
    looks_at_none = policy.config.text == "none" and policy.action.kind != "keypose"
    if sentence in policy.sentences or looks_at_none:
        return policy.row_of(sentence, folder)
    if not embed:
        return policy.row_of(taught_sentence(policy, sentence, folder), folder)
    policy.require_text_model(text_model, folder)
    return prepare([sentence], policy.config)
