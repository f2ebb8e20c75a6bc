"""Points that follow from a scene's geometry and that strategies may name beside the objects' own keypoints."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from gensim2.planning.scene import Scene, SceneBody

Array = npt.NDArray[np.float64]

FLOOR = "floor"
"""What is below an object's last keypoint: things put into a container lie on it, a mug below a spout stands on it."""

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
    spans = []
    for planes in _planes(_Hulls(body.hulls)):
        distance, slope = planes[:, :3] @ start + planes[:, 3], planes[:, :3] @ along
        level = np.abs(slope) < 1e-9
        if (distance[level] > 0).any():
            continue
        at = -distance[~level] / slope[~level]
        rising = slope[~level] > 0
        low, high = at[~rising].max(initial=-np.inf), at[rising].min(initial=np.inf)
        if low < high:
            spans.append((float(low), float(high)))
    return spans


class _Hulls:
    """Hulls as a key: the same tuple is the same key, and is kept alive by it."""

    def __init__(self, hulls: tuple[Array, ...]) -> None:
        self.hulls = hulls

    def __hash__(self) -> int:
        return id(self.hulls)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Hulls) and other.hulls is self.hulls


@lru_cache(maxsize=64)
def _planes(key: _Hulls) -> tuple[Array, ...]:
    """Of each hull (K, 4) outward normals and offsets."""
    from scipy.spatial import ConvexHull  # here: refusing a strategy needs none of SciPy

    return tuple(np.asarray(ConvexHull(hull, qhull_options="QJ").equations, dtype=np.float64) for hull in key.hulls)
