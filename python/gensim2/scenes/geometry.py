"""Compute geometric data for success criteria: the extents of objects, and the objects inside a container."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects import RigidObject
from gensim2.objects.meshwork.interior import inner_box
from gensim2.objects.types import BODY, ArticulatedObject

Model = ArticulatedObject | RigidObject

INSIDE = "inside"
"""Word in the name of a container's measured keypoint."""


def measured_link(model: Model) -> str:
    """Return the link that the criteria measure: the link of the last keypoint, or ``BODY`` of a rigid object."""
    return list(model.keypoints.values())[-1].link if isinstance(model, ArticulatedObject) else BODY


def is_container(model: Model) -> bool:
    """Return whether other objects can be put inside. The last keypoint of a container has "inside" in its name."""
    return isinstance(model, ArticulatedObject) and INSIDE in list(model.keypoints)[-1]


def bounds_of(models: Mapping[str, Model], poses: Mapping[str, Array]) -> dict[str, Array]:
    """Return the lowest and highest corner (2, 3) of each object's box in the world frame, metres.

    The box of an articulated object encloses the measured link only.

    Args:
        poses: pose (4, 4) of each object's measured link (:func:`measured_link`) in the world frame.
    """
    found = {}
    for name, model in models.items():
        hulls = model.hulls.get(measured_link(model), ())
        if hulls:
            corners = np.concatenate(hulls) @ poses[name][:3, :3].T + poses[name][:3, 3]
            found[name] = np.stack([corners.min(axis=0), corners.max(axis=0)])
    return found


def contents_of(models: Mapping[str, Model], poses: Mapping[str, Array]) -> dict[str, frozenset[str]]:
    """Return for each container the rigid objects whose boxes have their centres inside it.

    Args:
        poses: pose (4, 4) of each object's measured link in the world frame.
    """
    centres = {}
    for name, model in models.items():
        if isinstance(model, RigidObject):
            corners = np.concatenate(model.hulls[BODY])
            middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
            centres[name] = poses[name][:3, :3] @ middle + poses[name][:3, 3]
    return {
        name: frozenset(thing for thing, centre in centres.items() if _is_inside(model, poses[name], centre))
        for name, model in models.items()
        if is_container(model)
    }


def _is_inside(container: Model, pose: Array, point: Array) -> bool:
    hulls = container.hulls.get(measured_link(container), ())
    if not hulls or not np.isfinite(point).all():
        return False
    T_link_world: Array = np.linalg.inv(pose).astype(np.float64)
    measured = list(container.keypoints.values())[-1].position
    box = inner_box(hulls, np.asarray(measured), T_link_world[:3, 2])
    return box is not None and box.contains(T_link_world[:3, :3] @ point + T_link_world[:3, 3])
