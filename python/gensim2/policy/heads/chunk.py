"""Heads that regress a chunk with a mean absolute error: an MLP, or a transformer with one query for each step.

The transformer is the decoder of ACT, without ACT's latent variable.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch
from torch import nn

from gensim2.policy.heads.actions import ACTION
from gensim2.policy.heads.decoder import ActionHead, DecodingHead

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig
    from gensim2.policy.heads.protocol import Context


class TransformerHead(DecodingHead):
    """Transformer decoder with one learned query for each step of the chunk; queries attend to the trunk's tokens."""

    def loss(self, context: Context, batch: Mapping[str, torch.Tensor], generator: torch.Generator) -> torch.Tensor:
        return (self._chunks(context) - self.scale.normalized(batch[ACTION])).abs().mean()

    def act(self, context: Context, noise: torch.Tensor) -> torch.Tensor:
        return self.scale.restored(self._chunks(context))

    def _chunks(self, context: Context) -> torch.Tensor:
        tokens = context.tokens
        empty = tokens.new_zeros(len(tokens), *self.size)
        return self.decoder(empty, tokens.new_zeros(len(tokens)), tokens)


class ChunkHead(ActionHead):
    """MLP from the readout token to all actions of a chunk; arguments as for ``ActionHead``."""

    def __init__(self, config: PolicyConfig, arm: int, features: int = 0) -> None:
        super().__init__(config, arm, features)
        self.mlp = nn.Sequential(
            nn.Linear(config.width, config.hidden),
            nn.GELU(),
            nn.Linear(config.hidden, config.hidden),
            nn.GELU(),
            nn.Linear(config.hidden, self.size[0] * self.size[1]),
            nn.Unflatten(-1, self.size),
        )

    def loss(self, context: Context, batch: Mapping[str, torch.Tensor], generator: torch.Generator) -> torch.Tensor:
        return (self.mlp(context.tokens[:, 0]) - self.scale.normalized(batch[ACTION])).abs().mean()

    def act(self, context: Context, noise: torch.Tensor) -> torch.Tensor:
        return self.scale.restored(self.mlp(context.tokens[:, 0]))
