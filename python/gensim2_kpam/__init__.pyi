"""Keypoint solver: constraints in, joint motion out. Metres, radians, seconds; poses are (4, 4) row-major float64."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .options import ContactWindow as ContactWindow
from .options import GraspOptions as GraspOptions
from .options import Gripper as Gripper
from .options import Options as Options
from .results import ActuationPose as ActuationPose
from .results import CheckedPair as CheckedPair
from .results import Clearances as Clearances
from .results import Collision as Collision
from .results import CpuTimes as CpuTimes
from .results import GraspQuality as GraspQuality
from .results import Guess as Guess
from .results import Keyframe as Keyframe
from .results import MotionStatus as MotionStatus
from .results import Refined as Refined
from .results import Residual as Residual
from .results import Status as Status
from .results import TightPair as TightPair
from .results import Touch as Touch
from .results import TriedPose as TriedPose

Array = npt.NDArray[np.float64]
Numbers = npt.ArrayLike
File = str | os.PathLike[str]

__version__: str

class KpamError(Exception):
    """Base class. Its subclasses name the file or field and the remedy, in their text and as attributes."""

    file: str | None
    """The file at fault, where there is one."""
    field: str | None
    """Path of the field at fault, e.g. ``constraint_list[2].tolerance`` or ``options.margin``."""
    message: str | None
    """Fault and remedy, without file and field."""

class UrdfError(KpamError):
    """A robot description that cannot be used: file, field, remedy."""

class ConfigError(KpamError):
    """A solver config that cannot be used: field, remedy."""

class ProblemError(KpamError):
    """A problem whose parts do not fit each other: field, remedy."""

class Robot:
    """Kinematics, dynamics and collision shapes of a URDF arm. Pickles.

    Example:
        ```python
        robot = Robot.from_urdf("ur5.urdf", hand_link="flange")
        T = robot.forward_kinematics([0.8, -1.2, 1.5, -1.9, -1.6, 0.0])  # (4, 4) flange in the base frame
        ```
    """

    @staticmethod
    def from_urdf(path: File, *, hand_link: str, srdf: File | None = None, base_link: str | None = None) -> Robot:
        """Read a URDF and its collision meshes.

        Args:
            path: URDF file; paths of meshes are relative to it, those of ``package://`` to it or a folder above it.
            hand_link: link that carries the tool. The joints between ``base_link`` and it are planned, poses and tool
                keypoints are in its frame, moving joints below it are fingers.
            srdf: SRDF file: pairs of ``disable_collisions``, and links of ``disable_default_collisions`` but for the
                pairs of ``enable_collisions``, are not checked for collision. Without one, neighbours and links that
                overlap at the middle of all joint ranges are not.
            base_link: link of the base frame; default: the only link without a parent.

        Raises:
            UrdfError: a file cannot be read, or is no robot of this kind: a limit is missing, a name is misspelt or
                unknown, xacro is not filled in. Names the link or joint.
        """
    @property
    def name(self) -> str:
        """Name in the URDF."""
    @property
    def joint_names(self) -> list[str]:
        """Moving joints, in the order of joint vectors (that of the URDF); n of them."""
    @property
    def link_names(self) -> list[str]:
        """Names of all links."""
    @property
    def unchecked_pairs(self) -> list[tuple[str, str]]:
        """Links that overlap at the middle of all joint ranges and are never checked against each other for that reason
        alone: an SRDF would say whether they may touch."""
    @property
    def lower(self) -> Array:
        """(n,) lower joint limits, rad or m; minus infinity for continuous joints."""
    @property
    def upper(self) -> Array:
        """(n,) upper joint limits, rad or m; infinity for continuous joints."""
    @property
    def velocity(self) -> Array:
        """(n,) velocity limits, rad/s or m/s; infinity where the URDF gives none, or 0. Planning asks for the others by
        ``velocity_limits``."""
    @property
    def acceleration(self) -> Array:
        """(n,) acceleration limits, rad/s^2 or m/s^2; infinity where the URDF gives none."""
    @property
    def jerk(self) -> Array:
        """(n,) jerk limits, rad/s^3 or m/s^3; infinity where the URDF gives none."""
    def surface(self, link: str) -> tuple[Array, Array]:
        """Return (M, 3, 3) triangles of a link's collision shapes and (K, 4) centres and radii of its balls, m, in the
        link frame."""
    @property
    def effort(self) -> Array:
        """(n,) torque limits, N m or N; infinity where the URDF gives none."""
    @property
    def mass(self) -> float:
        """Mass of all links, kg."""
    def inverse_dynamics(
        self, q: Numbers, velocity: Numbers, acceleration: Numbers, *, gravity: Sequence[float] = (0.0, 0.0, -9.81)
    ) -> Array:
        """Compute joint torques from a motion by the URDF's masses; friction and motors' inertia are left out.

        Args:
            q: (n,) or (N, n) joints, rad or m.
            velocity: the same shape, rad/s or m/s.
            acceleration: the same shape, rad/s^2 or m/s^2.
            gravity: (3,) in the base frame, m/s^2.

        Returns:
            Torques of the same shape, N m (N for sliding joints).
        """
    def forward_kinematics(self, q: Numbers, link: str | None = None) -> Array:
        """Compute the pose of ``link`` (default: the hand) in the base frame: (n,) -> (4, 4), (N, n) -> (N, 4, 4)."""
    def jacobian(self, q: Numbers, link: str | None = None) -> Array:
        """Compute the Jacobian of ``link`` (default: the hand): linear, then angular velocity of its origin, base axes.

        (n,) -> (6, n), (N, n) -> (N, 6, n); m or rad per rad or m.
        """

class SolverConfig:
    """A validated solver config: constraints at the actuation pose, and motions before and after it.

    Example:
        ```python
        config = SolverConfig({
            "constraint_list": [
                {"type": "point2point_constraint", "keypoint_name": "tip", "target_keypoint_name": "handle",
                 "tolerance": 0.001},
            ],
            "pre_actuation_motions": [["translate_z", -0.1]],
        })
        ```
    """

    def __init__(self, config: Mapping[str, Any]) -> None:
        """Validate a config.

        Args:
            config: fields as docs/reference/solver.md lists them.

        Raises:
            ConfigError: a field is unknown, or its value is not finite or of another type.
        """
    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain data."""
    @property
    def gripper(self) -> Gripper:
        """Finger mode."""
    @property
    def let_go(self) -> float | None:
        """Retreat (m) of the hand along its own z axis at the end, once it has let go; None where it stays."""

class Shape:
    """A collision shape in the body frame. Pickles."""

    @staticmethod
    def box(half_extents: Numbers, pose: Numbers | None = None) -> Shape:
        """Box with (3,) half extents (m) along the axes of ``pose`` (4, 4), default: those of the body."""
    @staticmethod
    def sphere(radius: float, center: Numbers | None = None) -> Shape:
        """Ball of a radius (m) about ``center`` (3,), default: the body's origin."""
    @staticmethod
    def capsule(radius: float, length: float, pose: Numbers | None = None) -> Shape:
        """Capsule along z of ``pose``; ``length`` (m) is between the centres of its caps."""
    @staticmethod
    def cylinder(radius: float, length: float, pose: Numbers | None = None) -> Shape:
        """Cylinder along z of ``pose``, as a prism of 32 sides around it; lengths in m."""
    @staticmethod
    def convex_hull(points: Numbers) -> Shape:
        """Hull of (N, 3) points in the body frame; flat sets are fine."""
    @staticmethod
    def mesh(vertices: Numbers, triangles: npt.ArrayLike) -> Shape:
        """Triangles (M, 3) over (N, 3) vertices: a surface; what lies wholly inside it does not touch it."""
    @staticmethod
    def point_cloud(points: Numbers, radius: float) -> Shape:
        """Point cloud: (N, 3) points, each a ball of ``radius`` (m). Without points it is no obstacle."""

class Body:
    """A body of the scene. Pickles."""

    def __init__(
        self,
        name: str,
        role: Literal["table", "object_body", "moving_link", "rigid", "target", "attached"],
        shapes: Sequence[Shape],
        pose: Numbers,
        *,
        keypoints: Mapping[str, Numbers] | None = None,
    ) -> None:
        """Put shapes into the scene as one rigid body.

        Args:
            name: unique in its scene.
            role: what the body is to the hand. Hand, fingers and what they hold may touch a ``target``; an ``attached``
                body rides on the hand.
            shapes: collision shapes in the body frame.
            pose: (4, 4) body in the robot base frame; of an attached body, in the hand frame.
            keypoints: (3,) each, in the body frame, m; scenes hand them to problems.

        Raises:
            ProblemError: the pose is not rigid, or a number is not finite.
        """
    @property
    def name(self) -> str:
        """Name in its scene."""
    @property
    def role(self) -> str:
        """Role, e.g. "rigid"."""
    def surface(self) -> tuple[Array, Array]:
        """Return (M, 3, 3) triangles of the surface and (K, 4) centres and radii of balls (points of clouds among
        them), m, in the body frame."""
    @property
    def pose(self) -> Array:
        """(4, 4) body in the robot base frame; of an attached body, in the hand frame."""

class Joint:
    """A joint of an object: an axis, its present value and its range."""

    def __init__(
        self,
        kind: Literal["revolute", "prismatic"],
        origin: Numbers,
        axis: Numbers,
        value: float,
        lower: float,
        upper: float,
    ) -> None:
        """Describe a joint.

        Args:
            kind: "revolute" or "prismatic".
            origin: (3,) point on the axis in the robot base frame, m.
            axis: (3,) direction in the robot base frame.
            value: present value, rad or m.
            lower: lower end of the range, rad or m.
            upper: upper end of the range, rad or m.
        """

class SceneJoint:
    """A joint of an object and the names of the bodies that it moves. Pickles."""

    def __init__(self, name: str, joint: Joint, moves: Sequence[str]) -> None:
        """Name a joint and the bodies that it moves."""
    @property
    def name(self) -> str:
        """Name in its scene."""
    @property
    def value(self) -> float:
        """Present value, rad or m."""
    @property
    def moves(self) -> list[str]:
        """Names of the bodies that it moves."""

class Scene:
    """A robot and its surroundings, built once; every problem on it shares its shapes and its tree. Methods that change
    a scene return another one. Pickles.

    Example:
        ```python
        post = Body("post", "rigid", [Shape.capsule(0.05, 1.0)], T_base_post)
        scene = Scene(robot, [post])
        motion = scene.plan_to(q_start, q_goal)
        if motion.trajectory is not None:
            position, velocity, acceleration = motion.trajectory.sample(0.5)
        ```
    """

    def __init__(self, robot: Robot, bodies: Sequence[Body] = ..., joints: Sequence[SceneJoint] = ...) -> None:
        """Build a scene.

        Args:
            robot: the arm.
            bodies: obstacles, targets and held bodies; names are unique.
            joints: joints of objects, each with the names of the bodies that it moves.

        Raises:
            ProblemError: two bodies or joints have one name, or a joint moves a body that is not there.
        """
    def own_points(self, q: Numbers, points: npt.ArrayLike, clearance: float = 0.02) -> npt.NDArray[np.bool_]:
        """Mark which of (N, 3) points (m, base frame) lie within ``clearance`` (m) of the robot at joints ``q`` (n,) or
        of what it holds: (N,). They are no obstacle: ``points[~scene.own_points(q, points)]`` is what stands about."""
    @property
    def robot(self) -> Robot:
        """The arm."""
    @property
    def bodies(self) -> list[Body]:
        """Bodies in their order."""
    @property
    def joints(self) -> list[SceneJoint]:
        """Joints of objects in their order."""
    @property
    def tool_keypoints(self) -> dict[str, Array]:
        """Keypoints of the attached bodies in the hand frame, named "body/keypoint"."""
    @property
    def object_keypoints(self) -> dict[str, Array]:
        """Keypoints of the standing bodies in the base frame, named "body/keypoint"."""
    def with_joint(self, name: str, value: float) -> Scene:
        """Return the scene with a joint at another value (rad or m, within its range); the bodies that it moves go with
        it."""
    def with_pose(self, body: str, pose: Numbers) -> Scene:
        """Return the scene with a body at another pose: (4, 4) in the base frame, in the hand frame if attached."""
    def attached(self, body: str, q: Numbers) -> Scene:
        """Return the scene with a body that the hand holds at joints ``q`` (n,); no joint moves it any more."""
    def detached(self, body: str, q: Numbers, on: str | None = None) -> Scene:
        """Return the scene with an attached body left where the hand at joints ``q`` (n,) holds it: a rigid obstacle,
        which the joint ``on`` moves where the body lies on something that moves."""
    def problem(
        self,
        config: SolverConfig,
        q_start: Numbers,
        *,
        tool_keypoints: Mapping[str, Numbers] | None = None,
        object_keypoints: Mapping[str, Numbers] | None = None,
        T_base_object: Numbers | None = None,
        joint: str | None = None,
        object_axis: Literal["x", "y", "z"] = "y",
        object_yaw: float = 0.0,
        T_base_world: Numbers | None = None,
        options: Options | None = None,
    ) -> KeypointProblem:
        """Make a problem on this scene.

        Arguments are those of :class:`KeypointProblem`, with two differences: the keypoints of the scene's bodies are
        added to those given, and ``joint`` is the name of the joint that the config is about. The bodies that this
        joint moves are the moving link.

        Raises:
            ProblemError: the parts do not fit each other.
        """
    def grasps(
        self,
        body: str,
        gripper: ParallelGripper,
        center_of_mass: Numbers | None = None,
        options: GraspOptions | None = None,
    ) -> list[Grasp]:
        """Search for grasps of a body where it stands among the others; the same arguments give the same grasps.

        Bodies that ride on the hand are left out.

        Args:
            body: name of the body, of convex hulls or closed meshes.
            gripper: the robot's gripper.
            center_of_mass: (3,) in the body frame, m; default: the centre of its volume (of a mesh: of its box).
            options: :class:`GraspOptions`.

        Returns:
            Grasps, best first; none where there are none.

        Raises:
            ProblemError: there is no such body, or an option is unknown or out of its range.
        """
    def plan_grasp(
        self,
        body: str,
        gripper: ParallelGripper,
        q_start: Numbers,
        grasps: Sequence[Grasp],
        *,
        targets: Sequence[tuple[Numbers, Numbers | None]] = (),
        approach: float = 0.1,
        lift: Numbers | None = None,
        options: Options | None = None,
    ) -> GraspPlan | None:
        """Plan with the first of the grasps by which a body can be picked and brought to every target.

        Each is tried as it is and with the fingers swapped. While it is carried, the body is checked as part of the
        hand: targets are to be free, so a little above what it is put on.

        Args:
            body: its name.
            gripper: the robot's gripper.
            q_start: (n,) joints at the start.
            grasps: of the body, best first.
            targets: where it goes, one after the other: (4, 4) pose in the base frame, and a (3,) direction about which
                it may come turned, or None.
            approach: straight way of the open hand, m.
            lift: (3,) way of the hand right after the grasp, base frame, m; also how it comes to targets. Default: up
                0.1.
            options: options of every plan; ``start_velocity`` and ``start_acceleration`` are the pick's, for what comes
                after it begins at rest.

        Returns:
            The grasp with its motions; None where no grasp will do.

        Raises:
            ProblemError: an argument does not fit the scene.
        """
    def plan_to(
        self,
        q_start: Numbers,
        goal: Numbers,
        *,
        link: str | None = None,
        margin: float = 0.005,
        samples: int = 100_000,
        seed: int = 0,
        velocity_scale: float = 1.0,
        acceleration_scale: float = 1.0,
        limits: Literal["panda", "fr3", "plain"] | None = None,
        velocity_limits: Sequence[float] | None = None,
        acceleration_limits: Sequence[float] | None = None,
        jerk_limits: Sequence[float] | None = None,
        torque_limits: Sequence[float] | None = None,
        path: SolverConfig | None = None,
        tool_keypoints: Mapping[str, Numbers] | None = None,
        start_velocity: Numbers | None = None,
        start_acceleration: Numbers | None = None,
        start_time: float = 0.0,
        warm_start: Trajectory | None = None,
        max_checks: int | None = None,
        deadline_ms: float | None = None,
        cancel: Cancel | None = None,
    ) -> Motion:
        """Plan a timed motion from ``q_start`` (n,) to rest at a goal, clear by ``margin`` all along.

        A start under way takes the fastest motion within the limits where that is free, and a way round otherwise.

        Args:
            q_start: (n,) full joint vector; joints that do not move the hand stay there.
            goal: (n,) joints, or (K, n) of which any will do, or a pose (4, 4) of ``link`` in the base frame. With
                four joints, (4, 4) that is a rigid transform is a pose. Joints that do not move the hand have the value
                of ``q_start``.
            link: link that the pose is of (default: the hand).
            margin: distance in m, 0 to 0.1. A pair that is nearer at the start or at the goal keeps what it has there.
            samples: most samples of the search.
            seed: number of the sequence of samples.
            velocity_scale: share of the velocity limits, above 0 to 1.
            acceleration_scale: share of the acceleration and jerk limits, above 0 to 1.
            limits: acceleration and jerk limits of an arm that is known; "fr3" has velocity limits that depend on the
                position, too.
            velocity_limits: (n,) rad/s or m/s instead of the URDF's; needed where it has none.
            acceleration_limits: (n,) rad/s^2 or m/s^2 instead of the URDF's and those of ``limits``.
            jerk_limits: (n,) rad/s^3 or m/s^3, likewise.
            torque_limits: (n,) N m, or N; torques are not looked at by default.
            path: a config whose axis constraints hold all along: the direction between two keypoints of the tool keeps
                its angle to a direction of the base (``target_axis_frame`` "world") within ``tolerance`` rad. Start and
                goal lie within 0.85 of that.
            tool_keypoints: (3,) each, m in the hand frame, that it names; those of held bodies are there.
            start_velocity: (n,) rad/s or m/s at the start; default: at rest.
            start_acceleration: (n,) rad/s^2 or m/s^2 at the start; default: none.
            start_time: time of the start, s; the motion begins then.
            warm_start: the motion under way. It goes on where it passes the start at ``start_time``, ends at a goal and
                is still free, unless another motion arrives earlier.
            max_checks: most configurations to be looked at.
            deadline_ms: wall time after which the search ends; without one, the same question has the same answer.
            cancel: ends the search from another thread.

        Returns:
            The motion, or in ``status`` and ``reason`` why there is none.

        Raises:
            ProblemError: an argument does not fit the robot.

        Example:
            ```python
            q, v, a = motion.sample(t)
            state = {"start_velocity": v, "start_acceleration": a, "start_time": t}
            again = scene.plan_to(q, q_goal, **state, warm_start=motion)
            if again.trajectory is not None:
                motion = motion.splice(again.trajectory, t)
            ```
        """
    def ik(
        self, pose: Numbers, q_start: Numbers, *, link: str | None = None, max_solutions: int = 16, seed: int = 0
    ) -> Array:
        """Solve inverse kinematics; obstacles are left out.

        Args:
            pose: (4, 4) of ``link`` in the base frame.
            q_start: (n,) joints that solutions are to be near.
            link: link that the pose is of; default: the hand.
            max_solutions: largest number of solutions, 1 to 256.
            seed: number of the sequence of start values, 0 to 1,000,000.

        Returns:
            Distinct joint vectors (K, n), nearest to ``q_start`` first; samples where the arm is redundant.
        """
    def in_collision(self, q: Numbers) -> bool | npt.NDArray[np.bool_]:
        """Check whether the robot overlaps a body or itself: (n,) -> bool, (N, n) -> (N,) bool.

        There are no contact rules. Links that no joint moves, pairs that the SRDF disables and held bodies against the
        hand are left out.
        """
    def distance(self, q: Numbers, max_distance: float = 1.0) -> float | Array:
        """Measure the smallest signed distance (m) of the pairs of :meth:`in_collision`, ``max_distance`` where none is
        nearer: (n,) -> float, (N, n) -> (N,)."""
    def check(self, q: Numbers, reach: float = 0.0) -> list[Any]:
        """List the pairs that come within ``reach`` (m), nearest first, each a :class:`CheckedPair`: for
        (n,) a list of them, for (N, n) a list of such lists."""

class Motion:
    """Motion to a goal, or why there is none. Pickles."""

    @property
    def status(self) -> MotionStatus:
        """ "solved", or "start_blocked", "goals_blocked", "unreachable", "not_found", "untimed" (a free way was found,
        and no motion along it keeps the limits), "late" (the deadline passed), "cancelled"."""
    @property
    def reason(self) -> str:
        """One sentence for a person; empty where solved."""
    @property
    def trajectory(self) -> Trajectory | None:
        """Timed motion where solved."""
    @property
    def goal(self) -> int | None:
        """Number of the goal at which it ends."""
    @property
    def corners(self) -> Array | None:
        """(K, n) corners of the way that it follows."""
    @property
    def nearer(self) -> list[tuple[str, str, float]]:
        """Pairs nearer than the margin at the start or at the goal, with their distance (m)."""
    @property
    def checks(self) -> int | None:
        """Configurations that were looked at."""
    @property
    def assumed_limits(self) -> list[str]:
        """Limits ("acceleration", "jerk") that neither the options nor the URDF give, so that plain ones are assumed:
        ``limits`` or lists of them say better. Empty where there is no motion."""
    @property
    def warnings(self) -> list[str]:
        """Sentences for a user: limits that are assumed and for which joints, and links that are never checked."""
    @property
    def cpu_ms(self) -> float:
        """CPU time of planning (ms)."""

class Cancel:
    """Ends planning from another thread: pass it to ``plan`` and call ``cancel``. Once set it stays set."""

    def __init__(self) -> None:
        """Make a flag that is not set."""
    def cancel(self) -> None:
        """Set the flag."""
    @property
    def is_cancelled(self) -> bool:
        """Whether it is set."""

class KeypointProblem:
    """Robot, config, keypoints and obstacles of one plan; checked on construction. Pickles.

    Example:
        ```python
        problem = KeypointProblem(
            robot,
            config,
            q_start,
            tool_keypoints={"tip": [0.0, 0.0, 0.1]},  # hand frame, m
            object_keypoints={"handle": [0.5, 0.0, 0.3]},  # base frame, m
            T_base_object=np.eye(4),
        )
        result = plan(problem)
        ```
    """

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
        options: Options | None = None,
    ) -> None:
        """Put the parts of a problem together.

        Args:
            robot: the arm.
            config: constraints and motions.
            q_start: (n,) joints at the start, rad or m.
            tool_keypoints: (3,) each, in the hand frame, m.
            object_keypoints: (3,) each, in the base frame, m.
            T_base_object: (4, 4) object frame in the base frame.
            joint: the object's joint, which moves the bodies of the role ``moving_link``.
            object_axis: axis of the object frame about which "rotate" turns.
            object_yaw: yaw that the scene's randomization drew, rad; ``frames="original"`` reads motions by it.
            T_base_world: (4, 4) world frame in the base frame; default: the same axes.
            bodies: obstacles, targets and held bodies.
            options: :class:`Options`.

        Raises:
            ProblemError: parts do not fit each other, or an option is unknown or out of its range.
        """
    def with_start(
        self, q: Numbers, velocity: Numbers | None = None, time: float = 0.0, *, acceleration: Numbers | None = None
    ) -> KeypointProblem:
        """Return the same problem from another state; it shares everything else.

        A motion that goes on from a sample of another one is continuous in position, velocity and acceleration where
        all three are given.

        Args:
            q: (n,) joints, rad or m.
            velocity: (n,) rad/s or m/s; default: at rest.
            time: time on the motion's clock, s.
            acceleration: (n,) rad/s^2 or m/s^2; default: zero.
        """
    @property
    def scene(self) -> Scene:
        """The problem's scene; its joint is named "joint" there."""

class Trajectory:
    """Timed joint motion. Pickles."""

    @property
    def times(self) -> Array:
        """(N,) seconds, at most 0.1 s (or a 100,000th of the motion) apart; every keyframe time is among them."""
    @property
    def positions(self) -> Array:
        """(N, n) joint positions at ``times``."""
    @property
    def duration(self) -> float:
        """Length in time, s."""
    def sample(self, t: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Sample the motion; it is at rest after its end.

        Args:
            t: time, or (N,) times, s.

        Returns:
            Position, velocity and acceleration, (n,) each; (N, n) for (N,) times.
        """
    def sample_into(self, t: float, position: Array, velocity: Array, acceleration: Array) -> None:
        """Write position, velocity and acceleration at time t (s) into contiguous float64 arrays (n,), for control
        loops: nothing is allocated. Raises ProblemError where an array does not fit."""
    def brake(self, t: float) -> Trajectory:
        """Return the fastest stop found from the state at time t (s) on, along the motion's path and within its limits
        of velocity, acceleration and jerk; limits of torque, where it was planned with these, are not looked at.

        The stop begins at t. It is the motion until that rests where that is sooner. Where no stop along the path keeps
        the limits, as right before the motion turns back, every joint stops by itself, which may lead off the path.
        """
    def splice(self, next: Trajectory, t: float) -> Trajectory:
        """Return this motion until time t (s) and ``next`` from there on.

        Raises ProblemError where ``next`` does not go on from the state at t: position, velocity and acceleration to
        1e-6, and joints that neither moves, such as fingers, where they stand. What a stream has behind it is kept:
        see ``since``.
        """
    def since(self, t: float) -> Trajectory:
        """Return this motion from time t (s) on, so that a stream that is spliced again and again stays small."""
    def sample_every(self, dt: float) -> Array:
        """Return positions every ``dt`` (s), (ceil(duration / dt) + 1, n); at most a million rows."""

class Plan:
    """Result of planning: motion, residuals, failures. Pickles."""

    @property
    def status(self) -> Status:
        """ "solved", "partial" (a part of the motion, where allowed), or why not: "actuation_infeasible",
        "unreachable", "collision", "start_in_collision", "not_found" (the search ended without a motion; there may be
        one), "too_fast", "cannot_stop" (no motion from the start stays within the joint limits), "untimed" (a path was
        found, and no motion along it that keeps the limits from the start on), "cancelled". The first two have a
        trajectory, the others have none."""
    @property
    def reason(self) -> str:
        """One sentence for a person: which constraint misses by how much, which keyframe, which two bodies where."""
    @property
    def warnings(self) -> list[str]:
        """Sentences about what was assumed or left out."""
    @property
    def margin(self) -> float:
        """Clearance that the motion keeps from what it may not touch, m, but for what is ``tight``."""
    @property
    def tight(self) -> list[TightPair]:
        """Pairs nearer than the margin at the start or at a keyframe, though they may not touch on the way there, or
        from there on: ``bodies`` (two names), ``at`` ("start" or a keyframe), ``distance`` (m). Where they may not
        touch the motion keeps that instead."""
    @property
    def touches(self) -> list[Touch]:
        """Permitted overlaps at keyframes: ``bodies`` (two names), ``at`` (keyframe), ``depth`` (m)."""
    @property
    def guesses(self) -> list[Guess]:
        """Motions that move the object's joint by an amount that is a guess: ``toward`` (keyframe), ``travel`` (rad or
        m), ``depth`` (m of overlap that is let pass for it)."""
    @property
    def assumed_limits(self) -> list[str]:
        """Limits ("acceleration", "jerk") that neither options nor URDF give, so that plain ones are assumed."""
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
    def residuals(self) -> list[Residual]:
        """One a constraint: ``name``, ``residual`` (m or rad), ``tolerance``, ``satisfied``."""
    @property
    def keyframes(self) -> list[Keyframe]:
        """One a keyframe, in time: ``label`` ("pre_1", "pre_0", "actuation", "post_0", "let_go"), ``time`` (s or None),
        ``T_base_hand`` (4, 4), ``reached``."""
    @property
    def trajectory(self) -> Trajectory | None:
        """The motion: there is one where the status is "solved" or "partial", and only there."""
    @property
    def tried(self) -> int:
        """Number of poses whose motion was tried."""
    @property
    def tried_poses(self) -> list[TriedPose]:
        """Outcome of each pose that was tried, where ``explain`` asked for it: ``q`` (n,), ``rank``, ``status``,
        ``reason``."""
    @property
    def reached_fraction(self) -> float:
        """Part of the motion after the actuation pose that is reachable and free, 0..1."""
    @property
    def collisions(self) -> list[Collision]:
        """``bodies`` (two names), ``time`` (s or None), ``toward`` (keyframe), ``distance`` (m, negative when
        overlapping), ``point`` (3,)."""
    @property
    def start_overlap(self) -> float:
        """Deepest overlap of a checked pair at the start, m."""
    @property
    def cpu_ms(self) -> CpuTimes:
        """Thread CPU time of planning: ``setup``, ``actuation``, ``trajectory``, ``total``. Does not pickle."""
    def to_dict(self) -> dict[str, Any]:
        """Return plain values, as JSON holds them."""

def read_urdf(content: bytes, file: str) -> dict[str, Any]:
    """Read a URDF as it is written: every number is checked, and only the defaults of URDF itself are filled in.

    Args:
        content: of the file, in the encoding that it declares.
        file: its name, for errors.

    Returns:
        ``name``, ``links``, ``joints`` and ``materials``; None for what is not written or infinite.

    Raises:
        UrdfError: it is no URDF; names the link or joint, the attribute and the remedy.
    """

def read_obj(content: bytes) -> tuple[Array, list[tuple[str, npt.NDArray[np.int64]]], list[str]]:
    """Read a Wavefront OBJ file.

    Args:
        content: of the file.

    Returns:
        (N, 3) vertices; the name and the (M, 3) triangles of each material; names of the material files.

    Raises:
        ValueError: a vertex is not three numbers, or a face has under three corners or refers to no vertex.
    """

def plan(
    problem: KeypointProblem,
    *,
    warm_start: Plan | None = None,
    resume: str | None = None,
    max_checks: int | None = None,
    deadline_ms: float | None = None,
    cancel: Cancel | None = None,
    explain: bool = False,
) -> Plan:
    """Plan a timed motion that meets a problem's constraints. The GIL is released; Ctrl-C ends it.

    Example:
        ```python
        result = plan(problem)
        if result.trajectory is None:
            print(result.status, result.reason)
        ```

    Args:
        problem: robot, config, keypoints and obstacles.
        warm_start: an earlier plan of this or a similar problem; its pose and its way are tried first.
        resume: label of the keyframe that the motion goes to first. What comes before it is done: ``q_start`` and
            ``start_velocity`` are the present state, everything else is as before the motion. Past the actuation pose
            it needs ``warm_start``.
        max_checks: most states that are checked for collisions; the same on every machine.
        deadline_ms: wall time after which planning ends with the best so far, or why there is none; without one, the
            same question has the same answer.
        cancel: ends planning when set.
        explain: whether ``Plan.tried_poses`` says what became of each pose that was tried.

    Returns:
        The plan; where ``status`` is neither "solved" nor "partial", ``reason`` says which constraint, keyframe or pair
        of bodies stands in the way.

    Raises:
        ProblemError: ``warm_start`` or ``resume`` does not fit the problem.
    """

def ik(problem: KeypointProblem, max_solutions: int = 10) -> list[ActuationPose]:
    """Find the cheapest distinct poses that meet the constraints; obstacles are left out.

    Args:
        problem: robot, config and keypoints.
        max_solutions: largest number of poses.

    Returns:
        Poses, cheapest first: ``q`` (n,) and ``cost``. ``Scene.check`` says what a pose touches.
    """

def joint_travel(problem: KeypointProblem, plan: Plan, times: Numbers) -> Array:
    """Return the travel (N,), rad or m, that the planner assumes of the object's joint at times (N,), s, of a plan."""

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
        """Describe a gripper; keypoints and shapes are in the hand frame, m.

        Args:
            tool_head: (3,) middle between the pads.
            tool_tail: (3,) point behind it, against the direction in which the fingers point.
            tool_side: (3,) point to a side in which a finger opens.
            pad: (2,) extents of a pad, across and along the fingers, m.
            stroke: (2,) smallest and largest opening, m.
            palm: shapes that do not move.
            fingers: shapes of the finger away from ``tool_side`` and of the one towards it, at opening zero.
        """
    @staticmethod
    def of_robot(robot: Robot, tool_head: Numbers, tool_tail: Numbers, tool_side: Numbers) -> ParallelGripper:
        """Derive the gripper of a robot whose fingers slide along the axis from ``tool_head`` to ``tool_side``.

        Pads and stroke follow from shapes and limits.

        Raises:
            ProblemError: the robot has no such fingers.
        """
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
    def quality(self) -> GraspQuality:
        """Terms of the rank: ``friction_margin`` (rad inside the friction cone), ``contact`` (part of a pad that
        touches), ``lever`` (m, of gravity about the middle between the pads), ``clearance`` (m, kept by the open hand),
        ``tilt`` (rad between approach and straight down)."""

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

def plan_batch(problems: Sequence[KeypointProblem], threads: int | None = None) -> list[Plan]:
    """Plan many problems in parallel; Ctrl-C ends it.

    Args:
        problems: independent problems.
        threads: number of threads, 1 to 256; default: one a core.

    Returns:
        The same plans as :func:`plan` makes, in order.
    """

def min_clearance(problem: KeypointProblem, plan: Plan, step: float) -> Clearances | None:
    """Measure the smallest signed distances (m) of checked pairs along a plan's motion.

    Args:
        problem: the problem that was planned.
        plan: a plan of it.
        step: interval of the samples, s; at least a 100,000th of the motion.

    Returns:
        Distances by kind of pair: "self", "table", "object"; None where the plan has no motion.
    """

def retime(
    waypoints: npt.ArrayLike,
    velocity_limits: npt.ArrayLike,
    acceleration_limits: npt.ArrayLike,
    jerk_limits: npt.ArrayLike,
    *,
    stops: Sequence[int] = (),
    slowest: npt.ArrayLike | None = None,
    start_velocity: npt.ArrayLike | None = None,
    start_acceleration: npt.ArrayLike | None = None,
    start_time: float = 0.0,
    position_limits: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    braking: Sequence[tuple[float, float, float, float] | None] | None = None,
    method: Literal["reachability", "conic"] = "reachability",
) -> tuple[Trajectory, Array]:
    """Return the fastest motion along the cubic spline through waypoints within velocity, acceleration and jerk limits.
    Ctrl-C ends it.

    Args:
        waypoints: (N, n) joint positions, rad or m; the spline is natural, over the chord length between them.
        velocity_limits, acceleration_limits, jerk_limits: (n,) per second, per second squared and cubed.
        stops: waypoints at which the motion rests, beside the last.
        slowest: (N - 1,) least time of each interval between waypoints, s.
        start_velocity, start_acceleration: (n,) at the first waypoint; at rest by default. A start that does not move
            towards the second waypoint leaves the path in a turn, or comes to rest first where no turn is possible.
        start_time: time of the first waypoint, s.
        position_limits: (n,) lower and upper limits that a start under way has to stop within.
        braking: upper, lower, gain and offset a joint (None for none): upwards it moves no faster than
            ``-offset + sqrt(gain * (upper - q))``, downwards than ``-offset + sqrt(gain * (q - lower))``.
        method: "conic" solves a cone program on Clarabel instead; the same motion, slower.

    Returns:
        The motion from the start time on, and the (N,) times at which it passes the waypoints.

    Raises:
        ProblemError: what does not fit, by argument; ``start_velocity`` where no motion from there keeps the limits.
    """

def refine(
    problem: KeypointProblem, plan: Plan, *, times: npt.ArrayLike | None = None, keep_paths: bool = False
) -> Refined:
    """Shorten a plan's whole waypoint path by sequential quadratic programming on Clarabel.

    The cost is squared joint steps between waypoints, weighted by the problem's ``joint_weights`` (the original weighs
    the first joint 10 times). Hand poses of
    keyframes stay (position exactly, orientation within 0.03 rad), joint limits hold, straight steps that were free
    stay free; the cost is never more than before.

    Args:
        problem: what was planned.
        plan: a plan of it that has a trajectory.
        times: (N,) times of the plan's motion at which waypoints lie, s, beside its start, end and keyframes; about 40
            evenly by default.
        keep_paths: keep the hand on its lines and arcs from the actuation on, not only at keyframes.

    Returns:
        ``waypoints`` (N, n), ``times`` (N,), ``keyframes`` (numbers of their waypoints), ``cost_before``,
        ``cost_after``, ``rounds``. ``retime`` makes a motion of the waypoints.

    Raises:
        ProblemError: the plan has no motion, or a time is not within it.
    """
