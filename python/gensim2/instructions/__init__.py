"""Parse instructions in plain English, and carry them out in simulation.

Names are imported on first use, so that parsing an instruction does not load the simulator.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.instructions.doing import DoResult, do
    from gensim2.instructions.grammar import parse
    from gensim2.instructions.steps import HandOver, Lift, MoveJoint, Put, Refusal, SentenceError, Step

__all__ = ["DoResult", "HandOver", "Lift", "MoveJoint", "Put", "Refusal", "SentenceError", "Step", "do", "parse"]

__getattr__ = lazy_names(__name__)
