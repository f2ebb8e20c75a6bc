"""Notation of steps in files of sentences, such as ``benchmarks/sentences.toml``."""

from __future__ import annotations

from gensim2.instructions.steps import Lift, MoveJoint, Put, Step


def in_words(step: Step) -> str:
    """Return a step in the notation of the sentence files."""
    if isinstance(step, MoveJoint):
        return f"{step.goal.removeprefix('articulated_')} {step.asset_class}"
    if isinstance(step, Put):
        return f"put {step.thing} {step.destination}" + (f" from {step.source}" if step.source else "")
    return f"lift {step.thing}" if isinstance(step, Lift) else f"hand {step.thing} {step.direction}"
