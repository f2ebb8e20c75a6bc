"""Compute points from a scene's geometry that strategies may name in addition to keypoints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.meshwork.crossings import crossings
from gensim2.planning.scene import Scene, SceneBody

FLOOR = "floor"
"""Surface below an object's last keypoint: the floor inside a container, or the surface below a spout."""

UPRIGHT = "rigidbody_object_upright"
"""Point ``UPRIGHT_HEIGHT`` above a rigid object's first keypoint in the pose at the start of the episode."""

UPRIGHT_HEIGHT = 0.1
ROOM = 0.04
"""Minimum free height (m) above a surface that counts as a floor."""
BESIDE, EVEN, SIDES = 0.03, 0.01, 3
"""A floor must be level within ``EVEN`` metres and extend ``BESIDE`` metres to ``SIDES`` or more of its four sides."""
ABOVE = 0.02
"""Maximum height (m) of a floor above the keypoint. Annotated keypoints can lie slightly inside a shelf."""


def floor(scene: Scene, name: str) -> Array:
    """Return the point (3,) of the floor below an object's last keypoint, in the base frame.

    The floor is the highest surface of the object or of a fixture below the keypoint that has ``ROOM`` metres of free
    space above it. On at least ``SIDES`` of four sides the surface must continue or end at a wall. Without such a
    surface, the floor is the table top, z = 0 in the world.
    """
    T_base_world = np.linalg.inv(scene.T_world_base)
    up = np.asarray(T_base_world[:3, 2], dtype=np.float64)
    point = list(scene.objects[name].keypoints.values())[-1]
    level = float((scene.T_world_base @ np.append(point, 1.0))[2])
    bodies = (*scene.objects[name].bodies, *scene.fixtures)
    spans = _spans(bodies, point, up)
    tops = [top for _, top in spans if top <= ABOVE and all(low >= top + ROOM or high <= top for low, high in spans)]
    sides = [sign * axis for axis in T_base_world[:3, :2].T for sign in (-1.0, 1.0)]
    beside = [_spans(bodies, point + BESIDE * side, up) for side in sides]
    stays = [sum(any(low < top + EVEN and high > top - EVEN for low, high in each) for each in beside) for top in tops]
    whole = [top for top, count in zip(tops, stays, strict=True) if count >= SIDES]
    return np.asarray(point + max([-level, *whole]) * up, dtype=np.float64)


def _spans(bodies: Sequence[SceneBody], point: Array, up: Array) -> list[tuple[float, float]]:
    """Return the intervals of the vertical line through ``point`` inside the bodies, in metres above the point."""
    return sorted(span for body in bodies for span in _spans_of(body, point, up))


def _spans_of(body: SceneBody, point: Array, up: Array) -> list[tuple[float, float]]:
    rotation = body.T_base_body[:3, :3]
    start, along = rotation.T @ (point - body.T_base_body[:3, 3]), rotation.T @ up
    enter, leave = crossings(body.hulls, start[None], along)
    return [(float(low), float(high)) for low, high in zip(enter[0], leave[0], strict=True) if low < high]
