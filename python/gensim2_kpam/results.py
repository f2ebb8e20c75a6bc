"""Define planning statuses, and the dictionaries that plans, motions and checks contain.

A status is a string: ``plan.status == "solved"`` and ``plan.status is Status.SOLVED`` are equivalent.
"""

from enum import StrEnum
from typing import Literal, TypedDict

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Status(StrEnum):
    """Status of a planned keypoint problem. Only plans with the status ``SOLVED`` or ``PARTIAL`` have a trajectory."""

    SOLVED = "solved"
    """The whole motion is reachable and collision-free."""
    PARTIAL = "partial"
    """Only part of the motion was found, and ``allow_partial`` permits it."""
    ACTUATION_INFEASIBLE = "actuation_infeasible"
    """No joint values meet the constraints."""
    UNREACHABLE = "unreachable"
    """For every tried actuation pose, a keyframe is out of reach."""
    COLLISION = "collision"
    """For every tried actuation pose, an obstacle blocks the motion."""
    START_IN_COLLISION = "start_in_collision"
    """At the start, the robot overlaps a body by more than ``start_depth``."""
    TOO_FAST = "too_fast"
    """The times given in the config require more than the joints' limits allow."""
    CANNOT_STOP = "cannot_stop"
    """No motion from the start state stays within the joints' limits."""
    UNTIMED = "untimed"
    """A path was found, but no motion along it within the limits."""
    NOT_FOUND = "not_found"
    """The search ended without a motion; one may exist."""
    CANCELLED = "cancelled"
    """Planning was cancelled."""


class MotionStatus(StrEnum):
    """Status of a planned motion to a goal."""

    SOLVED = "solved"
    """A motion was found."""
    START_BLOCKED = "start_blocked"
    """The start is in collision."""
    GOALS_BLOCKED = "goals_blocked"
    """Every goal is in collision."""
    UNREACHABLE = "unreachable"
    """No joint values bring the link to the goal pose, or the hand cannot follow a line."""
    NOT_FOUND = "not_found"
    """The search ended without a motion; one may exist."""
    UNTIMED = "untimed"
    """A collision-free path was found, but no motion along it within the limits."""
    OVERLOADED = "overloaded"
    """A torque limit does not suffice to hold the robot and its payload at the start, at the goal, or on the path."""
    CANNOT_STOP = "cannot_stop"
    """No motion from the start state stays within the joints' limits."""
    LATE = "late"
    """The time limit has passed."""
    CANCELLED = "cancelled"
    """Planning was cancelled."""


class ServoStatus(StrEnum):
    """How a step of :class:`Servo` was chosen."""

    TRACKING = "tracking"
    """The arm moves as the target asks."""
    LIMITED = "limited"
    """Limits or obstacles change the motion that the target asks for."""
    BRAKING = "braking"
    """No step toward the target was proven safe; the arm follows the stop that was proven last."""


class Residual(TypedDict):
    """Remaining error of a constraint at the actuation pose. The field ``residual`` is the error, and ``tolerance`` is
    the largest permitted error, both in metres or radians.
    """

    name: str
    residual: float
    tolerance: float
    satisfied: bool


class Keyframe(TypedDict):
    """A pose of the hand that a motion passes through."""

    label: str
    """Name of the keyframe: "pre_1", "pre_0", "actuation", "post_0", "let_go"."""
    time: float | None
    """Time at which the motion passes the keyframe, s; None if not reached."""
    T_base_hand: Array
    """Pose (4, 4) of the hand in the base frame."""
    reached: bool


class LinkPair(TypedDict):
    """Two links of a robot, and how often they overlap in random configurations."""

    links: tuple[str, str]
    relation: Literal["adjacent", "always", "sometimes", "never"]
    """"adjacent" if a joint connects the links; otherwise how often they overlap."""
    fraction: float
    """Fraction of the random configurations in which the links overlap, 0 to 1."""
    checked: bool
    """Whether motions are checked for collisions of the two links."""


class Collision(TypedDict):
    """A collision that blocks a motion."""

    bodies: tuple[str, str]
    time: float | None
    """Time of the collision, s; None if the colliding part of the motion was not timed."""
    toward: str
    """Name of the keyframe at the end of the segment."""
    distance: float
    """Distance in m, negative if the bodies overlap."""
    point: Array
    """Point (3,) in the base frame."""


class TightPair(TypedDict):
    """Two bodies that must not touch but are closer than the margin at the start or at a keyframe."""

    bodies: tuple[str, str]
    at: str
    """"start" or the name of a keyframe."""
    distance: float
    """Distance between the two bodies, m."""


class Touch(TypedDict):
    """Two bodies whose overlap at a keyframe is permitted."""

    bodies: tuple[str, str]
    at: str
    """Name of the keyframe."""
    depth: float
    """Depth of the overlap, m."""


class Guess(TypedDict):
    """A segment of a motion for which the planner can only estimate how far the object's joint moves. Because of this
    uncertainty, the planner tolerates some overlap of bodies in the segment.
    """

    toward: str
    """Name of the keyframe at the end of the segment."""
    travel: float
    """Estimated travel, rad or m."""
    depth: float
    """Overlap of bodies that is tolerated because of the estimate, m."""


class TriedPose(TypedDict):
    """Result of planning a motion through one actuation pose. The planner tries several actuation poses, in the order
    of their cost.
    """

    q: Array
    """Joint values (n,), rad or m."""
    rank: int
    """Rank of the pose by cost; 0 has the lowest cost."""
    status: Status
    reason: str


class CpuTimes(TypedDict):
    """CPU times (ms) of the parts of planning, measured in the planning thread."""

    setup: float
    """Time for building the scene and checking the start."""
    actuation: float
    trajectory: float
    total: float


class CheckedPair(TypedDict):
    """Two bodies and the distance between them."""

    bodies: tuple[str, str]
    distance: float
    """Distance in m, negative if the bodies overlap."""
    point: Array
    """Point (3,) in the base frame."""


class ActuationPose(TypedDict):
    """Joint values with which the arm meets the constraints of a problem, and the cost of these values."""

    q: Array
    """Joint values (n,), rad or m."""
    cost: float


class Clearances(TypedDict):
    """Minimum signed distances (m) of the robot along a motion. The field ``self`` is the distance between links of the
    robot, and ``table`` and ``object`` are the robot's distances to the table and to the object. A value is None if the
    distance is at least 1 m during the whole motion.
    """

    self: float | None
    table: float | None
    object: float | None


class GraspQuality(TypedDict):
    """Quantities from which the score of a grasp is computed."""

    friction_margin: float
    """Angle between the line of the contacts and the edge of the friction cone, rad."""
    contact: float
    """Fraction of a pad's area in contact with the object."""
    lever: float
    """Lever arm of gravity about the midpoint of the pads, m."""
    clearance: float
    """Minimum distance between the open hand and all bodies during the approach, m."""
    tilt: float
    """Angle between approach and straight down, rad."""


class Refined(TypedDict):
    """Result of the function ``refine``, which shortens the path of a plan."""

    waypoints: Array
    """Joint values (N, n) at the waypoints, rad or m."""
    times: Array
    """Times (N,) of the waypoints, s."""
    keyframes: list[int]
    """Indices of the waypoints that are keyframes."""
    cost_before: float
    cost_after: float
    rounds: int
