"""Keypoint solver: constraints in, joint motion out. Metres, radians, seconds; poses are (4, 4) row-major float64."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Numbers = npt.ArrayLike

__version__: str

class KpamError(Exception):
    """Base class. Its subclasses name the file or field and the remedy."""

class UrdfError(KpamError):
    """A robot description that cannot be used: file, field, remedy."""

class ConfigError(KpamError):
    """A solver config that cannot be used: field, remedy."""

class ProblemError(KpamError):
    """A problem whose parts do not fit each other: field, remedy."""

class Robot:
    """A URDF arm. Pickles."""

    @staticmethod
    def from_urdf(
        path: str, *, srdf: str | None = None, hand_link: str = "panda_hand", base_link: str | None = None
    ) -> Robot:
        """Reads a URDF and its collision meshes (relative paths; ``package://`` is stripped).

        ``srdf`` disables pairs of links; without one, neighbours and links that overlap at the middle of all joint
        ranges are not judged. Raises UrdfError.
        """
    @property
    def name(self) -> str: ...
    @property
    def joint_names(self) -> list[str]:
        """Moving joints, in the order of joint vectors (that of the URDF); n of them."""
    @property
    def link_names(self) -> list[str]: ...
    @property
    def lower(self) -> Array:
        """(n,) rad or m; minus infinity for continuous joints."""
    @property
    def upper(self) -> Array:
        """(n,) rad or m."""
    @property
    def velocity(self) -> Array:
        """(n,) rad/s or m/s; infinity where the URDF gives no limit."""
    def forward_kinematics(self, q: Numbers, link: str | None = None) -> Array:
        """Pose of ``link`` (default: the hand) in the base frame: (n,) -> (4, 4), (N, n) -> (N, 4, 4)."""
    def jacobian(self, q: Numbers, link: str | None = None) -> Array:
        """(6, n): linear, then angular velocity of the link's origin, in base axes. (N, n) -> (N, 6, n)."""

class SolverConfig:
    """A validated solver config. What it does not know, and numbers that are not finite, raise ConfigError by field."""

    def __init__(self, config: Mapping[str, Any]) -> None: ...
    def to_dict(self) -> dict[str, Any]: ...
    @property
    def gripper(self) -> Literal["open", "closed", "grasp"]: ...

class Shape:
    """A collision shape in the body frame. Pickles."""

    @staticmethod
    def box(half_extents: Numbers, pose: Numbers | None = None) -> Shape: ...
    @staticmethod
    def sphere(radius: float, center: Numbers | None = None) -> Shape: ...
    @staticmethod
    def capsule(radius: float, length: float, pose: Numbers | None = None) -> Shape:
        """Along z of ``pose``; ``length`` between the centres of its caps (m)."""
    @staticmethod
    def cylinder(radius: float, length: float, pose: Numbers | None = None) -> Shape:
        """Along z of ``pose``, as a prism of 32 sides around it."""
    @staticmethod
    def convex_hull(points: Numbers) -> Shape:
        """Hull of (N, 3) points in the body frame; flat sets are fine."""
    @staticmethod
    def mesh(vertices: Numbers, triangles: npt.ArrayLike) -> Shape:
        """Triangles (M, 3) over (N, 3) vertices: a surface; what lies wholly inside it does not touch it."""
    @staticmethod
    def point_cloud(points: Numbers, radius: float) -> Shape:
        """(N, 3) points, each a ball of ``radius`` (m)."""

class Body:
    """A body of the scene. Pickles."""

    def __init__(
        self,
        name: str,
        role: Literal["table", "object_body", "moving_link", "rigid", "target", "attached"],
        shapes: Sequence[Shape],
        pose: Numbers,
    ) -> None:
        """``pose``: (4, 4) body in the robot base frame; of an attached body, in the hand frame.

        Hand and fingers may touch a ``target``; an ``attached`` body rides on the hand and is judged like it.
        """
    @property
    def name(self) -> str: ...

class Joint:
    def __init__(
        self,
        kind: Literal["revolute", "prismatic"],
        origin: Numbers,
        axis: Numbers,
        value: float,
        lower: float,
        upper: float,
    ) -> None:
        """The object's moving joint; ``origin`` and ``axis`` are (3,) in the robot base frame."""

class KeypointProblem:
    """Everything one plan needs; checked on construction. Pickles."""

    def __init__(
        self,
        robot: Robot,
        config: SolverConfig,
        q_start: Numbers,
        *,
        tool_keypoints: Mapping[str, Numbers],
        object_keypoints: Mapping[str, Numbers],
        T_base_object: Numbers,
        joint: Joint | None = None,
        object_axis: Literal["x", "y", "z"] = "y",
        object_yaw: float = 0.0,
        T_base_world: Numbers | None = None,
        bodies: Sequence[Body] = (),
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """``q_start`` (n,); ``tool_keypoints`` in the hand frame, ``object_keypoints`` in the base frame, each (3,).

        ``options`` (unknown keys raise ProblemError); n is the number of the robot's joints:
            timing: "limits" (as fast as the limits allow) or "config" (the config's clock; the default where the
                config sets a time). start_time: of the first waypoint on that clock, s.
            velocity_scale, acceleration_scale: fractions of the limits, 0.5 each; the second scales jerk too.
            velocity_limits, acceleration_limits, jerk_limits: (n,), default the URDF's velocities and Franka's others.
            start_velocity: (n,), default at rest.
            frames: "object" (list-type translations are in the hand frame) or "original" (turned by object_yaw).
            rotate_path: "arc" or "chord".
            workspace: [[x, y, z], [x, y, z]] that holds the hand's origin at the actuation pose, or None.
            margin: clearance wished for on the free approach, m (0.005).
            avoid_collisions: True; False only reports them. allow_partial: False; True takes the longest part of the
                motion after the actuation pose, with status "partial".
            finger_width: value of the finger joints while planning, m; default as in q_start.
            seeds, candidates, harvest, samples: budgets (starts, poses tried, further starts, tree growths).
            contacts: list of {links, bodies, from, to} windows in place of the default contact rules.
        """

class Trajectory:
    """Timed joint motion. Pickles."""

    @property
    def times(self) -> Array:
        """(N,) seconds; every keyframe time is among them."""
    @property
    def positions(self) -> Array:
        """(N, n) joint positions at ``times``."""
    @property
    def duration(self) -> float: ...
    def sample(self, t: float) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration at t, each (n,)."""
    def sample_every(self, dt: float) -> Array:
        """(ceil(duration / dt) + 1, n) positions."""

class Plan:
    """What was solved, each residual, what failed. Pickles."""

    @property
    def status(self) -> str:
        """ "solved", "partial" (a part of the motion, where allowed), or why not: "actuation_infeasible",
        "unreachable", "collision", "too_fast"."""
    @property
    def reason(self) -> str:
        """One sentence for a person: which constraint misses by how much, which keyframe, which two bodies where."""
    @property
    def warnings(self) -> list[str]: ...
    @property
    def q_actuation(self) -> Array | None:
        """(n,) the cheapest pose that meets all constraints, obstacles left out."""
    @property
    def cost(self) -> float | None:
        """Cost of ``q_actuation``."""
    @property
    def q_plan(self) -> Array | None:
        """(n,) the actuation pose that the trajectory takes, or that came furthest."""
    @property
    def q_best_effort(self) -> Array | None:
        """(n,) where no pose meets the constraints: the one that misses least."""
    @property
    def residuals(self) -> list[dict[str, Any]]:
        """One a constraint: ``name``, ``residual`` (m or rad), ``tolerance``, ``satisfied``."""
    @property
    def keyframes(self) -> list[dict[str, Any]]:
        """One a keyframe: ``label`` ("pre_0", "actuation", "post_0"), ``time`` (s or None), ``T_base_hand`` (4, 4),
        ``reached``."""
    @property
    def trajectory(self) -> Trajectory | None: ...
    @property
    def reached_fraction(self) -> float:
        """Part of the motion after the actuation pose that is reachable and free, 0..1."""
    @property
    def collisions(self) -> list[dict[str, Any]]:
        """``bodies`` (two names), ``time`` (s or None), ``toward`` (keyframe), ``distance`` (m, negative when
        overlapping), ``point`` (3,)."""
    @property
    def start_overlap(self) -> float:
        """Deepest judged overlap at the start, m."""
    @property
    def cpu_ms(self) -> dict[str, float]:
        """Thread CPU time of planning: ``actuation``, ``trajectory``, ``total``. Does not pickle."""
    def to_dict(self) -> dict[str, Any]:
        """Plain values, as JSON holds them."""

class ParallelGripper:
    """A gripper with two flat pads that move towards each other equally far. Pickles."""

    def __init__(
        self,
        tool_head: Numbers,
        tool_tail: Numbers,
        tool_side: Numbers,
        *,
        pad: Numbers,
        stroke: Numbers,
        palm: Sequence[Shape] = (),
        fingers: tuple[Sequence[Shape], Sequence[Shape]] = ((), ()),
    ) -> None:
        """Keypoints (3,) in the hand frame: the middle between the pads, one behind it against the way the fingers
        point, and one to a side in which a finger opens. ``pad`` (2,): extent of a pad across and along the fingers,
        m. ``stroke`` (2,): smallest and largest opening, m. ``palm`` and ``fingers`` (on the side away from
        ``tool_side``, and towards it) in the hand frame, the fingers as they would be at opening zero.
        """
    @staticmethod
    def of_robot(robot: Robot, tool_head: Numbers, tool_tail: Numbers, tool_side: Numbers) -> ParallelGripper:
        """The gripper of a robot whose fingers slide along the axis from ``tool_head`` to ``tool_side``: pads and
        stroke follow from shapes and limits. Raises ProblemError where it has no such fingers."""
    @property
    def T_hand_grip(self) -> Array:
        """(4, 4): x along the closing axis, z as the fingers point, origin midway between the pads' middles."""
    @property
    def pad(self) -> tuple[float, float]:
        """Extents of a pad, m: across the fingers and along them."""
    @property
    def stroke(self) -> tuple[float, float]:
        """Smallest and largest opening, m."""

class Grasp:
    """A way to hold an object. Pickles."""

    @property
    def T_object_hand(self) -> Array:
        """(4, 4) hand in the object frame."""
    @property
    def T_base_hand(self) -> Array:
        """(4, 4) hand in the robot base frame, where the object stands now."""
    @property
    def approach(self) -> Array:
        """(3,) unit direction in which the hand approaches, robot base frame."""
    @property
    def width(self) -> float:
        """Distance of the pads when they hold, m."""
    @property
    def opening(self) -> float:
        """Distance of the pads on the way there, m."""
    @property
    def score(self) -> float:
        """Rank, 0 to 1; higher is better."""
    @property
    def quality(self) -> dict[str, float]:
        """What the rank is made of: ``friction_margin`` (rad inside the friction cone), ``contact`` (part of a pad
        that touches), ``lever`` (m, of gravity about the middle between the pads), ``clearance`` (m, kept by the open
        hand), ``tilt`` (rad between approach and straight down)."""

def grasps(
    body: Body,
    gripper: ParallelGripper,
    *,
    bodies: Sequence[Body] = (),
    center_of_mass: Numbers | None = None,
    options: Mapping[str, Any] | None = None,
) -> list[Grasp]:
    """Grasps of ``body`` (convex hulls, or closed meshes) among ``bodies``, best first, the same every time.

    ``center_of_mass`` (3,) in the object frame, m; default: the centre of its volume (of a mesh: of its box).

    ``options`` (unknown keys raise ProblemError): count (most grasps, 100), samples (points of the surface, 256),
    trials (hand poses that are looked at closely, 2000), friction (coefficient between pads and object, 0.6),
    approach (straight way of the open hand, 0.1 m), clearance (kept by the open hand, 0.001 m), up (against gravity
    in the base frame, [0, 0, 1]; None: no gravity).
    """

class GraspPlan:
    """A grasp with its motions, all of them solved."""

    @property
    def index(self) -> int:
        """Number of the grasp in the list."""
    @property
    def T_object_hand(self) -> Array:
        """(4, 4) hand in the object frame: the grasp's, or that with the fingers swapped."""
    @property
    def pick(self) -> Plan:
        """From the start to the grasp ("actuation") and up ("post_0")."""
    @property
    def carries(self) -> list[Plan]:
        """One a target, each from where the last plan ends."""

def plan_grasp(
    robot: Robot,
    q_start: Numbers,
    gripper: ParallelGripper,
    body: Body,
    grasps: Sequence[Grasp],
    *,
    bodies: Sequence[Body] = (),
    targets: Sequence[tuple[Numbers, Numbers | None]] = (),
    approach: float = 0.1,
    lift: Numbers | None = None,
    options: Mapping[str, Any] | None = None,
) -> GraspPlan | None:
    """The first of ``grasps`` with which ``body`` can be picked and brought to every target; None where none will do.

    ``q_start`` (n,). ``targets``: each ``T_base_object`` (4, 4) and a direction (3,) in the base frame about which the
    object may come turned by any angle, or None. ``approach``: straight way to the grasp, m. ``lift`` (3,): motion of
    the hand after the grasp, and how the object comes to its targets from above, m, default [0, 0, 0.1]. ``options`` as
    for :class:`KeypointProblem`.

    Each grasp is tried as it is and with the fingers swapped. While it is carried, the object is judged as part of the
    hand, so a target lies a little above what the object is put on. Raises ProblemError.
    """

def plan(problem: KeypointProblem) -> Plan:
    """Plans one problem with the GIL released."""

def plan_batch(problems: Sequence[KeypointProblem], threads: int | None = None) -> list[Plan]:
    """Plans many on ``threads`` threads (default: all cores); the same results as ``plan``, in order."""

def in_collision(problem: KeypointProblem, q: Numbers) -> bool | npt.NDArray[np.bool_]:
    """Whether the robot overlaps a body or itself: (n,) -> bool, (N, n) -> (N,) bool. No contact rules; attached bodies
    ride on the hand; links that no joint moves and pairs that the SRDF disables are left out."""

def min_clearance(problem: KeypointProblem, plan: Plan, step: float) -> dict[str, float] | None:
    """Smallest signed distance (m) of judged pairs along the motion, every ``step`` s: "self", "table", "object"."""
