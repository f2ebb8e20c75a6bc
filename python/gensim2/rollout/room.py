"""Room for the hand about what the next step takes, once a step has opened something."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gensim2.planning.scene import Scene, SceneBody
from gensim2.scenes.footprint import gap_between, outline
from gensim2.tasks.spec import HAND, Step

Array = npt.NDArray[np.float64]

ROOM = 0.06
"""m about a thing that a hand with open fingers needs on each side, seen from above."""


def room_for_hand(after: Scene | None, step: Step, following: Sequence[Step]) -> float:
    """Room (m) between what a step moves and what the next step takes, seen from above; ``ROOM`` is all that counts.

    Args:
        after: the scene that a plan of ``step`` foresees; None where there is none.
        step: which moves a joint.
        following: the steps after it.
    """
    if after is None or not following or following[0].tool != HAND:
        return ROOM
    thing, joint = after.objects[following[0].object], after.objects[step.object].joint
    if joint is None or not thing.is_rigid:
        return ROOM
    about = _outline(thing.bodies)
    moved = (body for body in after.objects[step.object].bodies if body.name in joint.moves and body.hulls)
    return min((ROOM, *(gap_between(_outline([body]), about) for body in moved)))


def _outline(bodies: Sequence[SceneBody]) -> Array:
    """(N, 2) m: convex outline from above, in the base frame, counter-clockwise."""
    points = [hull @ body.T_base_body[:3, :3].T + body.T_base_body[:3, 3] for body in bodies for hull in body.hulls]
    return outline(np.concatenate(points), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
