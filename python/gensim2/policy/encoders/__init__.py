"""Point encoders: a cloud becomes pooled tokens, and on demand a feature a point."""

from __future__ import annotations

from gensim2.policy.encoders.make import make_encoder
from gensim2.policy.encoders.protocol import PointEncoder

__all__ = ["PointEncoder", "make_encoder"]
