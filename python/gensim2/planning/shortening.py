"""The longest part of a motion as a config of its own, so that it ends as the whole would: with the hand letting go."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gensim2_kpam as kpam

#: Share of the motion in which a part ends that is left out: there something was in the way, or out of reach.
LEFT_OUT = 0.05

TO_OPENNESS = ("follow_joint_to", "trace_joint_to")
"""Motions whose number is the openness at which they end; of other lists it is how far they go."""


def shortened(config: Mapping[str, Any], plan: kpam.Plan, openness: float | None) -> dict[str, Any] | None:
    """The config whose motions after the actuation pose go as far as a partial plan does.

    Args:
        config: of the whole, as plain data.
        plan: the longest part of it.
        openness: of the object's joint where the motion begins; None without one.

    Returns:
        None where the config does not let go, or the plan does not get past the actuation pose.
    """
    motions = list(config.get("post_actuation_motions", []))
    if plan.status != "partial" or not config.get("let_go") or not motions:
        return None
    gone = plan.reached_fraction * (len(motions) + 1)  # letting go is one more
    kept = motions[: int(gone)]
    share = gone - int(gone) - LEFT_OUT
    if len(kept) < len(motions) and share > 0.0:
        begin = openness
        for motion in kept:
            begin = _openness_after(motion, begin)
        part = _part(motions[len(kept)], share, begin)
        kept += [] if part is None else [part]
    return {**config, "post_actuation_motions": kept} if kept else None


def _openness_after(motion: Any, openness: float | None) -> float | None:
    """Return the openness at which a motion leaves the joint; None where the plan does not say."""
    if isinstance(motion, list | tuple) and motion[0] in TO_OPENNESS:
        return float(motion[1])
    return openness if isinstance(motion, list | tuple) and motion[0] not in ("follow_joint", "trace_joint") else None


def _part(motion: Any, share: float, openness: float | None) -> list[Any] | None:
    """The first part of a motion; None of one that has no number."""
    if isinstance(motion, str):
        return None
    name, value = motion[0], float(motion[1])
    if name not in TO_OPENNESS:
        return [name, share * value]
    return None if openness is None else [name, openness + share * (value - openness)]
