"""Derive the requirements of a solver config from the problem file: keyframes, constraints, cost, limits."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from peers import Arm

Array = np.ndarray

#: Slack for rounding, metres and radians.
NUMERICAL = 1e-6
BOX = np.array([[0.05, 1.0], [-1.0, 1.0], [0.0, 1.0]])
NAMED = {
    "move-up": (0.0, 0.0, 0.06),
    "move-down": (0.0, 0.0, -0.06),
    "move-left": (0.0, 0.08, 0.0),
    "move-right": (0.0, -0.08, 0.0),
    "move-forward": (0.1, 0.0, 0.0),
    "move-backward": (-0.1, 0.0, 0.0),
}


def rotation(axis: str, angle: float) -> Array:
    """Return the rotation matrix (3, 3) about a coordinate axis."""
    vector = np.eye(3)["xyz".index(axis)]
    cross = np.array([[0, -vector[2], vector[1]], [vector[2], 0, -vector[0]], [-vector[1], vector[0], 0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def angle_between(one: Array, two: Array) -> float:
    """Return the angle (rad) between two rotations or two vectors."""
    if one.ndim == 2:
        difference = one.T @ two
        skew = [
            difference[2, 1] - difference[1, 2],
            difference[0, 2] - difference[2, 0],
            difference[1, 0] - difference[0, 1],
        ]
        return float(np.arctan2(np.linalg.norm(skew), np.trace(difference) - 1.0))
    return float(np.arctan2(np.linalg.norm(np.cross(one, two)), one @ two))


@dataclass
class Keyframe:
    """A hand pose that the config asks for; ``turn`` is (centre, axis, angle) where it is reached on an arc."""

    time: float
    pose: Array
    turn: tuple[Array, Array, float] | None = None


def expected_keyframes(problem: dict[str, Any], T_base_hand: Array, frames: str) -> list[Keyframe]:
    """Derive the keyframes from an actuation pose and the config, in time.

    Pre-actuation motions lead outwards from the actuation pose, the first of the list to the keyframe next to it, and
    so to the last of the pre-actuation times.
    """
    config = problem["config"]
    frame, before = T_base_hand, []
    motions = config["pre_actuation_motions"]
    for time, (kind, amount) in zip(reversed(problem["pre_actuation_times"]), motions, strict=True):
        shift = np.eye(4)
        shift[:3, 3] = amount * np.eye(3)["xyz".index(kind.removeprefix("translate_"))]
        frame = frame @ shift
        before.append(Keyframe(time, frame))
    keyframes = [*reversed(before), Keyframe(problem["actuation_time"], T_base_hand)]
    frame = T_base_hand
    for time, motion in zip(problem["post_actuation_times"], config["post_actuation_motions"], strict=True):
        frame, turn = frame.copy(), None
        if isinstance(motion, str):
            frame[:3, 3] += NAMED[motion]
        elif motion[0] == "rotate":
            T_base_object = np.asarray(problem["T_base_object"])
            center, index = T_base_object[:3, 3], "xyz".index(problem["object_axis"])
            turned = T_base_object[:3, :3] @ rotation(problem["object_axis"], motion[1]) @ T_base_object[:3, :3].T
            turn = (center, T_base_object[:3, index], motion[1])
            frame[:3, 3] = center + turned @ (frame[:3, 3] - center)
            frame[:3, :3] = turned @ frame[:3, :3]
        else:
            step = motion[1] * np.eye(3)["xyz".index(motion[0].removeprefix("translate_"))]
            if frames == "original":
                step = rotation("z", problem["object_yaw"]) @ step
            frame[:3, 3] += frame[:3, :3] @ step
        keyframes.append(Keyframe(time, frame, turn))
    return keyframes


def constraint_errors(problem: dict[str, Any], T_base_hand: Array) -> list[str]:
    """Return a message for each constraint of the config that a hand pose violates."""
    turn, origin = T_base_hand[:3, :3], T_base_hand[:3, 3]
    tool = {name: turn @ point + origin for name, point in problem["tool_keypoints_hand"].items()}
    target = {name: np.asarray(point) for name, point in problem["object_keypoints_base"].items()}
    axes = {
        "world": np.linalg.inv(np.asarray(problem["T_world_base"]))[:3, :3],
        "object": np.asarray(problem["T_base_object"])[:3, :3],
    }
    errors = []
    for index, entry in enumerate(problem["config"]["constraint_list"]):
        name = f"constraint {index} ({entry['type']})"
        if entry["type"] == "point2point_constraint":
            miss = np.abs(tool[entry["keypoint_name"]] - target[entry["target_keypoint_name"]]).max()
            if miss > entry["tolerance"] + NUMERICAL:
                errors.append(f"{name} misses by {1e3 * miss:.2f} mm")
            continue
        own = tool[entry["axis_to_keypoint_name"]] - tool[entry["axis_from_keypoint_name"]]
        if entry["type"].startswith("keypoint_axis"):
            other = target[entry["target_axis_to_keypoint_name"]] - target[entry["target_axis_from_keypoint_name"]]
        else:
            other = axes.get(entry["target_axis_frame"], axes["world"]) @ np.asarray(entry["target_axis"], dtype=float)
        wanted = np.arccos(np.clip(entry["target_inner_product"], -1.0, 1.0))
        miss = abs(angle_between(own, other) - wanted)
        if miss > entry["tolerance"] + 1e-4:
            errors.append(f"{name} misses by {miss:.4f} rad")
    return errors


def pose_cost(problem: dict[str, Any], arm: Arm, q: Array) -> float:
    """Return the original GenSim2's cost of an actuation pose."""
    current = np.asarray(problem["q_current"])
    here, there = arm.hand_pose(current), arm.hand_pose(q)
    weights = np.array([10.0] + [1.0] * 8)
    moved = float(((there[:3, 3] - here[:3, 3]) ** 2).sum())
    return float(weights @ (q - current) ** 2) + moved + 1.0 - np.cos(angle_between(here[:3, :3], there[:3, :3]))


def limit_errors(arm: Arm, q: Array, what: str) -> list[str]:
    """Return errors for joints outside their limits; ``q`` is (9,) or (N, 9)."""
    over = np.maximum(arm.lower - q, q - arm.upper).reshape(-1, len(arm.lower)).max(axis=0)
    return [
        f"{what}: joint {index + 1} leaves its limits by {over[index]:.4f}"
        for index in np.flatnonzero(over > NUMERICAL)
    ]


def between(keyframes: list[Keyframe], time: float) -> tuple[Keyframe, Keyframe] | None:
    """Return the keyframes before and after a time; None before the first keyframe."""
    for one, two in pairwise(keyframes):
        if one.time <= time <= two.time:
            return one, two
    return None


def off_path(one: Keyframe, two: Keyframe, position: Array) -> float:
    """Return the distance (m) of a point from the line or arc between the hand origins of two keyframes."""
    start, end = one.pose[:3, 3], two.pose[:3, 3]
    if two.turn is None:
        along = end - start
        share = np.clip((position - start) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        return float(np.linalg.norm(position - start - share * along))
    center, axis, _ = two.turn
    offset = position - center
    height = offset @ axis - (start - center) @ axis
    arm = start - center - ((start - center) @ axis) * axis
    radius = float(np.linalg.norm(offset - (offset @ axis) * axis) - np.linalg.norm(arm))
    return float(np.hypot(height, radius))
