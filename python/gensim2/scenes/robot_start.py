"""Start of the robot that overlaps no object of the scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gensim2.robots import RobotProfile
from gensim2.scenes.randomize import draw_start

Array = npt.NDArray[np.float64]

MAX_STARTS = 10
"""Starts that are tried for one placement of the objects."""


def clear_start(
    generator: np.random.Generator, start: tuple[float, ...], robot: RobotProfile, hulls: Sequence[Sequence[Array]]
) -> tuple[float, ...] | None:
    """Return ``start``, or the first of those drawn after it at which the robot overlaps no object.

    Args:
        generator: of the further starts.
        start: (n,) all active joints.
        robot: that stands there.
        hulls: by object, (N, 3) vertices of its convex collision parts in the world, m.

    Returns:
        (n,) joints; None where ``MAX_STARTS`` of them overlap an object.
    """
    import gensim2_kpam as kpam  # here: specs of scenes are read without the solver

    T_base_world = np.linalg.inv(robot.T_world_base)
    bodies = [
        kpam.Body(
            f"object_{index}", "rigid", [kpam.Shape.convex_hull(np.ascontiguousarray(h)) for h in parts], T_base_world
        )
        for index, parts in enumerate(hulls)
    ]
    scene = kpam.Scene(robot.model, bodies)
    for _ in range(MAX_STARTS):
        if not scene.in_collision(np.array(start)):
            return start
        start = draw_start(generator, robot)
    return None
