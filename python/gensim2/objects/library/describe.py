"""Describe an object as JSON data."""

from __future__ import annotations

from typing import Any

import numpy as np

from gensim2.objects.library.catalogue import Library
from gensim2.objects.shapes import transform
from gensim2.objects.types import ArticulatedObject, ObjectModel, RigidObject


def describe(library: Library, model: ArticulatedObject | RigidObject) -> dict[str, Any]:
    """Return the description of an object as plain data, in metres, kg and rad (metres for prismatic joints).

    ``size`` (3,) is the bounding box of the closed object in the root frame. ``split`` is ``"train"``, ``"test"``, or
    ``"none"`` for an object that is not listed. ``joint`` is None for a rigid object. Only articulated objects have
    ``object_axis``, ``default_openness`` and ``urdf``. Only rigid objects have ``grip``, ``friction`` and ``folder``.
    """
    common = {
        "class": model.asset_class,
        "id": model.id,
        "kind": library.kind(model.asset_class),
        "description": library.describe(model.asset_class),
        "source": model.source,
        "license": model.license,
        "split": split_of(library, model),
        "mass": model.mass,
        "keypoints": {
            name: {"link": k.link, "position": k.position.tolist(), "description": k.description}
            for name, k in model.keypoints.items()
        },
        "placement": {"position": model.placement.position.tolist(), "quaternion": model.placement.quaternion.tolist()},
        "hulls": {link: len(hulls) for link, hulls in model.hulls.items()},
        "content_hash": model.content_hash,
        "warnings": list(model.warnings),
    }
    return {**common, **(_of_rigid(model) if isinstance(model, RigidObject) else _of_articulated(model))}


def _of_rigid(rigid: RigidObject) -> dict[str, Any]:
    grip = rigid.grip
    return {
        "size": rigid.size.round(6).tolist(),
        "joint": None,
        "friction": rigid.friction,
        "grip": {"point": grip.point.tolist(), "axis": grip.axis.tolist(), "width": grip.width},
        "folder": str(rigid.folder),
    }


def _of_articulated(instance: ArticulatedObject) -> dict[str, Any]:
    joint = instance.joint
    T = instance.link_pose(0.0)
    points = np.concatenate(
        [
            transform(T, hull) if link == joint.child_link else hull
            for link, hulls in instance.hulls.items()
            for hull in hulls
        ]
    )
    return {
        "size": np.ptp(points, axis=0).round(6).tolist(),
        "joint": {
            "name": joint.name,
            "type": joint.type,
            "child_link": joint.child_link,
            "lower": joint.lower,
            "upper": joint.upper,
            "origin": joint.origin.tolist(),
            "axis": joint.axis.tolist(),
            "friction": joint.friction,
            "damping": joint.damping,
        },
        "object_axis": instance.object_axis,
        "default_openness": instance.default_openness,
        "urdf": str(instance.urdf),
    }


def split_of(library: Library, model: ObjectModel) -> str:
    """Return the split of an object: ``"train"``, ``"test"`` or ``"none"``."""
    if model.id in library.split(model.asset_class, "train"):
        return "train"
    return "test" if model.id in library.instances(model.asset_class) else "none"
