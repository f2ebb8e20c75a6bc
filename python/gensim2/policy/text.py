"""Encode an instruction as one token, an input vector of the policy's transformer (:mod:`gensim2.policy.trunk`).

:func:`prepare` converts instructions to the rows of a table without gradients. A module that is trained with the policy
converts a row to a token. A checkpoint stores the rows of its instructions, so pretrained weights are needed only for
new instructions.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import nn

from gensim2.core.errors import InputError
from gensim2.core.foreign.tensors import Shape
from gensim2.policy.pretrained_text import embeddings

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig

MAX_EMBEDDING = 16_384
"""Maximum length of an embedding; CLIP's embeddings have 512 numbers."""
WORDS, PIECES, BUCKETS = 24, 12, 2048
"""Limits of the small encoder: words in an instruction, pieces (the word and trigrams) of a word, and hash buckets."""


def prepare(sentences: Sequence[str], config: PolicyConfig) -> torch.Tensor:
    """Return the encoded instructions, one row for each of S sentences.

    Returns:
        For the encoder ``small``: (S, 24, 12) indices of words and trigrams. For ``clip`` and ``sentence``: (S, E)
        embeddings. For ``none``: an empty array (S, 0).

    Raises:
        InputError: the weights cannot be loaded; the message names the folder and a remedy.
        MissingExtraError: ``transformers`` is not installed.
    """
    if config.text == "none":
        return torch.zeros(len(sentences), 0)
    if config.text == "small":
        return torch.stack([pieces(sentence) for sentence in sentences])
    return embeddings(sentences, config.text, config.text_model)


def table_shape(config: PolicyConfig, sentences: int, found: Shape | None) -> Shape:
    """Return the shape of the table that :func:`prepare` returns for a policy.

    Args:
        sentences: S, number of instructions.
        found: shape of the table of a checkpoint, for pretrained encoders. Their length is not in the config.
    """
    if config.text == "small":
        return Shape("I64", (sentences, WORDS, PIECES))
    if config.text == "none":
        return Shape("F32", (sentences, 0))
    length = found.shape[-1] if found is not None and found.shape else 1
    return Shape("F32", (sentences, min(max(length, 1), MAX_EMBEDDING)))


def check_table(table: torch.Tensor, config: PolicyConfig, file: Path) -> None:
    """Check that the small encoder has weights for all indices in a table.

    Raises:
        InputError: an index is out of range; the message names the file.
    """
    if config.text == "small" and not bool(((table >= 0) & (table < BUCKETS)).all()):
        wrong = f"all indices in the table of sentences must lie in 0..{BUCKETS - 1}"
        raise InputError(wrong, file=file, field="sentences", remedy="train again")


def make_text_encoder(config: PolicyConfig, row: Sequence[int]) -> nn.Module | None:
    """Return the module that turns table rows into tokens (B, width); None if the policy ignores instructions.

    Args:
        row: shape of a row of the table.
    """
    if config.text == "none":
        return None
    if config.text == "small":
        return SmallText(config.width)
    return nn.Sequential(nn.LayerNorm(row[0]), nn.Linear(row[0], config.width))


def pieces(sentence: str) -> torch.Tensor:
    """Return hashed indices (24, 12) of a sentence's words and of the words' trigrams, padded with 0.

    Unknown words share trigrams with known words, for example "opened" with "open".
    """
    found = torch.zeros(WORDS, PIECES, dtype=torch.int64)
    words = "".join(c if c.isalnum() else " " for c in sentence.lower()).split()
    for row, word in enumerate(words[:WORDS]):
        marked = f"<{word}>"
        parts = [marked, *(marked[i : i + 3] for i in range(len(marked) - 2))]
        for column, part in enumerate(parts[:PIECES]):
            digest = hashlib.blake2b(part.encode(), digest_size=4).digest()
            found[row, column] = 1 + int.from_bytes(digest, "little") % (BUCKETS - 1)
    return found


class SmallText(nn.Module):  # type: ignore[misc]
    """Text encoder with learned embeddings of words and trigrams, trained with the policy.

    The embeddings of a word and of its trigrams are averaged. An MLP gets the mean and the maximum over the words. The
    embedding of a new word is meaningless, but the word may share trigrams with known words. With tokens of size 192
    there are about 200,000 parameters.

    Args:
        width: size of the token.
    """

    def __init__(self, width: int, inner: int = 64) -> None:
        super().__init__()
        self.pieces = nn.Embedding(BUCKETS, inner, padding_idx=0)
        self.places = nn.Parameter(torch.randn(WORDS, inner) * 0.02)
        self.word = nn.Sequential(nn.Linear(inner, inner), nn.GELU())
        self.sentence = nn.Sequential(nn.Linear(2 * inner, width), nn.GELU(), nn.Linear(width, width))

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return tokens (B, width) of pieces (B, 24, 12)."""
        known = (rows > 0).to(self.places.dtype)
        count = known.sum(-1, keepdim=True)
        words = self.word(self.pieces(rows).sum(-2) / count.clamp(min=1.0) + self.places)
        there = (count > 0).to(words.dtype)
        mean = (words * there).sum(1) / there.sum(1).clamp(min=1.0)
        most = (words * there + (there - 1.0) * 1e4).amax(1) * there.amax(1)
        return self.sentence(torch.cat([mean, most], -1))
