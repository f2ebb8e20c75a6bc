"""Fourier features of positions: what a network needs to tell places apart by less than their range."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch


def fourier_features(positions: torch.Tensor, bands: Sequence[float]) -> list[torch.Tensor]:
    """Return the sine and the cosine of positions (..., 3), m, for each of the bands, 1/m."""
    angles = [2 * math.pi * band * positions for band in bands]
    return [wave(each) for each in angles for wave in (torch.sin, torch.cos)]
