"""Assemble the network of a policy: encoders, trunk and head."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import torch
from torch import nn

from gensim2.policy.encoders import make_encoder
from gensim2.policy.encoders.grouping import farthest_points, gathered
from gensim2.policy.frames import cloud_size, proprio_size, tool_in
from gensim2.policy.heads import Context, make_head
from gensim2.policy.pointer import KeyframePointer, Pointed
from gensim2.policy.text import make_text_encoder
from gensim2.policy.trunk import Trunk

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig

CLOUD, PROPRIO, TEXT = "cloud", "proprio", "text"
"""Inputs of a batch: clouds (B, T, N, C), robot states (B, T, P), and encoded instructions (B, ...)."""

SMALLEST = 1e-2
"""Minimum scale by which proprioception is divided, rad or m."""


class PolicyNetwork(nn.Module):  # type: ignore[misc]
    """Network of a policy.

    Args:
        config: architecture.
        arm: m, number of the arm's joints.
        row: shape of one encoded instruction (:func:`~gensim2.policy.text.prepare`).
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
        self.pointer = KeyframePointer(config, self.encoder.feature_width) if config.keyframes else None
        tokens = 1 + (self.text is not None) + config.history * (self.encoder.tokens + 1)
        tokens += 0 if self.pointer is None else self.pointer.tokens
        self.trunk = Trunk(config.width, config.layers, config.attention, tokens)
        self.head = make_head(config, arm, self.encoder.feature_width)

    def fit(self, batch: Mapping[str, torch.Tensor]) -> None:
        """Compute all normalization constants from a large batch, once before training, and store them in buffers.

        The x, y and z coordinates of points have the same scale, so that shapes are not distorted.
        """
        cloud = batch[CLOUD].flatten(0, -2).double()
        self.cloud_mean.copy_(cloud.mean(0))
        spread = (cloud - cloud.mean(0)).unflatten(-1, (-1, 3)).square().mean((0, 2)).sqrt().clamp(min=SMALLEST)
        self.cloud_scale.copy_(spread.repeat_interleave(3))
        own = batch[PROPRIO].flatten(0, -2).double()
        self.proprio_mean.copy_(own.mean(0))
        self.proprio_scale.copy_(own.std(0, correction=0).clamp(min=SMALLEST))
        self.head.fit(batch)

    def context(self, batch: Mapping[str, torch.Tensor], generator: torch.Generator | None = None) -> Context:
        """Return the inputs of the head.

        Args:
            generator: random generator that samples points for the keyframe pointer in training; None otherwise.
        """
        cloud = (batch[CLOUD] - self.cloud_mean) / self.cloud_scale
        own = (batch[PROPRIO] - self.proprio_mean) / self.proprio_scale
        frames = self.config.history
        flat = cloud.flatten(0, 1)  # shape (B * T, N, C)
        features = None
        points = batch[CLOUD][:, -1, :, :3]
        seen_points = points
        if self.head.wants_features or self.pointer is not None:
            rows = (
                self._first_look(batch[CLOUD][..., :3].flatten(0, 1))
                if self.pointer is None
                else self._any_of(flat, generator)
            )
            flat = gathered(flat, rows)
            seen_points = gathered(points, rows.unflatten(0, (-1, frames))[:, -1])
            pooled, every = self.encoder.with_features(flat)
            features = every.unflatten(0, (-1, frames))[:, -1]
        else:
            pooled = self.encoder(flat)  # shape (B * T, K, F)
        seen = self.project(pooled).unflatten(0, (-1, frames)).flatten(1, 2)  # shape (B, T * K, D)
        state = self.proprio(own)
        tokens = [seen, state]
        sentence = None if self.text is None else self.text(batch[TEXT])
        if sentence is not None:
            tokens.append(sentence[:, None])
        pointed = None
        if self.pointer is not None:
            heard = torch.zeros_like(state[:, -1]) if sentence is None else sentence
            summary = torch.cat([state[:, -1], seen[:, -1], heard], -1)
            pointed = self._pointed(self.pointer, batch, seen_points, features, summary, generator)
            tokens.append(pointed.tokens)
        return Context(self.trunk(torch.cat(tokens, 1)), points, seen_points, features, sentence, pointed)

    def _pointed(
        self,
        pointer: KeyframePointer,
        batch: Mapping[str, torch.Tensor],
        seen_points: torch.Tensor,
        features: torch.Tensor | None,
        summary: torch.Tensor,
        generator: torch.Generator | None,
    ) -> Pointed:
        assert features is not None
        at, R = tool_in(batch[PROPRIO][:, -1])
        near, cloud = ((points - at[:, None]) @ R for points in (seen_points, batch[CLOUD][:, -1, :, :3]))
        found: Pointed = pointer(near, features, summary, cloud, generator)
        return found

    def _any_of(self, points: torch.Tensor, generator: torch.Generator | None) -> torch.Tensor:
        """Return indices of P points of each cloud, one in each of P equal ranges: random, or the middle."""
        count = points.shape[1]
        looked_at = min(self.config.seen_points, count)
        within = torch.full((len(points), looked_at), 0.5, device=points.device)
        if generator is not None:
            within = torch.rand(within.shape, generator=generator, device=points.device)
        rows = (torch.arange(looked_at, device=points.device) + within) * (count / looked_at)
        return rows.long().clamp(max=count - 1)

    def _first_look(self, points: torch.Tensor) -> torch.Tensor:
        """Return indices (B, K): the first ``seen_points``, and ``spread_points`` by farthest point sampling."""
        count = points.shape[1]
        rows = torch.arange(min(self.config.seen_points, count), device=points.device).expand(len(points), -1)
        spread = min(self.config.spread_points, count)
        return rows if spread == 0 else torch.cat([rows, farthest_points(points, spread)], 1)

    def loss(self, batch: Mapping[str, torch.Tensor], generator: torch.Generator) -> torch.Tensor:
        """Return the loss of a batch of inputs and targets, a scalar."""
        context = self.context(batch, generator)
        loss = self.head.loss(context, batch, generator)
        if self.pointer is not None:
            assert context.pointed is not None
            loss = loss + self.pointer.loss(context.pointed, batch)
        return loss

    def forward(self, batch: Mapping[str, torch.Tensor], noise: torch.Tensor) -> torch.Tensor:
        """Return the policy's output (B, ...) for a batch of inputs."""
        return self.head.act(self.context(batch), noise)


def fresh_network(config: PolicyConfig, arm: int, row: Sequence[int], seed: int) -> PolicyNetwork:
    """Return a network with weights initialized by the seed; PyTorch's global random state is unchanged."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return PolicyNetwork(config, arm, row)
