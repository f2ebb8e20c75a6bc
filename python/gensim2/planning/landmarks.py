"""Points that follow from a scene's geometry and that strategies may name beside the objects' own keypoints."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gensim2.planning.hulls import crossings
from gensim2.planning.scene import Scene, SceneBody

Array = npt.NDArray[np.float64]

FLOOR = "floor"
"""Surface below an object's last keypoint: things put into a container lie on it, a mug below a spout stands on it."""

UPRIGHT = "rigidbody_object_upright"
"""``UPRIGHT_HEIGHT`` above a rigid object's first keypoint as it stood when the episode began."""

UPRIGHT_HEIGHT = 0.1
ROOM = 0.04
"""Metres that must be free above a floor."""
ABOVE = 0.02
"""Metres above the keypoint within which a floor may lie: annotated points lie on shelves, or a little in them."""


def floor(scene: Scene, name: str) -> Array:
    """(3,) where the vertical through an object's last keypoint meets what lies below, base frame.

    That is the highest surface of the object's bodies and of the fixtures that has ``ROOM`` above it; the level of the
    table, z = 0 in the world, where there is none.
    """
    T_base_world = np.linalg.inv(scene.T_world_base)
    up = np.asarray(T_base_world[:3, 2], dtype=np.float64)
    point = list(scene.objects[name].keypoints.values())[-1]
    level = float((scene.T_world_base @ np.append(point, 1.0))[2])
    spans = sorted(span for body in (*scene.objects[name].bodies, *scene.fixtures) for span in _spans(body, point, up))
    surfaces = [-level]
    for _, top in spans:
        free = all(low >= top + ROOM or high <= top for low, high in spans)
        if top <= ABOVE and free:
            surfaces.append(top)
    return np.asarray(point + max(surfaces) * up, dtype=np.float64)


def _spans(body: SceneBody, point: Array, up: Array) -> list[tuple[float, float]]:
    """Stretches of a vertical line inside a body's hulls, metres above ``point``."""
    rotation = body.T_base_body[:3, :3]
    start, along = rotation.T @ (point - body.T_base_body[:3, 3]), rotation.T @ up
    enter, leave = crossings(body.hulls, start[None], along)
    return [(float(low), float(high)) for low, high in zip(enter[0], leave[0], strict=True) if low < high]
