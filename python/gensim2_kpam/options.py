"""Options of problems and of searches for grasps, as types: mappings whose keys and values a type checker knows."""

from collections.abc import Sequence
from typing import Literal, NotRequired, TypedDict

import numpy.typing as npt

Gripper = Literal["open", "closed", "grasp", "hold", "release"]
"""Finger mode of a config: open or closed throughout, closing at the actuation pose, as they are throughout (something
is held), opening at the actuation pose."""

ContactWindow = TypedDict(
    "ContactWindow",
    {"links": Sequence[str], "bodies": Sequence[str], "from": str, "to": str, "depth": NotRequired[float | None]},
)
"""Links (and bodies that ride on the hand) that may overlap bodies of the scene between two keyframes: in time "start",
..., "pre_1", "pre_0", "actuation", "post_0", ..., "let_go", "end"; by ``depth`` (m, 0 to 1), else by the option
``contact_depth``."""


class Options(TypedDict, total=False):
    """Options of a problem; n is the number of the robot's joints. What is left out takes its default."""

    timing: Literal["limits", "config"] | None
    """"limits": as fast as they allow. "config": on the config's clock; the default where the config sets a time."""
    start_time: float
    """Time of the first waypoint on that clock, s (0)."""
    velocity_scale: float
    """Fraction of the velocity limits, 0.001 to 1 (0.5)."""
    acceleration_scale: float
    """Fraction of the acceleration and jerk limits, 0.001 to 1 (0.5)."""
    velocity_limits: npt.ArrayLike | None
    """(n,) from 0.001 rad/s or m/s; default the URDF's; needed where it has none, or 0."""
    acceleration_limits: npt.ArrayLike | None
    """(n,) from 0.001 per second squared; default the URDF's, else those of ``limits``."""
    jerk_limits: npt.ArrayLike | None
    """(n,) from 0.001 per second cubed; default the URDF's, else those of ``limits``."""
    torque_limits: npt.ArrayLike | None
    """(n,) from 0.001 N m (N for sliding joints), by inverse dynamics of the URDF's masses; default: torques are not
    looked at. ``Robot.effort`` has the URDF's."""
    limits: Literal["panda", "fr3", "plain"] | None
    """"panda" or "fr3" (as Franka publishes them; "fr3" has velocity limits that depend on the position) or "plain"
    (10 rad/s^2, 5,000 rad/s^3 every joint); default "plain", and the plan says that they are assumed."""
    start_velocity: npt.ArrayLike | None
    """(n,) rad/s or m/s, within 100; default at rest."""
    start_acceleration: npt.ArrayLike | None
    """(n,) rad/s^2 or m/s^2, within 1e4; default none."""
    contact_speed: float | None
    """Greatest speed (m/s) of the point that touches, from the actuation on, 0.001 to 1,000; default: no limit."""
    frames: Literal["object", "original"]
    """"object": list-type translations are in the hand frame. "original": turned by the object's yaw."""
    rotate_path: Literal["arc", "chord"]
    """Path by which "rotate" moves the hand between its keyframes ("arc")."""
    workspace: npt.ArrayLike | None
    """[[x, y, z], [x, y, z]] (m) that holds the hand's origin at the actuation pose; None for no bounds (None)."""
    joint_weights: npt.ArrayLike | None
    """(n,) weights of the joints' squared ways to the actuation pose in its cost, 0.001 to 1e6; default 1 each."""
    margin: float
    """Clearance that the whole motion keeps from what it may not touch, 0 to 0.2 m (0.005). Two bodies that are nearer
    to each other where a segment begins or ends keep what they have there: ``Plan.tight``."""
    least_margin: float | None
    """Clearance that will do where no motion keeps ``margin``, 0 to that, m; default: none will."""
    contact_depth: float | None
    """Largest overlap of things that may touch, 0 to 1 m (0.003); None for no limit."""
    guess_depth: float
    """Largest depth of arm and held bodies inside of what the object's joint moves where it is a guess how far that is,
    0 to 0.1 m (0.05)."""
    start_depth: float
    """Largest depth of the robot inside of something at the start, 0 to 1 m (0.01): it comes out first. Deeper, the
    status is "start_in_collision"."""
    reach_clearance: float | None
    """Clearance kept from what the hand reaches for (the moving link, targets, what it picks) on the way to the
    actuation pose and at it, 0 to 0.05 m; default: hand and fingers may touch it in the last segment before. Not with
    ``contacts``."""
    avoid_collisions: bool
    """False only reports them (True)."""
    allow_partial: bool
    """True takes the longest part of the motion after the actuation pose, with status "partial" (False)."""
    finger_width: float | None
    """Value of the finger joints (those below the hand) while planning, m or rad, within their limits; mimic joints
    among them follow; default as in q_start."""
    num_seeds: int
    """Start values of the actuation pose, 1 to 1,000 (64)."""
    num_refinements: int
    """Poses on the constraints that are moved to their optimum, 1 to 1,000 (2)."""
    candidates: int
    """Most poses that are tried for the whole motion, 1 to 1,000 (40)."""
    extra_seeds: int
    """Further start values where none of those allows the motion, at most 100,000 (200)."""
    clearings: int
    """Most poses that are moved out of what they overlap, where that is what stops all others, at most 1,000 (64)."""
    samples: int
    """Most samples of the free-space planner a pose, at most 1,000,000 (2,000)."""
    seed: int
    """Which start values and samples are drawn, 0 to 1,000,000 (0): other ones lead to other motions where there are
    several."""
    contacts: Sequence[ContactWindow] | None
    """Windows in place of the default contact rules."""
    pick: Sequence[str]
    """Names of bodies that ride on the hand from the actuation on."""
    release: Sequence[str]
    """Names of attached bodies that stand where they are from the actuation on."""
    joint_travel: npt.ArrayLike | None
    """(motions after the actuation,) by how much each moves the joint (rad or m); default: motions that follow or trace
    the joint say so, others take it along with the contact point."""


class GraspOptions(TypedDict, total=False):
    """Options of a search for grasps. What is left out takes its default."""

    count: int
    """Most grasps (100)."""
    samples: int
    """Points of the surface that are looked at (256)."""
    per_part: bool
    """Sample every part of the body equally often: a knob is a small part of a drawer (False)."""
    trials: int
    """Hand poses that are looked at closely (2,000)."""
    friction: float
    """Coefficient between pads and object (0.6)."""
    approach: float
    """Straight way of the open hand, m (0.1)."""
    clearance: float
    """Kept by the open hand, m (0.001)."""
    up: npt.ArrayLike | None
    """Direction (3,) against gravity in the base frame ([0, 0, 1]); None: no gravity."""
    tilt: npt.ArrayLike
    """Least and largest angle (2,) between the approach and straight down, rad ([0, pi])."""
