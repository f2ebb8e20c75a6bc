"""Shorten a motion that cannot be executed completely, and release the object at the end of the shortened motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gensim2_kpam as kpam

#: Safety margin, as a fraction of the full length of a motion. The last motion of a shortened config stops earlier by
#: this margin than the last motion of the partial plan.
LEFT_OUT = 0.05

TO_OPENNESS = ("follow_joint_to", "trace_joint_to")
"""Types of motions that are given by the final openness. Other types are given by a distance or an angle."""


def shortened(config: Mapping[str, Any], plan: kpam.Plan, openness: float | None) -> dict[str, Any] | None:
    """Return a solver config whose motions end where a partial plan ends.

    Args:
        config: complete config as plain data.
        plan: partial plan of the config.
        openness: openness of the object's joint at the start of the motion; None for a rigid object.

    Returns:
        The shortened config. None if the config does not release the object, or if the plan ends before actuation.
    """
    motions = list(config.get("post_actuation_motions", []))
    if plan.status != "partial" or not config.get("let_go") or not motions:
        return None
    gone = plan.reached_fraction * (len(motions) + 1)  # + 1, because the planner counts the release as one motion
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
    """Return the joint's openness after a motion; None if the motion is a change in rad or m."""
    if isinstance(motion, list | tuple) and motion[0] in TO_OPENNESS:
        return float(motion[1])
    return openness if isinstance(motion, list | tuple) and motion[0] not in ("follow_joint", "trace_joint") else None


def _part(motion: Any, share: float, openness: float | None) -> list[Any] | None:
    """Return the first part (fraction ``share``) of a motion; None if the motion has no number that can be scaled."""
    if isinstance(motion, str):
        return None
    name, value = motion[0], float(motion[1])
    if name not in TO_OPENNESS:
        return [name, share * value]
    return None if openness is None else [name, openness + share * (value - openness)]
