"""Point encoders. An encoder turns a point cloud into pooled tokens and, if requested, into one feature vector for each
point.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gensim2.core.errors import InputError
from gensim2.policy.encoders.mlp import MlpEncoder, StateEncoder
from gensim2.policy.encoders.pointnet import PointNetEncoder
from gensim2.policy.encoders.pointnext import PointNextEncoder
from gensim2.policy.encoders.protocol import PointEncoder
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
