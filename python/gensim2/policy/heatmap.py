"""Predict places, such as the place where the hand acts, with heatmaps over the points of a cloud.

The predicted position is a mean over all points, which are shifted by predicted offsets. The heatmap gives their
weights.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

WIDTH = 0.02
"""Standard deviation (m) of the target heatmap around a place."""
OFFSET = 0.1
"""Length (m) of a predicted offset of 1."""


def fourier_features(positions: torch.Tensor, bands: Sequence[float]) -> list[torch.Tensor]:
    """Return sines and cosines of positions (..., 3), m, at each of the frequencies ``bands``, 1/m."""
    angles = [2 * math.pi * band * positions for band in bands]
    return [wave(each) for each in angles for wave in (torch.sin, torch.cos)]


def places_of(points: torch.Tensor, logits: torch.Tensor, offsets: torch.Tensor) -> torch.Tensor:
    r"""Return the places :math:`p = \sum_i w_i (x_i + o_i)` of K heatmaps, (B, K, 3), m.

    Args:
        points: (B, N, 3) points of the clouds, m.
        logits: (B, N, K) logits of the weights :math:`w`.
        offsets: (B, N, K, 3) offsets :math:`o`, in units of ``OFFSET``.
    """
    return (logits.softmax(1)[..., None] * (points[:, :, None] + OFFSET * offsets)).sum(1)


def heat_loss(points: torch.Tensor, logits: torch.Tensor, places: torch.Tensor) -> torch.Tensor:
    """Return the cross-entropy (B, K) of heatmaps against Gaussians around ``places``.

    Args:
        points: (B, N, 3) points of the clouds, m.
        logits: (B, N, K) logits of the heatmaps.
        places: (B, K, 3) true places, m.
    """
    away = (points[:, :, None] - places[:, None]).square().sum(-1)
    hot = (-away / (2 * WIDTH**2)).softmax(1)
    return -(hot * logits.log_softmax(1)).sum(1)
