"""Chunk head: an MLP on the readout, and the mean absolute error."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch
from torch import nn

from gensim2.policy.heads.actions import ACTION, EXTRA, ActionScale

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig
    from gensim2.policy.heads.protocol import Context


class ChunkHead(nn.Module):  # type: ignore[misc]
    """MLP from the readout to all actions of a chunk at once.

    Args:
        config: of the policy.
        arm: m, number of the arm's joints.
    """

    wants_features = False
    noise: tuple[int, ...] = ()

    def __init__(self, config: PolicyConfig, arm: int, features: int = 0) -> None:
        super().__init__()
        self.scale = ActionScale(config.horizon, arm)
        size = (config.horizon, arm + EXTRA)
        self.mlp = nn.Sequential(
            nn.Linear(config.width, config.hidden),
            nn.GELU(),
            nn.Linear(config.hidden, config.hidden),
            nn.GELU(),
            nn.Linear(config.hidden, size[0] * size[1]),
            nn.Unflatten(-1, size),
        )

    def fit(self, batch: Mapping[str, torch.Tensor]) -> None:
        """Set the scale of actions."""
        self.scale.fit(batch)

    def loss(self, context: Context, batch: Mapping[str, torch.Tensor], generator: torch.Generator) -> torch.Tensor:
        """Return the mean absolute error of normalized chunks."""
        return (self.mlp(context.tokens[:, 0]) - self.scale.normalized(batch[ACTION])).abs().mean()

    def act(self, context: Context, noise: torch.Tensor) -> torch.Tensor:
        """Return chunks (B, H, m + 2)."""
        return self.scale.restored(self.mlp(context.tokens[:, 0]))
