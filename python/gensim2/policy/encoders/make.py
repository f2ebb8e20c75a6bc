"""Encoders by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.policy.encoders.mlp import MlpEncoder
from gensim2.policy.frames import cloud_size

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig
    from gensim2.policy.encoders.protocol import PointEncoder

_KINDS = {"mlp": MlpEncoder}


def make_encoder(config: PolicyConfig) -> PointEncoder:
    """Return the encoder that the configuration names, with fresh weights."""
    return _KINDS[config.encoder](cloud_size(config))
