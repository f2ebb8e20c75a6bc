"""Keypoints of real objects, and what stands in where they are missing or mean something else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gensim2.objects.library.info import Info
from gensim2.objects.meshwork.convexes import surface_samples
from gensim2.objects.shapes import transform
from gensim2.objects.types import Keypoint

Array = npt.NDArray[np.float64]

COLOURS = ("blue", "red", "yellow", "green")
NEAR = 0.03  # m: a colour-named keypoint farther than this from the moving link means something else
HEAD = "articulated_object_head"


def closest_axis(axis: Array, T_link_object: Array) -> Literal["x", "y", "z"]:
    """The axis of the object frame (4, 4) that is closest to a joint's, (3,) in the link's frame."""
    names: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
    return names[int(np.argmax(np.abs(T_link_object[:3, :3].T @ axis)))]


def derived_head(hulls: Sequence[Array], kind: str, axis: Array) -> Array:
    """(3,) point to work on, from the moving link's hulls (link frame, unit joint axis through the origin).

    Revolute: the middle of what lies farthest from the axis. Prismatic: the middle of the end that leads the motion.
    """
    points = np.concatenate(list(hulls))
    along = points @ axis
    score = along if kind == "prismatic" else np.linalg.norm(points - np.outer(along, axis), axis=1)
    far = points[score >= score.max() - 0.05 * max(float(np.ptp(score)), 1e-6)]
    return np.asarray((far.min(axis=0) + far.max(axis=0)) / 2)


def read_keypoints(
    info: Info,
    scale: float,
    T_link_object: Array,
    link: str,
    kind: str,
    axis: Array,
    hulls: Sequence[Array],
    warnings: list[str],
) -> dict[str, Keypoint]:
    """Keypoints of ``info.json`` in metres: on ``link``, or on the root where the name contains ``base``.

    Args:
        T_link_object: (4, 4) frame in which they are written.
        link, kind, axis, hulls: moving link, joint type, unit joint axis and collision hulls in the link's frame.
        warnings: takes a line where a rule had to stand in.
    """
    points = {name: scale * point for name, point in info.keypoints.items()}
    if all(name in COLOURS for name in points):
        surface = cKDTree(np.concatenate([surface_samples(hull) for hull in hulls]))
        gaps = {n: float(surface.query(transform(T_link_object, p[None])[0])[0]) for n, p in points.items()}
        nearest = min(gaps, key=lambda n: gaps[n])
        if gaps[nearest] <= NEAR:
            head = points[nearest]
            rule = f"{nearest!r}, {1000 * gaps[nearest]:.0f} mm from the moving link, is {HEAD}"
        else:
            head = transform(np.asarray(np.linalg.inv(T_link_object), float), derived_head(hulls, kind, axis)[None])[0]
            rule = f"none is near the moving link, so {HEAD} comes from its geometry"
        warnings.append(f"keypoints have colour names only: {rule}")
        points = {HEAD: head}
    found = {}
    for name, point in points.items():
        text = info.descriptions.get(name) or name.replace("_", " ")
        if "base" in name:
            found[name] = Keypoint("base", point, text)
        else:
            found[name] = Keypoint(link, transform(T_link_object, point[None])[0], text)
    return found
