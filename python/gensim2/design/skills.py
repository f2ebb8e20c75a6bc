"""Provide the offline designer's strategies, which move joints, grasp objects and place objects of any class.

Many strategies come from the library (``gensim2/tasks/library/strategies``). These strategies are defined in the joint
frame, so they fit any class. Strategies that place objects are computed from sizes. The planner uses the first strategy
of a step that has a plan.
"""

from __future__ import annotations

import copy
import itertools
from typing import Any, Literal

import numpy as np

from gensim2.design.affordance import Affordance
from gensim2.planning.scene import CENTER, MEASURED
from gensim2.tasks.library import shared_strategy
from gensim2.tasks.strategies import Strategies

Way = Literal["open", "close"]

#: Names of the library's strategies that open or close a joint, for each joint type.
_JOINTS: dict[tuple[str, Way], tuple[str, ...]] = {
    ("revolute", "open"): (
        "hook_door_inside",
        "hook_door_deep_inside",
        "hook_door_turning",
        "open_door_by_its_handle",
        "open_box",
        "open_box_from_below",
    ),
    ("revolute", "close"): (
        "close_door_straight",
        "close_door_turning",
        "close_door_from_above",
        "close_door_by_its_middle",
        "close_box",
        "close_box_from_afar",
    ),
    ("prismatic", "open"): (
        "open_drawer_from_inside",
        "open_drawer_from_deep_inside",
        "open_drawer_over_the_front",
        "open_drawer_from_above",
        "open_drawer_from_the_front",
        "push_forward_from_above",
        "push_forward_level",
    ),
    ("prismatic", "close"): ("close_drawer_from_the_front", "close_drawer_from_the_side"),
}

#: Grasp strategies, in order of preference.
_GRASPS = ("grasp", "grasp_from_any_side", "grasp_from_the_side")

_IN_DRAWERS = (
    "place_deep_in_drawer",
    "place_in_drawer",
    "drop_into_drawer_from_above",
    "place_in_drawer_from_the_front",
    "drop_into_drawer_from_the_front",
)
_IN_BOXES = ("place_deep_in_box", "place_in_box", "drop_into_box")

#: Finger directions for reaching into a container from the front, each with its angular tolerance (rad).
_INTO = (((0.87, 0.42, -0.25), 0.7), ((0.9, 0.1, -0.42), 0.8), ((1.0, 0.0, 0.0), 0.6), ((0.6, 0.3, -0.74), 0.9))

#: Heights in metres above the floor of a cabinet at which an object is released, lowest first.
_ABOVE_FLOOR = (0.012, 0.03, 0.06)

#: Minimum distance in metres from the centre of a rigid object to its measured keypoint for the object to be long.
LONG = 0.055

#: Distance in metres to either side of the middle of a container at which each of two objects is placed.
ASIDE = 0.025

#: Number of strategies for a container that are tried first with a level object, if the object is long.
LYING = 8

#: Maximum distance in metres of the measured keypoint of a long object from the goal.
LYING_NEAR = 0.02

#: Motions that carry a grasped object in each hand-over direction. Solver configs use the same names of motions.
_HANDING: dict[str, tuple[str, ...]] = {
    "left": ("move-left", "move-left"),
    "right": ("move-right", "move-right"),
    "away": ("move-forward",),
}

#: Depths in metres below the top of an object at which the object is grasped to be handed over.
_DEPTHS = (0.02, 0.03)

#: Gaps in metres between the released object and its support, lowest first.
_ABOVE_SUPPORT = (0.008, 0.02, 0.035)


def joint_ways(thing: Affordance, way: Way, openness: float | None = None) -> Strategies:
    """Return the library's strategies that move a joint to ``openness``, or to the joint limit if it is None."""
    found = {name: shared_strategy(name) for name in _JOINTS[thing.joint_type or "revolute", way]}
    if openness is None:
        return found
    return {f"{name}_halfway": stopping(data, openness) for name, data in found.items()}


def stopping(strategy: dict[str, Any], openness: float) -> dict[str, Any]:
    """Return a copy of the strategy whose joint motion ends at ``openness``."""
    changed = copy.deepcopy(strategy)
    changed["post_actuation_motions"] = [
        [motion[0], openness] if isinstance(motion, list) and str(motion[0]).endswith("_joint_to") else motion
        for motion in changed.get("post_actuation_motions", [])
    ]
    return changed


def grasps() -> Strategies:
    """Return the strategies that grasp a rigid object."""
    return {name: shared_strategy(name) for name in _GRASPS}


def places_in(container: Affordance, thing: Affordance, aside: float = 0.0) -> Strategies:
    """Return strategies that put the grasped object into an articulated container.

    Args:
        container: class of the container.
        thing: class of the grasped object.
        aside: distance to the left of the measured keypoint of the container, m.
    """
    found: Strategies = {}
    lowered = 0.0
    if container.joint_type == "prismatic" or container.joint_axis == "level":
        for name in _IN_DRAWERS if container.joint_type == "prismatic" else _IN_BOXES:
            found[name] = copy.deepcopy(shared_strategy(name))
            place = found[name]["constraint_list"][0]
            place["keypoint_name"] = MEASURED
            # In the object's frame, y points up, z out of the front, and x to the right.
            axis, sign = (1, 1.0) if place["target_offset_frame"] == "world" else (0, -1.0)
            place["target_offset"][axis] += sign * aside
    else:
        lowered = (thing.size[2] - min(thing.size)) / 2
        for above, (number, (direction, tolerance)) in itertools.product(_ABOVE_FLOOR, enumerate(_INTO)):
            offset = (-0.01, aside, round(above + thing.size[2] / 2, 4))
            found[f"reach_in_{1000 * above:.0f}_{number}"] = {
                **_pose(MEASURED, "floor", offset, 0.01, direction, tolerance, [["translate_z", -0.12]]),
                "gripper": "release",
                "let_go": 0.12,
            }
    reach, level = float(np.linalg.norm(thing.measured_at)), dict[str, dict[str, Any]]()
    if reach > LONG:
        level = {f"lay_{name}": _lying(way, reach, lowered) for name, way in list(found.items())[:LYING]}
        if container.interior is not None and thing.size[2] > 2.0 * container.interior[2]:
            return level  # The middle of the standing object would be above the container.
    for way in found.values():
        place = way["constraint_list"][0]
        place["target_offset"][_upward(place)] += thing.measured_at[2]
    return {**level, **found}


def places_on(support: Affordance, thing: Affordance) -> Strategies:
    """Return strategies that put the object onto or into a rigid object.

    The strategies are ordered by release height, lowest first.
    """
    hollow = min(thing.size[:2]) < 0.6 * min(support.size[:2]) and support.size[2] > 0.03
    base = thing.size[2] / 2 - (support.size[2] / 2 - 0.012 if hollow else -support.size[2] / 2)
    return {
        f"put_{'in' if hollow else 'on'}_{1000 * gap:.0f}": {
            **_from_above(CENTER, (0.0, 0.0, round(base + gap, 4)), 0.015, 0.7, ["move-up"]),
            "gripper": "release",
            "let_go": 0.1,
        }
        for gap in _ABOVE_SUPPORT
    }


def hand_overs(thing: Affordance, direction: str) -> Strategies:
    """Return strategies that hand over a round object: grasp from above, lift, and carry a short distance."""
    found: Strategies = {}
    for depth in _DEPTHS:
        height = max(0.0, thing.size[2] / 2 - depth)
        way = _from_above("tool_head", (0.0, 0.0, round(height, 4)), 0.003, 0.3, [["translate_z", -0.1]])
        motions = ["move-up", *_HANDING[direction]]
        found[f"hand_{direction}_{1000 * depth:.0f}"] = {**way, "gripper": "grasp", "post_actuation_motions": motions}
    return found


def _upward(constraint: dict[str, Any]) -> int:
    """Return the index of the vertical axis in the frame of a constraint's offset."""
    return 2 if constraint["target_offset_frame"] == "world" else 1


def _lying(strategy: dict[str, Any], reach: float, lowered: float) -> dict[str, Any]:
    """Return a copy of a strategy that puts a long object down level and lower by ``lowered`` (m), with its measured
    keypoint and its centre near the goal. The two points have the distance ``reach`` (m).
    """
    changed = copy.deepcopy(strategy)
    place, *others = changed["constraint_list"]
    place["target_offset"][_upward(place)] -= lowered
    place["tolerance"] = LYING_NEAR
    center = {**place, "keypoint_name": CENTER, "tolerance": round(reach, 3)}
    level = {
        "type": "frame_axis_orthogonal",
        "axis_from_keypoint_name": CENTER,
        "axis_to_keypoint_name": MEASURED,
        "target_axis": [0.0, 0.0, 1.0],
        "target_axis_frame": "world",
        "target_inner_product": 0.0,
        "tolerance": 0.2,
    }
    changed["constraint_list"] = [place, center, *others, level]
    return changed


def _from_above(
    keypoint: str, offset: tuple[float, float, float], tolerance: float, lean: float, before: list[Any]
) -> dict[str, Any]:
    return _pose(keypoint, CENTER, offset, tolerance, (0.0, 0.0, -1.0), lean, before)


def _pose(
    keypoint: str,
    target: str,
    offset: tuple[float, float, float],
    tolerance: float,
    direction: tuple[float, float, float],
    lean: float,
    before: list[Any],
) -> dict[str, Any]:
    return {
        "constraint_list": [
            {
                "type": "point2point_constraint",
                "keypoint_name": keypoint,
                "target_keypoint_name": target,
                "target_offset": list(offset),
                "target_offset_frame": "world",
                "tolerance": tolerance,
            },
            {
                "type": "frame_axis_parallel",
                "axis_from_keypoint_name": "tool_tail",
                "axis_to_keypoint_name": "tool_head",
                "target_axis": list(direction),
                "target_axis_frame": "world",
                "target_inner_product": 1.0,
                "tolerance": lean,
            },
        ],
        "pre_actuation_motions": before,
    }
