"""Define the interface of point encoders."""

from __future__ import annotations

from typing import Protocol

import torch


class PointEncoder(Protocol):
    """Encoder of normalized points (B, N, C), whose first three channels are coordinates.

    Encoders are PyTorch modules. Only the result of :class:`StateEncoder` depends on the order of the points.

    Attributes:
        tokens: K, number of pooled tokens of a cloud.
        width: F, size of a token.
        feature_width: G, size of a point's feature.
    """

    tokens: int
    width: int
    feature_width: int

    def __call__(self, points: torch.Tensor) -> torch.Tensor:
        """Return the pooled tokens (B, K, F)."""
        ...

    def with_features(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the pooled tokens (B, K, F) and the features of the points (B, N, G). Gradients flow through both
        results.
        """
        ...
