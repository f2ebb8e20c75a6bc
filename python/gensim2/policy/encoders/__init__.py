"""Point encoders turn a point cloud into pooled tokens. On request they also return a feature vector for each point."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import torch

from gensim2.core.errors import InputError
from gensim2.policy.encoders.mlp import MlpEncoder, StateEncoder
from gensim2.policy.encoders.pointnet import PointNetEncoder
from gensim2.policy.encoders.pointnext import PointNextEncoder
from gensim2.policy.frames import cloud_size

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig

__all__ = ["PointEncoder", "make_encoder"]

_KINDS: dict[str, Any] = {
    "mlp": MlpEncoder,
    "pointnet": PointNetEncoder,
    "pointnext": PointNextEncoder,
    "state": StateEncoder,
}


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
        """Return pooled tokens (B, K, F) and point features (B, N, G), which are both differentiable."""
        ...


def make_encoder(config: PolicyConfig) -> PointEncoder:
    """Return the point cloud encoder that the settings name, with newly initialized weights.

    Raises:
        InputError: the encoder is ``state``, but the setting ``points`` is missing, which this encoder needs.
    """
    more: dict[str, Any] = {"blocks": config.blocks} if config.encoder == "pointnext" else {}
    if config.encoder == "state":
        if config.points is None:
            message = "is missing; the encoder 'state' needs the number of points of a cloud in the data set"
            raise InputError(message, field="points")
        more = {"points": config.points}
    encoder: PointEncoder = _KINDS[config.encoder](cloud_size(config), **more)
    return encoder
