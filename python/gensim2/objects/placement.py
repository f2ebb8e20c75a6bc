"""Compute from an object's geometry how to place the object in front of the robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.objects.model import Model
from gensim2.objects.physics import ClassRule
from gensim2.objects.shapes import rotation, transform
from gensim2.objects.types import Keypoint, Placement


@dataclass(frozen=True)
class PlacementRegion:
    """Region for objects in front of a robot, m. All distances except ``hand_low_point`` are horizontal.

    Attributes:
        base_x: world x of the reference point, which lies under the arm's base. Its world y is 0.
        comfortable: desired distance from the reference point to the contact keypoint, as a mean over the joint's
            range.
        farthest: maximum distance of the contact keypoint over the joint's range, with precedence over
            ``hand_clearance``.
        sideways: maximum lateral offset of the contact keypoint.
        nearest_x: minimum world x of a low object.
        hand_at_rest: world x and y of the hand at the start of an episode.
        hand_low_point: height of the lowest point of the resting hand above the table. Lower objects fit below it.
        hand_clearance: distance of tall objects from the resting hand, for the hand's thickness and random
            displacements.
        hand_half_width: lateral distance within which tall objects keep this clearance: half the hand's width plus a
            reserve.
    """

    base_x: float = -0.615
    comfortable: float = 0.55
    farthest: float = 0.74
    sideways: float = 0.2
    nearest_x: float = -0.27
    hand_at_rest: tuple[float, float] = (-0.21, 0.0)
    hand_low_point: float = 0.22
    hand_clearance: float = 0.13
    hand_half_width: float = 0.2


STANDARD_REGION = PlacementRegion()
"""Region in which all objects are placed. Each robot stands where it reaches this region, so scenes are comparable."""


SAMPLES = 13
LYING = np.array(
    [[0.0, 0, -1], [0, -1, 0], [-1, 0, 0]]
)  # Stance ``flat``: the object lies on its back, so the model's front faces up and its top faces the robot.


def work_keypoint(keypoints: Mapping[str, Keypoint], moving_link: str) -> str:
    """Return the name of the contact keypoint: ``articulated_object_head``, or the moving link's first keypoint."""
    if "articulated_object_head" in keypoints:
        return "articulated_object_head"
    return next((name for name, point in keypoints.items() if point.link == moving_link), next(iter(keypoints)))


def stance(model: Model, rule: ClassRule) -> Array:
    """Return the rotation (3, 3) from root to world: upright or flat, with the contact side facing the robot."""
    tilt = LYING if rule.stance == "flat" else np.eye(3)
    name = work_keypoint(model.keypoints, model.moving_link)
    values = model.lower + (model.upper - model.lower) * np.linspace(0, 1, SAMPLES)
    track = np.array([model.keypoint_in_root(name, q) for q in values]) @ tilt.T
    yaw = 0.0
    if rule.turn == "bar":
        yaw = -np.pi / 2
    elif rule.turn == "swing":
        middle = SAMPLES // 2
        yaw = np.pi if track[middle + 1, 0] > track[middle - 1, 0] else 0.0
    elif rule.stance == "upright":
        points = np.concatenate(model.body.hulls or model.moving.hulls) @ tilt.T
        low, high = points[:, 0].min(), points[:, 0].max()
        start = values[0] + rule.default_openness * (values[-1] - values[0])
        at_start = tilt @ model.keypoint_in_root(name, start)
        yaw = np.pi if at_start[0] > (low + high) / 2 + 0.35 * (high - low) and track[:, 0].min() > low else 0.0
    return np.round(rotation((0, 0, 1), yaw)) @ tilt


def place(model: Model, rule: ClassRule, region: PlacementRegion = STANDARD_REGION) -> Placement:
    """Return the default placement of a model in front of a robot.

    The lowest point at any joint value touches the table. The contact keypoint is at the distance ``comfortable`` from
    the base, or farther if a tall part would be near the resting hand. Its mean position over the range is straight in
    front of the robot.

    Args:
        rule: parameters of its class.
        region: region in front of the robot.
    """
    space, base_x = region, region.base_x
    R = stance(model, rule)
    name = work_keypoint(model.keypoints, model.moving_link)
    body = [transform(np.eye(4), h) @ R.T for h in model.body.hulls]
    swept = []
    track = []
    for share in np.linspace(0, 1, SAMPLES):
        q = model.lower + share * (model.upper - model.lower)
        T = model.T_root_link_at(q)
        swept.append(np.concatenate([transform(T, h) for h in model.moving.hulls]) @ R.T)
        track.append(R @ model.keypoint_in_root(name, q))
    path = np.array(track)
    everything = np.concatenate([*body, *swept])
    z = -float(everything[:, 2].min())

    # Openness values from 0 to 1. An episode usually starts within 0.15 of the default openness.
    shares = np.linspace(0, 1, SAMPLES)
    first, last = max(rule.default_openness - 0.15, 0), min(rule.default_openness + 0.15, 1)
    usual = path[(shares >= first - 0.2) & (shares <= last + 0.2)]
    y = -float(np.clip(usual[:, 1].mean(), -space.sideways, space.sideways))
    sideways = float(usual[:, 1].mean()) + y
    ahead = np.sqrt(space.comfortable**2 - min(abs(sideways), 0.3) ** 2)
    comfortable = base_x + ahead - float(usual[:, 0].mean())

    start = np.concatenate([*body, *swept[int(first * (SAMPLES - 1)) : int(np.ceil(last * (SAMPLES - 1))) + 1]])
    clear = space.nearest_x - float(start[:, 0].min())
    tall = start[(start[:, 2] + z > space.hand_low_point) & (np.abs(start[:, 1] + y) < space.hand_half_width)]
    if len(tall):
        clear = max(clear, space.hand_at_rest[0] + space.hand_clearance - float(tall[:, 0].min()))
    across = np.abs(path[:, 1] + y)
    farthest = float((base_x + np.sqrt(np.maximum(space.farthest**2 - across**2, 0)) - path[:, 0]).min())
    x = max(comfortable, min(clear, farthest))
    quaternion = Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True) + 0.0
    return Placement(position=np.array([x, y, z]).round(6) + 0.0, quaternion=quaternion)
