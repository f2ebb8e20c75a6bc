"""Predict whether a released object ends on or inside the object on which a step puts it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.meshwork.crossings import crossings
from gensim2.planning.scene import CENTER, Scene, SceneBody, SceneObject

INSIDE = "inside"
"""Word in the name of a container's last keypoint."""

BORDER = 0.015
"""Minimum horizontal distance (m) of a released object's centre of mass from the border of its support."""

RIM = 0.95
"""Fraction of a container's vertices that lie below its rim. An estimated shape may have stray points above the rim."""

PIERCED = 0.01
"""Maximum depth (m) at which the released object may overlap its support."""


def misses(scene: Scene, name: str, goal: SceneObject) -> str | None:
    """Return the reason why a rigid object that falls from its pose would not end on or inside ``goal``.

    The object falls straight down onto the next body. Afterwards, its centre of mass must be above or inside ``goal``,
    at least ``BORDER`` from its border, and in a container that is open at the top it must be below the rim.

    Args:
        scene: scene with the object at the pose where the fingers open.
        name: the released object.
        goal: object of ``scene`` on which the released object should lie.

    Returns:
        The reason, or None if the object ends at its goal, or if this cannot be predicted.

    Example:
        ```python
        planned = StepPlanner(robot("panda")).plan(scene, step, strategy)
        reason = misses(planned.after, "apple", planned.after.objects["box"])
        ```
    """
    thing = scene.objects[name]
    support = [body for body in _support(goal) if body.hulls]
    if thing.center_of_mass is None or not support:
        return None
    from scipy.spatial import ConvexHull  # imported here because checking a strategy does not need SciPy

    rotation, offset = scene.T_world_base[:3, :3], scene.T_world_base[:3, 3]
    center, corners = rotation @ thing.points[CENTER] + offset, _vertices(support) @ rotation.T + offset
    sides = ConvexHull(corners[:, :2], qhull_options="QJ").equations
    outside = 1000.0 * float((sides[:, :2] @ center[:2] + sides[:, 2]).max() + BORDER)
    if outside > 0.0:
        return f"{name} would fall beside {goal.name}: its centre of mass is {outside:.0f} mm too far outside"
    above = 1000.0 * float(center[2] - fall(scene, name) - np.quantile(corners[:, 2], RIM))
    if goal.joint is not None and above > 0.0:
        return f"{name} would not lie inside {goal.name}: its centre of mass is {above:.0f} mm too high"
    return None


def fall(scene: Scene, name: str) -> float:
    """Return the distance (m) by which a rigid object can fall until it meets another body or the table.

    Args:
        scene: scene with the object at its pose before the fall.
        name: the rigid object.
    """
    thing = scene.objects[name]
    up = scene.T_world_base[2, :3].astype(np.float64)
    points = np.concatenate([_vertices(thing.bodies), thing.points[CENTER][None]])
    lowest = np.min([_crossed(body, points, up)[0].min(axis=1) for body in thing.bodies], axis=0)
    gaps = [points @ up + scene.T_world_base[2, 3] + lowest]
    own = {body.name for body in thing.bodies}
    for body in scene.bodies:
        if body.hulls and body.name not in own:
            each = lowest[:, None] - _crossed(body, points, up)[1]
            gaps.append(np.where(each < -PIERCED, np.inf, each).min(axis=1))
    return max(0.0, float(np.min(gaps)))


def _support(goal: SceneObject) -> Sequence[SceneBody]:
    """Return the bodies on or inside which a released object lies: of a container, the part with its interior."""
    if goal.joint is None:
        return goal.bodies
    last = list(goal.keypoints)[-1]
    if INSIDE not in last:
        return ()  # The released object stands beside it, as a mug below a faucet.
    # A keypoint with "base" in its name belongs to the fixed part, which the joint does not move.
    return [body for body in goal.bodies if ("base" in last) != (body.name in goal.joint.moves)]


def _vertices(bodies: Sequence[SceneBody]) -> Array:
    """Return the vertices (N, 3) of the bodies' hulls in the base frame, m."""
    return np.concatenate(
        [hull @ body.T_base_body[:3, :3].T + body.T_base_body[:3, 3] for body in bodies for hull in body.hulls]
    )


def _crossed(body: SceneBody, points: Array, up: Array) -> tuple[Array, Array]:
    """Return the heights (N, H) above each point at which the vertical line through it enters and leaves each hull of
    the body, m.
    """
    rotation = body.T_base_body[:3, :3]
    return crossings(body.hulls, (points - body.T_base_body[:3, 3]) @ rotation, rotation.T @ up)
