"""Default placement region on the table: numbers of a table with an arm at its edge, not of any arm."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PlacementRegion:
    """Object placement region; metres, horizontal.

    Attributes:
        base_x: x in the world of the point that distances count from, under the arm's base; its y is 0.
        comfortable: distance from there of what the hand works on, mean over its range.
        farthest: the same anywhere in its range; being clear of the hand gives way to it.
        sideways: how far off the middle line that may lie.
        nearest_x: in the world: nothing of a low object comes closer to the base.
        hand_at_rest: x and y in the world of the hand at the start of an episode.
        hand_low_point: height above the table: what is lower passes under the hand at rest.
        hand_clearance: ahead of the hand at rest, what anything tall keeps: the hand's thickness and the randomization.
        hand_half_width: to each side of the hand at rest where that holds: its width and the randomization.
    """

    base_x: float = -0.615
    comfortable: float = 0.55
    farthest: float = 0.74
    sideways: float = 0.2
    nearest_x: float = -0.27
    hand_at_rest: tuple[float, float] = (-0.21, 0.0)
    hand_low_point: float = 0.22
    hand_clearance: float = 0.13
    hand_half_width: float = 0.2


STANDARD_REGION = PlacementRegion()
"""That of all prepared objects; robots stand where they reach it, so that scenes stay comparable."""
