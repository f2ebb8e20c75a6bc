"""Interface of point encoders."""

from __future__ import annotations

from typing import Protocol

import torch


class PointEncoder(Protocol):
    """Encoder of normalized points (B, N, C), whose first three numbers are coordinates.

    It is a ``torch.nn.Module``, in pure PyTorch, and gives the same for any order of the points, but for that of
    states, which knows them by it.

    Attributes:
        tokens: K, pooled tokens a cloud.
        width: F, numbers a token.
        feature_width: G, numbers a point feature.
    """

    tokens: int
    width: int
    feature_width: int

    def __call__(self, points: torch.Tensor) -> torch.Tensor:
        """Return the pooled tokens (B, K, F)."""
        ...

    def with_features(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the pooled tokens (B, K, F) and a feature of each point (B, N, G), both with gradients."""
        ...
