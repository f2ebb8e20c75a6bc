"""Carry out instructions in plain English in simulation.

Names are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.doing.carrying_out import DoResult, do
    from gensim2.doing.composing import Composed, compose

__all__ = ["Composed", "DoResult", "compose", "do"]

__getattr__ = lazy_names(__name__)
