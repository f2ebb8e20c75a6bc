"""The whole network: encoders, trunk and head behind one configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import torch
from torch import nn

from gensim2.policy.encoders import make_encoder
from gensim2.policy.encoders.grouping import farthest_points, gathered
from gensim2.policy.frames import cloud_size, proprio_size
from gensim2.policy.heads import Context, make_head
from gensim2.policy.text import make_text_encoder
from gensim2.policy.trunk import Trunk

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig

CLOUD, PROPRIO, TEXT = "cloud", "proprio", "text"
"""Names of a batch's inputs: (B, T, N, C), (B, T, P) (:class:`~gensim2.policy.frames.Inputs`), and rows of the table of
sentences (B, ...)."""

SMALLEST = 1e-2
"""Smallest scale of proprioception, rad or m."""


class PolicyNetwork(nn.Module):  # type: ignore[misc]
    """Network of a policy.

    Args:
        config: its architecture.
        arm: m, number of the arm's joints.
        row: shape of a row of the table of sentences (:func:`~gensim2.policy.text.prepare`).
    """

    cloud_mean: torch.Tensor
    cloud_scale: torch.Tensor
    proprio_mean: torch.Tensor
    proprio_scale: torch.Tensor

    def __init__(self, config: PolicyConfig, arm: int, row: Sequence[int]) -> None:
        super().__init__()
        self.config, self.arm, self.row = config, arm, tuple(row)
        points, own = cloud_size(config), proprio_size(config, arm)
        for name, size in ((CLOUD, points), (PROPRIO, own)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_scale", torch.ones(size))
        self.encoder = make_encoder(config)
        self.project = nn.Linear(self.encoder.width, config.width)
        self.proprio = nn.Sequential(
            nn.Linear(own, config.width), nn.LayerNorm(config.width), nn.GELU(), nn.Linear(config.width, config.width)
        )
        self.text = make_text_encoder(config, self.row)
        tokens = 1 + (self.text is not None) + config.history * (self.encoder.tokens + 1)
        self.trunk = Trunk(config.width, config.layers, config.attention, tokens)
        self.head = make_head(config, arm, self.encoder.feature_width)

    def fit(self, batch: Mapping[str, torch.Tensor]) -> None:
        """Set all normalization, kept in buffers, from many samples, once before training.

        Coordinates have one scale for the three axes, so that distances keep their proportions.
        """
        cloud = batch[CLOUD].flatten(0, -2).double()
        self.cloud_mean.copy_(cloud.mean(0))
        spread = (cloud - cloud.mean(0)).unflatten(-1, (-1, 3)).square().mean((0, 2)).sqrt().clamp(min=SMALLEST)
        self.cloud_scale.copy_(spread.repeat_interleave(3))
        own = batch[PROPRIO].flatten(0, -2).double()
        self.proprio_mean.copy_(own.mean(0))
        self.proprio_scale.copy_(own.std(0, correction=0).clamp(min=SMALLEST))
        self.head.fit(batch)

    def context(self, batch: Mapping[str, torch.Tensor]) -> Context:
        """Return what the head works from."""
        cloud = (batch[CLOUD] - self.cloud_mean) / self.cloud_scale
        own = (batch[PROPRIO] - self.proprio_mean) / self.proprio_scale
        frames = self.config.history
        flat = cloud.flatten(0, 1)  # (B T, N, C)
        features = None
        points = batch[CLOUD][:, -1, :, :3]
        seen_points = points
        if self.head.wants_features:
            rows = self._first_look(batch[CLOUD][..., :3].flatten(0, 1))
            flat = gathered(flat, rows)
            seen_points = gathered(points, rows.unflatten(0, (-1, frames))[:, -1])
            pooled, every = self.encoder.with_features(flat)
            features = every.unflatten(0, (-1, frames))[:, -1]
        else:
            pooled = self.encoder(flat)  # (B T, K, F)
        seen = self.project(pooled).unflatten(0, (-1, frames)).flatten(1, 2)  # (B, T K, D)
        tokens = [seen, self.proprio(own)]
        sentence = None if self.text is None else self.text(batch[TEXT])
        if sentence is not None:
            tokens.append(sentence[:, None])
        return Context(self.trunk(torch.cat(tokens, 1)), points, seen_points, features, sentence)

    def _first_look(self, points: torch.Tensor) -> torch.Tensor:
        """(B, K) rows of points (B, N, 3): the first ``seen_points``, and ``spread_points`` far from each other."""
        count = points.shape[1]
        rows = torch.arange(min(self.config.seen_points, count), device=points.device).expand(len(points), -1)
        spread = min(self.config.spread_points, count)
        return rows if spread == 0 else torch.cat([rows, farthest_points(points, spread)], 1)

    def loss(self, batch: Mapping[str, torch.Tensor], generator: torch.Generator) -> torch.Tensor:
        """Return the loss of a batch of inputs and targets, a scalar."""
        return self.head.loss(self.context(batch), batch, generator)

    def forward(self, batch: Mapping[str, torch.Tensor], noise: torch.Tensor) -> torch.Tensor:
        """Return what the policy does, (B, ...), of a batch of inputs."""
        return self.head.act(self.context(batch), noise)


def fresh_network(config: PolicyConfig, arm: int, row: Sequence[int], seed: int) -> PolicyNetwork:
    """Return a network whose weights follow from the seed; PyTorch's own generator is left as it was."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return PolicyNetwork(config, arm, row)
