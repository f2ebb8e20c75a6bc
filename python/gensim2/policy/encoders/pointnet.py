"""PointNet (Qi et al. 2017): an input transform, a shared MLP with batch normalization, and a maximum."""

from __future__ import annotations

import torch
from torch import nn


class Shared(nn.Module):  # type: ignore[misc]
    """Linear layer, followed by batch normalization over all points of all clouds and optionally by a ReLU."""

    def __init__(self, inner: int, outer: int, *, active: bool = True) -> None:
        super().__init__()
        self.linear = nn.Linear(inner, outer, bias=False)
        self.norm = nn.BatchNorm1d(outer)
        self.active = active

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        found = self.linear(values)
        found = self.norm(found.reshape(-1, found.shape[-1])).reshape(found.shape)
        return torch.relu(found) if self.active else found


class Transform(nn.Module):  # type: ignore[misc]
    """T-Net, which predicts a 3 x 3 matrix for each cloud. The matrix is the identity before training."""

    def __init__(self) -> None:
        super().__init__()
        self.points = nn.Sequential(Shared(3, 64), Shared(64, 128), Shared(128, 256))
        self.matrix = nn.Linear(256, 9)
        nn.init.zeros_(self.matrix.weight)
        nn.init.zeros_(self.matrix.bias)

    def forward(self, xyz: torch.Tensor) -> torch.Tensor:
        """Return the matrices (B, 3, 3) for coordinates (B, N, 3)."""
        matrix = self.matrix(self.points(xyz).amax(1)).unflatten(-1, (3, 3))
        return matrix + torch.eye(3, device=xyz.device, dtype=xyz.dtype)


class PointNetEncoder(nn.Module):  # type: ignore[misc]
    """PointNet without the feature transform. A point's feature is its local feature followed by the cloud's feature.

    Args:
        channels: C, number of channels of a point.
    """

    tokens, width, feature_width = 1, 512, 64 + 512

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.transform = Transform()
        self.local = nn.Sequential(Shared(channels, 64), Shared(64, 64))
        self.deep = nn.Sequential(Shared(64, 128), Shared(128, self.width, active=False))

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return the pooled token (B, 1, 512)."""
        return self._run(points)[0]

    def with_features(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the pooled token (B, 1, 512) and the features (B, N, 576)."""
        pooled, local = self._run(points)
        return pooled, torch.cat([local, pooled.expand(-1, points.shape[1], -1)], -1)

    def _run(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        xyz = points[..., :3] @ self.transform(points[..., :3])
        local = self.local(torch.cat([xyz, points[..., 3:]], -1))
        return self.deep(local).amax(1, keepdim=True), local
