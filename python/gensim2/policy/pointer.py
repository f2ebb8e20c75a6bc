r"""Predict the hand's poses at its next keyframes, and pass each prediction to the trunk as a token.

Features after max pooling would lose the positions. Therefore poses are predicted from the points, in two stages.

The first stage predicts the position of each keyframe from a subset of points :math:`x_i`, with weights :math:`w_i` (a
heatmap) and offsets :math:`o_i`: :math:`p = \sum_i w_i (x_i + o_i)`.

The second stage refines all positions and predicts rotations. For this, the stage uses the points of the full cloud
near the predicted position of keyframe ``LOOKED_AT``, with their coordinates and Fourier features.

Coordinates are in the tool frame. In this frame, the position of a keyframe is the remaining motion.
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
"""Frequencies of the Fourier features, 1/m."""
NEAR = 96
"""Number of points in the second stage."""
LOOKED_AT = 1
"""Index of the keyframe around which the second stage selects points. The first keyframe is often in free space."""
NOISE = 0.01
"""Standard deviation (m) of the noise on the second stage's origin in training."""
METRE, CENTIMETRES = 0.05, 0.1
"""Scales (m) by which position corrections and places are normalized."""
_FEATURES = 3 + 6 * len(BANDS)


@dataclass(frozen=True)
class Pointed:
    """Predictions of both stages for B samples and K keyframes, in the tool's frame.

    Attributes:
        tokens: (B, K + 1, D) one token for each keyframe, and one token with the point features of the second stage.
        points: (B, P, 3) points that the first stage uses, m.
        logits: (B, P, K) logits of the heatmaps.
        places: (B, K, 3) positions predicted by the first stage, m.
        positions: (B, K, 3) positions predicted by the second stage, m.
        six: (B, K, 6) rotations predicted by the second stage, as the first two columns of a rotation matrix.
    """

    tokens: torch.Tensor
    points: torch.Tensor
    logits: torch.Tensor
    places: torch.Tensor
    positions: torch.Tensor
    six: torch.Tensor


class KeyframePointer(nn.Module):  # type: ignore[misc]
    """Predicts the hand's pose at the next ``config.keyframes`` keyframes.

    Args:
        features: G, size of a point's feature.
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
        return self.keyframes + 1

    def forward(
        self,
        points: torch.Tensor,
        features: torch.Tensor,
        summary: torch.Tensor,
        cloud: torch.Tensor,
        generator: torch.Generator | None = None,
    ) -> Pointed:
        """Predict the hand's poses at the keyframes with both stages.

        Args:
            points: (B, P, 3) points of the first stage in the tool's frame, m.
            features: (B, P, G) features of ``points``.
            summary: (B, 3 D) the tokens of the robot's state, the cloud and the instruction, concatenated.
            cloud: (B, N, 3) points for the second stage in the tool's frame, m.
            generator: random generator for training, None otherwise. In training the centre of the second stage's
                region gets random noise, because the first stage predicts this centre only approximately.
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
        """Return the weighted loss of both stages over the samples with known keyframes."""
        true, turned = batch[KEY_POSITIONS], batch[KEY_ROTATIONS]
        # shape (B,): 1 for a sample with known keyframes, otherwise 0
        known = true.isfinite().all(-1).all(-1).to(pointed.places.dtype)
        share = known / known.sum().clamp(min=1.0)
        true, turned = true.nan_to_num(), turned.nan_to_num()
        heat = heat_loss(pointed.points, pointed.logits, true).mean(-1)
        coarse = (pointed.places - true).abs().sum(-1).mean(-1) / METRE
        fine = (pointed.positions - true).abs().sum(-1).mean(-1) / METRE
        turns = (pointed.six - six_of_matrix(turned)).abs().mean((-2, -1))
        return ((0.1 * heat + 0.2 * coarse + 0.5 * fine + 0.5 * turns) * share).sum()


def _waves(positions: torch.Tensor) -> torch.Tensor:
    """Return an array (..., 33) of scaled positions and their Fourier features, for positions (..., 3) in m."""
    return torch.cat([positions / CENTIMETRES, *fourier_features(positions, BANDS)], -1)
