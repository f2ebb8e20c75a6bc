"""Heads, which turn the trunk's tokens into actions or keyposes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gensim2.policy.heads.decoder import ChunkHead, TransformerHead
from gensim2.policy.heads.diffusion import DiffusionHead, FlowHead
from gensim2.policy.heads.keypose import KeyposeHead
from gensim2.policy.heads.protocol import Context, Head

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig

__all__ = ["Context", "Head", "make_head"]

_KINDS: dict[str, Any] = {
    "chunk": ChunkHead,
    "transformer": TransformerHead,
    "diffusion": DiffusionHead,
    "flow": FlowHead,
    "keypose": KeyposeHead,
}


def make_head(config: PolicyConfig, arm: int, features: int) -> Head:
    """Return the configured head with newly initialized weights.

    Args:
        arm: m, number of the arm's joints.
        features: G, size of a point's feature.
    """
    head: Head = _KINDS[config.head](config, arm, features)
    return head
