"""Parse instructions in plain English into steps.

Names are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.instructions.grammar import parse
    from gensim2.instructions.steps import HandOver, Lift, MoveJoint, Put, Refusal, SentenceError, Step

__all__ = ["HandOver", "Lift", "MoveJoint", "Put", "Refusal", "SentenceError", "Step", "parse"]

__getattr__ = lazy_names(__name__)
