"""PointNeXt (Qian et al. 2022) in pure PyTorch, PointNeXt-S by default."""

from __future__ import annotations

import torch
from torch import nn

from gensim2.policy.encoders.grouping import ball_query, farthest_points, gathered, interpolated
from gensim2.policy.encoders.pointnet import Shared

NEIGHBORS = 32
RADIUS = 0.3
"""Radius of the first stage, in normalized coordinates with standard deviation 1; it grows 1.5 times at each stage."""
WIDTHS = (64, 128, 256, 512)
STRIDES = (2, 2, 2, 2)


class SetAbstraction(nn.Module):  # type: ignore[misc]
    """Layer that reduces a cloud (set abstraction).

    The layer samples centres, applies an MLP to their neighbours and takes the maximum over the neighbours. A residual
    connection passes the features of the centres.

    Args:
        inner, outer: number of features of an input point, and number of features of a centre in the output.
        stride: ratio of the number of points to the number of centres.
        radius: radius around a centre within which points are neighbours, in normalized coordinates.
    """

    def __init__(self, inner: int, outer: int, stride: int, radius: float) -> None:
        super().__init__()
        self.stride, self.radius = stride, radius
        self.mlp = nn.Sequential(Shared(inner + 3, outer), Shared(outer, outer, active=False))
        self.skip = nn.Linear(inner, outer)

    def forward(self, xyz: torch.Tensor, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Sample M centres and pool the features of their neighbours.

        Args:
            xyz: (B, N, 3) points, normalized.
            features: (B, N, inner) features of the points.

        Returns:
            Centres (B, M, 3) and their features (B, M, outer).
        """
        chosen = farthest_points(xyz, max(1, xyz.shape[1] // self.stride))
        centers = gathered(xyz, chosen)
        rows = ball_query(xyz, centers, self.radius, NEIGHBORS)
        relative = (gathered(xyz, rows) - centers[:, :, None]) / self.radius
        found = self.mlp(torch.cat([relative, gathered(features, rows)], -1)).amax(2)
        return centers, torch.relu(found + self.skip(gathered(features, chosen)))


class InvertedResidual(nn.Module):  # type: ignore[misc]
    """InvResMLP block.

    The block takes a maximum over neighbours, and has an MLP that is four times as wide inside and a residual
    connection.

    Args:
        width: number of features.
        radius: radius of the balls, in normalized coordinates.
    """

    def __init__(self, width: int, radius: float) -> None:
        super().__init__()
        self.radius = radius
        self.local = Shared(width + 3, width)
        self.point = nn.Sequential(Shared(width, 4 * width), Shared(4 * width, width, active=False))

    def forward(self, xyz: torch.Tensor, features: torch.Tensor) -> torch.Tensor:
        rows = ball_query(xyz, xyz, self.radius, NEIGHBORS)
        relative = (gathered(xyz, rows) - xyz[:, :, None]) / self.radius
        found = self.local(torch.cat([relative, gathered(features, rows)], -1)).amax(2)
        return torch.relu(features + self.point(found))


class PointNextEncoder(nn.Module):  # type: ignore[misc]
    """PointNeXt encoder.

    The encoder has 32 linear features for each point and four stages. Each stage has fewer points and twice as many
    features. A maximum over the points follows.

    Args:
        channels: C, number of channels of a point.
        blocks: number of inverted residual blocks of each stage: 0 for PointNeXt-S, and more for B, L and XL.
    """

    tokens, width, feature_width = 1, 512, 32 + 512

    def __init__(self, channels: int, blocks: int = 0) -> None:
        super().__init__()
        self.stem = nn.Linear(channels, 32)
        self.stages, self.blocks = nn.ModuleList(), nn.ModuleList()
        inner, radius = 32, RADIUS
        for outer, stride in zip(WIDTHS, STRIDES, strict=True):
            self.stages.append(SetAbstraction(inner, outer, stride, radius))
            radius *= 1.5
            self.blocks.append(nn.ModuleList(InvertedResidual(outer, radius) for _ in range(blocks)))
            inner = outer
        self.last = nn.Sequential(Shared(inner + 3, inner), Shared(inner, self.width, active=False))

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return the pooled token (B, 1, 512)."""
        return self._run(points)[0]

    def with_features(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the token (B, 1, 512) and features (B, N, 544).

        A point's features are those of the first layer, followed by interpolated features of the last layer.
        """
        pooled, stem, centers, deep = self._run(points)
        return pooled, torch.cat([stem, interpolated(points[..., :3], centers, deep)], -1)

    def _run(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        stem = self.stem(points)
        xyz, features = points[..., :3], stem
        for stage, blocks in zip(self.stages, self.blocks, strict=True):
            xyz, features = stage(xyz, features)
            for block in blocks:
                features = block(xyz, features)
        found = self.last(torch.cat([xyz, features], -1)).amax(1, keepdim=True)
        return found, stem, xyz, features
