"""Compute masses, inertias and joint friction, which the files of the GenSim2 release lack."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.shapes import convex_hull

GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class ClassRule:
    """Physical parameters shared by all instances of a class.

    Attributes:
        density: kg per m³ of collision hull. The densities are low, because hulls are solid and real parts are thin
            shells.
        default_openness: mean openness (0 to 1) of the joint when scenes are randomized.
        stance: pose on the table: ``"upright"``, or ``"flat"``, which lies on its back with the front up.
        turn: side that faces the robot. ``"front"``: the front, or the back if the contact keypoint is there.
            ``"swing"``: the side to which the contact keypoint moves as the joint opens. ``"bar"``: for bars along the
            x axis of the model, such as the handle of a bucket; the object is turned by 90 degrees, so that the resting
            fingers are on both sides of the bar.
    """

    density: float
    default_openness: float = 0.5
    stance: Literal["upright", "flat"] = "upright"
    turn: Literal["front", "swing", "bar"] = "front"


CLASS_RULES: dict[str, ClassRule] = {
    "bag_lift": ClassRule(60, 0.0, turn="bar"),
    "bag_move": ClassRule(60, 0.0),
    "bag_swing": ClassRule(60),
    "bottle_cap": ClassRule(400),
    "box_move": ClassRule(150, 0.0),
    "box_rotate": ClassRule(300),
    "bucket_lift": ClassRule(300, 0.0, turn="bar"),
    "bucket_move": ClassRule(300, 0.0),
    "bucket_swing": ClassRule(500, turn="swing"),
    "coffee_machine": ClassRule(300),
    "dishwasher": ClassRule(250),
    "door": ClassRule(300),
    "drawer": ClassRule(300),
    "faucet": ClassRule(2000),
    "kitchen_pot": ClassRule(600),
    "laptop_move": ClassRule(800, 0.0),
    "laptop_rotate": ClassRule(800),
    "microwave": ClassRule(300),
    "oven": ClassRule(250),
    "refrigerator": ClassRule(200),
    "safe_move": ClassRule(150, 0.0),
    "safe_rotate": ClassRule(500),
    "stapler_move": ClassRule(1000, 0.0),
    "stapler_press": ClassRule(1000, 1.0),
    "suitcase_move": ClassRule(60, 0.0, stance="flat"),
    "suitcase_rotate": ClassRule(100, stance="flat"),
    "switch": ClassRule(500),
    "toaster_move": ClassRule(150, 0.0),
    "toaster_press": ClassRule(300, 0.0),
    "toilet": ClassRule(300),
    "trash_can": ClassRule(200),
    "washing_machine": ClassRule(250),
    "window_push": ClassRule(250),
    "window_rotate": ClassRule(250),
}
OTHER_CLASS = ClassRule(300)


def class_rule(asset_class: str) -> ClassRule:
    """Return the parameters of a class; ``OTHER_CLASS`` for classes that gensim2 does not know."""
    return CLASS_RULES.get(asset_class, OTHER_CLASS)


@dataclass(frozen=True)
class Inertial:
    """Mass in kg, centre of mass (3,) in metres, and inertia (3, 3) in kg m² about the centre of mass, in link axes."""

    mass: float
    center: Array
    inertia: Array


def hull_moments(points: Array) -> tuple[float, Array, Array]:
    """Return volume, centroid (3,) and second moments (3, 3) about the origin of the hull of points (N, 3).

    The moments of tetrahedra with a common inner corner are added. Each tetrahedron is the image of the unit
    tetrahedron under the matrix of its three edges. The second moments of the unit tetrahedron are 1/60 on the diagonal
    and 1/120 elsewhere.
    """
    hull = convex_hull(points)
    a = points[hull.vertices].mean(axis=0)
    tetra = points[hull.simplices] - a
    det = np.abs(np.linalg.det(tetra))
    volume = float(det.sum() / 6)
    centroid = (det[:, None] * tetra.sum(axis=1)).sum(axis=0) / 24 / volume
    total = tetra.sum(axis=1)
    second = (np.einsum("n,nki,nkj->ij", det, tetra, tetra) + np.einsum("n,ni,nj->ij", det, total, total)) / 120
    shifted = second + volume * np.outer(centroid, a) + volume * np.outer(a, centroid) + volume * np.outer(a, a)
    return volume, centroid + a, shifted


def inertial(hulls: Sequence[Array], density: float) -> Inertial:
    """Return the inertial of a link whose mass is distributed evenly over its hulls, each (N, 3) in the link frame."""
    if not hulls:
        return Inertial(1e-3, np.zeros(3), 1e-6 * np.eye(3))
    moments = [hull_moments(points) for points in hulls]
    volume = sum(v for v, _, _ in moments)
    center = np.asarray(sum(v * c for v, c, _ in moments)) / volume
    second = np.asarray(sum(s for _, _, s in moments)) - volume * np.outer(center, center)
    inertia = density * (np.trace(second) * np.eye(3) - second)
    floor = 1e-8 * np.eye(3)
    return Inertial(density * volume, center, inertia + floor)


def joint_resistance(
    joint_type: str, axis: Array, origin: Array, moving: Inertial, lower: float, upper: float, gravity: Array
) -> tuple[float, float]:
    """Return friction and damping of a joint.

    Friction holds the joint against gravity, but a push can move it.

    Friction is 1.3 times the largest gravity load over the range plus a small amount, which holds joints without load.
    Damping is a small constant plus 0.1 (revolute) or 0.5 (prismatic) times the friction.

    Args:
        joint_type: ``"revolute"`` or ``"prismatic"``.
        axis, origin: direction of the joint axis and a point (3,) on it, m, in the frame of the moving link at joint
            value zero.
        moving: inertial of the moving link, in the same frame.
        lower, upper: joint limits, rad or m.
        gravity: (3,) gravity in the same frame, m/s².

    Returns:
        Friction in N m or N, damping in N m s/rad or N s/m.
    """
    from gensim2.objects.shapes import rotation

    if joint_type == "prismatic":
        load = moving.mass * abs(float(gravity @ axis))
        weight = moving.mass * float(np.linalg.norm(gravity))
        friction = 1.3 * load + 0.15 * weight + 0.3
        return friction, 5.0 + 0.5 * friction
    arm = moving.center - origin
    loads = [
        float(np.cross(rotation(axis, q) @ arm, moving.mass * gravity) @ axis) for q in np.linspace(lower, upper, 41)
    ]
    reach = float(np.linalg.norm(np.cross(axis, arm)))
    friction = 1.3 * max(abs(t) for t in loads) + 0.05 * moving.mass * 9.81 * reach + 0.01
    return friction, 0.02 + 0.1 * friction
