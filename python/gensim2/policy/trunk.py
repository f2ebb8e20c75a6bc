"""Define the policy's transformer, which normalizes inside each residual branch (pre-LN).

The input tokens are a learned readout token, the instruction, and the point cloud and robot state of each observed
step. The output of the readout token represents the whole observation.
"""

from __future__ import annotations

import torch
from torch import nn


class Attention(nn.Module):  # type: ignore[misc]
    """Multi-head attention.

    Args:
        width: D, size of the tokens.
        heads: number of heads.
    """

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)

    def forward(self, tokens: torch.Tensor, memory: torch.Tensor) -> torch.Tensor:
        """Return the result (B, S, D) of attention from tokens (B, S, D) to memory (B, M, D)."""
        query = self._split(self.query(tokens))
        key, value = (self._split(each) for each in self.key_value(memory).chunk(2, -1))
        seen = nn.functional.scaled_dot_product_attention(query, key, value)
        return self.out(seen.transpose(1, 2).flatten(2))

    def _split(self, tokens: torch.Tensor) -> torch.Tensor:
        return tokens.unflatten(-1, (self.heads, -1)).transpose(1, 2)


class Block(nn.Module):  # type: ignore[misc]
    """Pre-LN block: self-attention, optional cross-attention to a second sequence of tokens, and an MLP.

    Args:
        width, heads: as for :class:`Attention`.
        memory: whether the block also attends to a second sequence of tokens.
    """

    def __init__(self, width: int, heads: int, *, memory: bool = False) -> None:
        super().__init__()
        self.norm_self, self.attend_self = nn.LayerNorm(width), Attention(width, heads)
        self.norm_memory = nn.LayerNorm(width) if memory else None
        self.attend_memory = Attention(width, heads) if memory else None
        self.mlp = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width)
        )

    def forward(self, tokens: torch.Tensor, memory: torch.Tensor | None = None) -> torch.Tensor:
        normal = self.norm_self(tokens)
        tokens = tokens + self.attend_self(normal, normal)
        if self.norm_memory is not None and self.attend_memory is not None:
            tokens = tokens + self.attend_memory(self.norm_memory(tokens), memory)
        return tokens + self.mlp(tokens)


class Trunk(nn.Module):  # type: ignore[misc]
    """Transformer over all tokens.

    Args:
        width: D, size of the tokens.
        layers: number of blocks; 0 leaves the tokens unchanged.
        heads: number of attention heads.
        places: S, number of tokens, including the readout token.
    """

    def __init__(self, width: int, layers: int, heads: int, places: int) -> None:
        super().__init__()
        self.readout = nn.Parameter(torch.randn(1, 1, width) * 0.02)
        self.places = nn.Parameter(torch.randn(places, width) * 0.02)
        self.blocks = nn.ModuleList(Block(width, heads) for _ in range(layers))
        self.norm = nn.LayerNorm(width)

    def forward(self, tokens: torch.Tensor) -> torch.Tensor:
        """Prepend the readout token to tokens (B, S - 1, D). Return the output tokens of the transformer (B, S, D)."""
        tokens = torch.cat([self.readout.expand(len(tokens), -1, -1), tokens], 1) + self.places
        for block in self.blocks:
            tokens = block(tokens)
        return self.norm(tokens)
