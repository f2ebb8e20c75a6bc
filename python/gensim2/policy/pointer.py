r"""Pointer: where the hand will be at its next keyframes, told by two looks at the cloud; each is a token of the trunk.

A maximum over the points blurs where things are. The first look, at some of the points, makes a heatmap over them for
each keyframe, whose mean with an offset from each point is a place, :math:`p = \sum_i w_i (x_i + o_i)`. The second
is at the points of the whole cloud about such a place, with Fourier features of their coordinates, and gives places
and turns of the hand more exactly. All is in the tool's frame: what an action has to cover is read off at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import nn

from gensim2.policy.encoders.grouping import gathered
from gensim2.policy.encoders.mlp import MlpEncoder
from gensim2.policy.heatmap import fourier_features, heat_loss, places_of
from gensim2.policy.keyframes import KEY_POSITIONS, KEY_ROTATIONS
from gensim2.policy.rotations import six_of_matrix

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig

BANDS = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Fourier features, 1/m."""
NEAR = 96
"""Points of the second look."""
LOOKED_AT = 1
"""Number of the keyframe that the second look is about: the hand often comes to the next one in the air."""
NOISE = 0.01
"""Standard deviation of the second look's origin in training, m."""
METRE, CENTIMETRES = 0.05, 0.1
"""Scales of positions, m: of a correction, and of a place."""
_FEATURES = 3 + 6 * len(BANDS)


@dataclass(frozen=True)
class Pointed:
    """Result of both looks, in the tool's frame.

    Attributes:
        tokens: (B, K + 1, D): one a keyframe, and one of the second look.
        points: (B, P, 3) of the first look, m.
        logits: (B, P, K) of its heatmaps.
        places: (B, K, 3) by the first look, m.
        positions, six: (B, K, 3) m and (B, K, 6) by the second.
    """

    tokens: torch.Tensor
    points: torch.Tensor
    logits: torch.Tensor
    places: torch.Tensor
    positions: torch.Tensor
    six: torch.Tensor


class KeyframePointer(nn.Module):  # type: ignore[misc]
    """Pointer at the next ``config.keyframes`` keyframes.

    Args:
        config: of the policy.
        features: G, width of a point's feature.
    """

    def __init__(self, config: PolicyConfig, features: int) -> None:
        super().__init__()
        self.keyframes, width = config.keyframes, config.width
        self.of_point, self.of_summary = nn.Linear(features, 64), nn.Linear(3 * width, 64)
        self.heat = nn.Linear(64, 4 * self.keyframes)
        self.near = MlpEncoder(_FEATURES + 3)
        self.of_near = nn.Linear(self.near.width, width)
        self.refined = nn.Sequential(
            nn.Linear(self.near.width + 3 * width + 3 * self.keyframes, 256),
            nn.GELU(),
            nn.Linear(256, 256),
            nn.GELU(),
            nn.Linear(256, 9 * self.keyframes),
        )
        self.of_keyframe = nn.Sequential(nn.Linear(_FEATURES + 6, width), nn.GELU(), nn.Linear(width, width))

    @property
    def tokens(self) -> int:
        """Number of tokens that it gives."""
        return self.keyframes + 1

    def forward(
        self,
        points: torch.Tensor,
        features: torch.Tensor,
        summary: torch.Tensor,
        cloud: torch.Tensor,
        generator: torch.Generator | None = None,
    ) -> Pointed:
        """Look twice.

        Args:
            points: (B, P, 3) of the first look in the tool's frame, m.
            features: (B, P, G) of them.
            summary: (B, 3 D) of the robot's own state, of the cloud and of the sentence.
            cloud: (B, N, 3) of the second look, in the tool's frame, m.
            generator: in training, of the noise on where the second look is at.
        """
        inner = nn.functional.gelu(self.of_point(features) + self.of_summary(summary)[:, None])
        logits, offsets = self.heat(inner).unflatten(-1, (self.keyframes, 4)).split((1, 3), -1)
        logits = logits[..., 0]
        places = places_of(points, logits, offsets)
        origin = places[:, min(LOOKED_AT, self.keyframes - 1)].detach()
        if generator is not None:
            origin = origin + NOISE * torch.randn(origin.shape, generator=generator, device=origin.device)
        about = cloud - origin[:, None]
        rows = about.square().sum(-1).topk(min(NEAR, cloud.shape[1]), largest=False).indices
        looked = self.near(torch.cat([_waves(gathered(about, rows)), gathered(cloud, rows)], -1))[:, 0]
        relative = (places.detach() - origin[:, None]).flatten(1) / METRE
        refined = self.refined(torch.cat([looked, summary, relative], -1)).unflatten(-1, (self.keyframes, 9))
        positions, six = origin[:, None] + METRE * refined[..., :3], refined[..., 3:]
        told = self.of_keyframe(torch.cat([_waves(positions), six], -1))
        tokens = torch.cat([told, self.of_near(looked)[:, None]], 1)
        return Pointed(tokens, points, logits, places, positions, six)

    def loss(self, pointed: Pointed, batch: Mapping[str, torch.Tensor]) -> torch.Tensor:
        """Return the weighted sum of the losses of both looks, of the samples whose keyframes are known."""
        true, turned = batch[KEY_POSITIONS], batch[KEY_ROTATIONS]
        known = true.isfinite().all(-1).all(-1).to(pointed.places.dtype)  # (B,)
        share = known / known.sum().clamp(min=1.0)
        true, turned = true.nan_to_num(), turned.nan_to_num()
        heat = heat_loss(pointed.points, pointed.logits, true).mean(-1)
        coarse = (pointed.places - true).abs().sum(-1).mean(-1) / METRE
        fine = (pointed.positions - true).abs().sum(-1).mean(-1) / METRE
        turns = (pointed.six - six_of_matrix(turned)).abs().mean((-2, -1))
        return ((0.1 * heat + 0.2 * coarse + 0.5 * fine + 0.5 * turns) * share).sum()


def _waves(positions: torch.Tensor) -> torch.Tensor:
    """(..., 33) Fourier features of positions (..., 3), m."""
    return torch.cat([positions / CENTIMETRES, *fourier_features(positions, BANDS)], -1)
