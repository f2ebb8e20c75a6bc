"""What is known of one object, as plain values."""

from __future__ import annotations

from typing import Any

import numpy as np

from gensim2.objects.library.articulated import Library
from gensim2.objects.meshwork.overlap import link_pose
from gensim2.objects.shapes import transform
from gensim2.objects.types import Instance


def describe(library: Library, instance: Instance) -> dict[str, Any]:
    """Everything about an instance that a person asks for; metres, kg, rad, and the units of ``MovingJoint``.

    ``size`` is (3,) of the closed object's bounding box in the root frame; ``split`` says whether the paper's
    protocol trains or tests on it (``"none"``: not one of the library's listed instances).
    """
    joint = instance.joint
    T = link_pose(instance, 0.0)
    points = np.concatenate(
        [
            transform(T, hull) if link == joint.child_link else hull
            for link, hulls in instance.hulls.items()
            for hull in hulls
        ]
    )
    return {
        "class": instance.asset_class,
        "id": instance.id,
        "description": library.describe(instance.asset_class),
        "source": instance.source,
        "license": instance.license,
        "split": split_of(library, instance),
        "mass": instance.mass,
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
        "keypoints": {
            name: {"link": k.link, "position": k.position.tolist(), "description": k.description}
            for name, k in instance.keypoints.items()
        },
        "object_axis": instance.object_axis,
        "default_openness": instance.default_openness,
        "placement": {
            "position": instance.placement.position.tolist(),
            "quaternion": instance.placement.quaternion.tolist(),
        },
        "hulls": {link: len(hulls) for link, hulls in instance.hulls.items()},
        "urdf": str(instance.urdf),
        "content_hash": instance.content_hash,
        "warnings": list(instance.warnings),
    }


def split_of(library: Library, instance: Instance) -> str:
    """``"train"``, ``"test"`` or ``"none"``."""
    if instance.id in library.split(instance.asset_class, "train"):
        return "train"
    return "test" if instance.id in library.instances(instance.asset_class) else "none"
