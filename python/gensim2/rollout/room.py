"""Clearance for the open hand around the next step's object."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gensim2.planning.scene import Scene, SceneBody
from gensim2.scenes.footprint import gap_between, outline
from gensim2.tasks.spec import HAND, Step

Array = npt.NDArray[np.float64]

ROOM = 0.06
"""Clearance (m) that an open hand needs on each side of an object, seen from above."""


def room_for_hand(after: Scene | None, step: Step, following: Sequence[Step]) -> float:
    """Return the clearance (m) from the link that a step moves to the next step's object, from above; ``ROOM`` at most.

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
