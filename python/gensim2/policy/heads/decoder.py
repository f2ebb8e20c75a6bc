"""Decoder of action chunks: the token of each step attends to the tokens of all steps and of the trunk."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch
from torch import nn

from gensim2.policy.heads.actions import ACTION, EXTRA, ActionScale
from gensim2.policy.trunk import Block

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig
    from gensim2.policy.heads.protocol import Context


class ActionDecoder(nn.Module):  # type: ignore[misc]
    """Transformer that predicts a chunk from a noisy chunk and the noise level.

    Args:
        arm: m, number of the arm's joints.
    """

    def __init__(self, config: PolicyConfig, arm: int) -> None:
        super().__init__()
        self.width = config.width
        self.enter = nn.Linear(arm + EXTRA, config.width)
        self.level = nn.Sequential(
            nn.Linear(config.width, config.width), nn.GELU(), nn.Linear(config.width, config.width)
        )
        self.places = nn.Parameter(torch.randn(config.horizon, config.width) * 0.02)
        self.blocks = nn.ModuleList(
            Block(config.width, config.attention, memory=True) for _ in range(config.decoder_layers)
        )
        self.norm = nn.LayerNorm(config.width)
        self.leave = nn.Linear(config.width, arm + EXTRA)

    def forward(self, chunk: torch.Tensor, level: torch.Tensor, tokens: torch.Tensor) -> torch.Tensor:
        """Return the decoder's prediction (B, H, m + 2), in the format of a chunk.

        Args:
            chunk: (B, H, m + 2) noisy chunk, normalized.
            level: (B,) noise level from 0 (none) to 1.
            tokens: (B, S, D) tokens of the trunk.
        """
        found = self.enter(chunk) + self.places + self.level(sinusoids(level, self.width))[:, None]
        for block in self.blocks:
            found = block(found, tokens)
        return self.leave(self.norm(found))


def sinusoids(level: torch.Tensor, width: int) -> torch.Tensor:
    """Encode noise levels (B,), 0 to 1, as sines and cosines (B, width). Their periods are 2 pi / 1000 to 20 pi."""
    half = width // 2
    rates = torch.exp(torch.linspace(math.log(1000.0), math.log(0.1), half, device=level.device))
    angles = level[:, None] * rates
    return torch.cat([torch.sin(angles), torch.cos(angles)], -1)


class ActionHead(nn.Module):  # type: ignore[misc]
    """Base class of heads that predict chunks of normalized actions.

    Args:
        config: configuration of the policy.
        arm: m, number of the arm's joints.
        features: unused, because these heads need no features of the points.
    """

    wants_features = False
    noise: tuple[int, ...] = ()

    def __init__(self, config: PolicyConfig, arm: int, features: int = 0) -> None:
        super().__init__()
        self.size = (config.horizon, arm + EXTRA)
        self.scale = ActionScale(config.horizon, arm)

    def fit(self, batch: Mapping[str, torch.Tensor]) -> None:
        self.scale.fit(batch)


class DecodingHead(ActionHead):
    """Base class of heads whose decoder attends to the trunk's tokens; arguments as for ``ActionHead``."""

    def __init__(self, config: PolicyConfig, arm: int, features: int = 0) -> None:
        super().__init__(config, arm, features)
        self.decoder = ActionDecoder(config, arm)


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
