"""Define the options of planning problems and grasp searches."""

from collections.abc import Sequence
from typing import Literal, NotRequired, TypedDict

import numpy.typing as npt

Gripper = Literal["open", "closed", "grasp", "hold", "release"]
"""Finger mode of a config: open or closed throughout, closing at the actuation pose, unchanged (an object is held), or
opening at the actuation pose.
"""

ContactWindow = TypedDict(
    "ContactWindow",
    {"links": Sequence[str], "bodies": Sequence[str], "from": str, "to": str, "depth": NotRequired[float | None]},
)
"""Links and grasped bodies that may overlap bodies of the scene between two keyframes, which are in time order "start",
..., "pre_1", "pre_0", "actuation", "post_0", ..., "let_go", "end". The maximum overlap is ``depth`` (m, 0 to 1), or the
option ``contact_depth`` if omitted.
"""


class Options(TypedDict, total=False):
    """Options of a planning problem for a robot with n joints. Omitted options have their defaults."""

    timing: Literal["limits", "config"] | None
    """"limits": as fast as the limits allow. "config": at the times given in the config; the default for configs with
    times.
    """
    start_time: float
    """Time at which the motion starts, s, measured like the times in the config (0)."""
    velocity_scale: float
    """Fraction of the velocity limits that the motion may use, 0.001 to 1 (0.5)."""
    acceleration_scale: float
    """Fraction of the acceleration and jerk limits that the motion may use, 0.001 to 1 (0.5)."""
    velocity_limits: npt.ArrayLike | None
    """(n,) at least 0.001 rad/s or m/s; default: the URDF's. Required if the URDF has none or 0."""
    acceleration_limits: npt.ArrayLike | None
    """(n,) at least 0.001 per second squared; default: the URDF's, otherwise those of ``limits``."""
    jerk_limits: npt.ArrayLike | None
    """(n,) at least 0.001 per second cubed; default: the URDF's, otherwise those of ``limits``."""
    torque_limits: npt.ArrayLike | None
    """(n,) at least 0.001 N m (N for sliding joints). Torques are computed from the URDF's masses; default: torques are
    not limited. ``Robot.effort`` has the URDF's limits."""
    limits: Literal["panda", "fr3", "plain"] | None
    """"panda" or "fr3" (published by Franka; "fr3" has velocity limits that depend on the position) or "plain" (10
    rad/s^2, 5,000 rad/s^3 for every joint). Default: "plain", and the plan reports assumed limits."""
    start_velocity: npt.ArrayLike | None
    """(n,) velocity at the start, rad/s or m/s, absolute value at most 100; default: zero."""
    start_acceleration: npt.ArrayLike | None
    """(n,) acceleration at the start, rad/s^2 or m/s^2, absolute value at most 1e4; default: zero."""
    contact_speed: float | None
    """Maximum speed (m/s) of the contact point from the actuation on, 0.001 to 1,000; default: no limit."""
    frames: Literal["object", "original"]
    """"object": list-type translations are in the hand frame. "original": they are rotated by the object's yaw."""
    rotate_path: Literal["arc", "chord"]
    """Path of the hand between the keyframes of "rotate" ("arc")."""
    workspace: npt.ArrayLike | None
    """Two corners [[x, y, z], [x, y, z]] (m) of a box in which the hand's origin lies at the actuation pose; None: no
    bounds (None)."""
    joint_weights: npt.ArrayLike | None
    """(n,) weights of squared joint distances in the cost of the actuation pose, 0.001 to 1e6; default: 1 each."""
    margin: float
    """Clearance of the whole motion from bodies that it may not touch, 0 to 0.2 m (0.005). A pair of bodies that is
    closer at the start or end of a segment keeps its distance there, see ``Plan.tight``.
    """
    least_margin: float | None
    """Smaller clearance for a second attempt if no motion keeps ``margin``, 0 to ``margin``, m; default: no second
    attempt.
    """
    contact_depth: float | None
    """Maximum overlap of pairs that may touch, 0 to 1 m (0.003); None: no limit."""
    guess_depth: float
    """Maximum overlap of arm and grasped bodies with the moving link if its travel is estimated, 0 to 0.1 m (0.05)."""
    start_depth: float
    """Maximum overlap of the robot at the start, 0 to 1 m (0.01); the motion first leaves the overlap. A deeper overlap
    gives the status "start_in_collision".
    """
    reach_clearance: float | None
    """Clearance from the handled bodies (moving link, targets, picked bodies) before the actuation pose, 0 to 0.05 m;
    default: hand and fingers may touch these bodies in the last segment. Not with ``contacts``.
    """
    avoid_collisions: bool
    """False: collisions are reported but not avoided (True)."""
    allow_partial: bool
    """True: accept the longest part of the motion after the actuation pose, with status "partial" (False)."""
    finger_width: float | None
    """Value of the finger joints (joints below the hand) during planning, m or rad, within their limits; mimic joints
    follow. Default: as in q_start."""
    num_seeds: int
    """Number of start values for the actuation pose, 1 to 1,000 (64)."""
    num_refinements: int
    """Number of feasible actuation poses that are optimized, 1 to 1,000 (2)."""
    candidates: int
    """Maximum number of actuation poses for which a whole motion is planned, 1 to 1,000 (40)."""
    extra_seeds: int
    """Number of additional start values if no actuation pose allows the motion, at most 100,000 (200)."""
    clearings: int
    """Maximum number of overlapping poses that are moved out of contact if all other poses fail, at most 1,000 (64)."""
    samples: int
    """Maximum number of samples of the path planner for each pose, at most 1,000,000 (2,000)."""
    seed: int
    """Seed of start values and samples, 0 to 1,000,000 (0). Another seed may give another motion."""
    contacts: Sequence[ContactWindow] | None
    """Contact windows that replace the default contact rules."""
    pick: Sequence[str]
    """Names of bodies that move with the hand from the actuation on."""
    release: Sequence[str]
    """Names of attached bodies that stay where they are from the actuation on."""
    joint_travel: npt.ArrayLike | None
    """(number of motions after the actuation,) travel of the joint in each motion (rad or m). Default: given by motions
    that follow or trace the joint, otherwise estimated from the contact point.
    """


class GraspOptions(TypedDict, total=False):
    """Options of a grasp search. Omitted options have their defaults."""

    count: int
    """Maximum number of grasps to return (100)."""
    samples: int
    """Number of surface points from which grasps are derived (256)."""
    per_part: bool
    """Sample every part of the body equally often, so that a small knob of a drawer gets samples, too (False)."""
    trials: int
    """Maximum number of hand poses whose contacts and approach are checked (2,000)."""
    friction: float
    """Friction coefficient between pads and object (0.6)."""
    approach: float
    """Length of the straight approach of the open hand, m (0.1)."""
    clearance: float
    """Minimum distance between the open hand and all bodies, m (0.001)."""
    up: npt.ArrayLike | None
    """Direction (3,) against gravity in the base frame ([0, 0, 1]); None: no gravity."""
    tilt: npt.ArrayLike
    """Minimum and maximum angle (2,) between the approach direction and straight down, rad ([0, pi])."""
