"""Check an object's geometry without simulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.objects.meshwork.convexes import ConvexBlock, depth_inside, surface_samples
from gensim2.objects.meshwork.voidspace import OPENNESS, links_overlap
from gensim2.objects.shapes import transform
from gensim2.objects.types import ArticulatedObject

OVERLAP = 1.0  # mm, maximum overlap of moving link and body outside the hinge region
BASE_GAP = 1.0  # mm, maximum distance between the object's lowest point and the table
FREE_GAP = 10.0  # mm, minimum distance of a free-space keypoint from each link of the open object
SURFACE_GAP = 10.0  # mm, maximum distance of a surface keypoint from its link
MASS = (0.02, 80.0)  # kg, minimum and maximum mass
# N, the object fails the check if a larger force at the keypoint is needed to overcome the joint's friction
PUSH = 40.0
MAX_HULLS = 64  # maximum number of hulls of a link
FREE = ("above", "inside", "base")  # a keypoint with one of these words in its name lies in free space


@dataclass(frozen=True)
class Finding:
    """A failed check of an object: the measured value is beyond the limit."""

    check: str
    value: float | str
    limit: float | str


def distance_to_link(instance: ArticulatedObject, name: str) -> float:
    """Return the distance (m) of a keypoint from sampled points on the hulls of its link.

    The distance is 0 if the keypoint is inside a hull.
    """
    keypoint = instance.keypoints[name]
    hulls = list(instance.hulls.get(keypoint.link, ()))
    if not hulls:
        return float("inf")
    point = keypoint.position[None]
    if float(depth_inside(point, [ConvexBlock.of(h) for h in hulls])[0]) > 0:
        return 0.0
    samples = np.concatenate([surface_samples(h, 0.004) for h in hulls])
    return float(np.linalg.norm(samples - point, axis=1).min())


def geometric_findings(instance: ArticulatedObject) -> list[Finding]:
    """Run all checks that need no simulation. Return the checks that failed and the warnings from reading the files."""
    joint = instance.joint
    found = [Finding("note", warning, "none") for warning in instance.warnings]

    def at_most(check: str, value: float, limit: float) -> None:
        if not value <= limit:
            found.append(Finding(check, round(value, 4), limit))

    for link, hulls in instance.hulls.items():
        at_most(f"hulls of {link}", len(hulls), MAX_HULLS)
    found += overlap_findings(instance)
    R, position = instance.placement.rotation, instance.placement.position
    still = [h for link, hulls in instance.hulls.items() if link != joint.child_link for h in hulls]
    lowest = np.inf
    head = (
        "articulated_object_head" if "articulated_object_head" in instance.keypoints else next(iter(instance.keypoints))
    )
    for share in OPENNESS:
        T = instance.link_pose(share)
        points = np.concatenate(still + [transform(T, h) for h in instance.hulls[joint.child_link]])
        lowest = min(lowest, float((points @ R.T)[:, 2].min()) + float(position[2]))
    at_most("base above the table, mm", 1000 * abs(lowest), BASE_GAP)
    for name in instance.keypoints:
        if not any(word in name for word in FREE):
            at_most(f"{name} from its link, mm", 1000 * distance_to_link(instance, name), SURFACE_GAP)
        else:
            clearance = 1000 * clearance_of(instance, name)
            if not clearance >= FREE_GAP:
                found.append(Finding(f"clearance of {name} when open, mm", round(clearance, 4), FREE_GAP))
    if not MASS[0] <= instance.mass <= MASS[1]:
        found.append(Finding("mass, kg", round(instance.mass, 3), f"{MASS[0]}..{MASS[1]}"))
    lever = instance.lever_arm(head) if joint.type == "revolute" else 1.0
    at_most("push at the keypoint, N", joint.friction / max(lever, 1e-3), PUSH)
    return found


def overlap_findings(instance: ArticulatedObject) -> list[Finding]:
    """Return findings about overlaps between the two links of an object.

    The region around the hinge is not examined. A finding states whether the meshes overlap or only the convex hulls.
    """
    overlap = links_overlap(instance, OVERLAP / 1000)
    found = []
    if 1000 * overlap.meshes > OVERLAP:
        found.append(Finding("overlap of the meshes, mm", round(1000 * overlap.meshes, 4), OVERLAP))
    if 1000 * overlap.filled > OVERLAP:
        found.append(Finding("overlap of the convex parts, mm", round(1000 * overlap.filled, 4), OVERLAP))
    if not found and 1000 * overlap.parts > OVERLAP:
        found.append(Finding("overlap of the convex parts, mm", round(1000 * overlap.parts, 4), OVERLAP))
    return found


def clearance_of(instance: ArticulatedObject, name: str) -> float:
    """Return the distance (m) of a keypoint from the hulls of both links, with an open joint.

    The distance is negative inside a hull.
    """
    keypoint, child = instance.keypoints[name], instance.joint.child_link
    T = instance.link_pose(1.0)
    point = transform(T, keypoint.position[None]) if keypoint.link == child else keypoint.position[None]
    nearest = np.inf
    for link, hulls in instance.hulls.items():
        if not hulls:
            continue
        local = transform(np.asarray(np.linalg.inv(T), float), point) if link == child else point
        inside = float(depth_inside(local, [ConvexBlock.of(hull) for hull in hulls])[0])
        samples = np.concatenate([surface_samples(hull, 0.004) for hull in hulls])
        gap = -inside if inside > 0 else float(np.linalg.norm(samples - local, axis=1).min())
        nearest = min(nearest, gap)
    return nearest
