"""Heads: what makes actions, or keyposes, of the trunk's tokens."""

from __future__ import annotations

from gensim2.policy.heads.make import make_head
from gensim2.policy.heads.protocol import Context, Head

__all__ = ["Context", "Head", "make_head"]
