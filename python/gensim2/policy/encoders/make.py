"""Encoders by name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gensim2.policy.encoders.mlp import MlpEncoder
from gensim2.policy.encoders.pointnet import PointNetEncoder
from gensim2.policy.encoders.pointnext import PointNextEncoder
from gensim2.policy.encoders.state import StateEncoder
from gensim2.policy.frames import cloud_size

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig
    from gensim2.policy.encoders.protocol import PointEncoder

_KINDS: dict[str, Any] = {
    "mlp": MlpEncoder,
    "pointnet": PointNetEncoder,
    "pointnext": PointNextEncoder,
    "state": StateEncoder,
}


def make_encoder(config: PolicyConfig) -> PointEncoder:
    """Return the encoder that the configuration names, with fresh weights; of ``state`` it says the points, too."""
    more: dict[str, Any] = {"blocks": config.blocks} if config.encoder == "pointnext" else {}
    if config.encoder == "state":
        more = {"points": config.points}
    encoder: PointEncoder = _KINDS[config.encoder](cloud_size(config), **more)
    return encoder
