"""Results as types: words for how planning ends, and the dictionaries that plans, motions and checks consist of.

A status is a string: ``plan.status == "solved"`` and ``plan.status is Status.SOLVED`` say the same.
"""

from enum import StrEnum
from typing import TypedDict

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Status(StrEnum):
    """Outcome of planning a keypoint problem. The first two have a trajectory, the others have none."""

    SOLVED = "solved"
    """The whole motion is reachable and clear."""
    PARTIAL = "partial"
    """A part of the motion, where ``allow_partial`` allows it."""
    ACTUATION_INFEASIBLE = "actuation_infeasible"
    """No joint values meet the constraints."""
    UNREACHABLE = "unreachable"
    """A keyframe is out of reach from every actuation pose tried."""
    COLLISION = "collision"
    """Something is in the way from every actuation pose tried."""
    START_IN_COLLISION = "start_in_collision"
    """The robot is deeper inside something at the start than ``start_depth``."""
    TOO_FAST = "too_fast"
    """The clock asks for more than the joints' limits give."""
    CANNOT_STOP = "cannot_stop"
    """No motion from the state at the start stays within the joints' limits."""
    UNTIMED = "untimed"
    """A path was found, and no motion along it that keeps the limits from the start on."""
    NOT_FOUND = "not_found"
    """The search ended without a motion; there may be one."""
    CANCELLED = "cancelled"
    """Planning was cancelled."""


class MotionStatus(StrEnum):
    """Outcome of planning a motion to a goal."""

    SOLVED = "solved"
    """There is a motion."""
    START_BLOCKED = "start_blocked"
    """The start is in collision."""
    GOALS_BLOCKED = "goals_blocked"
    """Every goal is in collision."""
    UNREACHABLE = "unreachable"
    """No joint values bring the link to the pose."""
    NOT_FOUND = "not_found"
    """The search ended without a motion; there may be one."""
    UNTIMED = "untimed"
    """A free way was found, and no motion along it that keeps the limits."""
    CANNOT_STOP = "cannot_stop"
    """No motion from the state at the start stays within the joints' limits."""
    LATE = "late"
    """The deadline passed."""
    CANCELLED = "cancelled"
    """Planning was cancelled."""


class Residual(TypedDict):
    """A constraint at a pose; metres or radians."""

    name: str
    residual: float
    tolerance: float
    satisfied: bool


class Keyframe(TypedDict):
    """A pose of the hand that a motion passes."""

    label: str
    """"pre_1", "pre_0", "actuation", "post_0", "let_go"."""
    time: float | None
    """s on the motion's clock; None where it is not reached."""
    T_base_hand: Array
    """(4, 4)"""
    reached: bool


class Collision(TypedDict):
    """Obstacle to a motion."""

    bodies: tuple[str, str]
    time: float | None
    """s; None where the motion has no time there."""
    toward: str
    """Keyframe of the segment."""
    distance: float
    """m, negative where they overlap."""
    point: Array
    """(3,)"""


class TightPair(TypedDict):
    """Bodies that are nearer than the margin at the start or at a keyframe, though they may not touch."""

    bodies: tuple[str, str]
    at: str
    """"start" or a keyframe."""
    distance: float
    """m"""


class Touch(TypedDict):
    """Bodies that overlap at a keyframe, and may."""

    bodies: tuple[str, str]
    at: str
    """Keyframe."""
    depth: float
    """m"""


class Guess(TypedDict):
    """A motion that moves the object's joint by an amount that is a guess."""

    toward: str
    """Keyframe."""
    travel: float
    """rad or m"""
    depth: float
    """m of overlap that is let pass for it."""


class TriedPose(TypedDict):
    """Outcome of an actuation pose."""

    q: Array
    """(n,)"""
    rank: int
    """0 for the cheapest."""
    status: Status
    reason: str


class CpuTimes(TypedDict):
    """Thread CPU times of planning, ms."""

    setup: float
    """The world compiled, and the start looked at."""
    actuation: float
    trajectory: float
    total: float


class CheckedPair(TypedDict):
    """Two bodies and how near they are to each other."""

    bodies: tuple[str, str]
    distance: float
    """m, negative where they overlap."""
    point: Array
    """(3,)"""


class ActuationPose(TypedDict):
    """Joint values that meet the constraints."""

    q: Array
    """(n,)"""
    cost: float


class Clearances(TypedDict):
    """Smallest signed distances along a motion, m; None where nothing is checked within a metre."""

    self: float | None
    table: float | None
    object: float | None


class GraspQuality(TypedDict):
    """Terms of a grasp's rank."""

    friction_margin: float
    """rad inside the friction cone"""
    contact: float
    """Part of a pad that touches."""
    lever: float
    """m, of gravity about the middle between the pads"""
    clearance: float
    """m, kept by the open hand"""
    tilt: float
    """rad between approach and straight down"""


class Refined(TypedDict):
    """A shorter waypoint path."""

    waypoints: Array
    """(N, n)"""
    times: Array
    """(N,) s"""
    keyframes: list[int]
    """Numbers of their waypoints."""
    cost_before: float
    cost_after: float
    rounds: int
