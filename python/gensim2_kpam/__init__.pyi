"""Motion planning from joint, pose or keypoint goals. Metres, radians, seconds; poses are (4, 4) row-major float64."""

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
from .results import LinkPair as LinkPair
from .results import MotionStatus as MotionStatus
from .results import Refined as Refined
from .results import Residual as Residual
from .results import ServoStatus as ServoStatus
from .results import Status as Status
from .results import TightPair as TightPair
from .results import Touch as Touch
from .results import TriedPose as TriedPose

Array = npt.NDArray[np.float64]
Numbers = npt.ArrayLike
File = str | os.PathLike[str]

__version__: str

class KpamError(Exception):
    """Base class of all errors, which name the file or field and the remedy in their message and as attributes."""

    file: str | None
    """File at fault, if any."""
    field: str | None
    """Path of the field at fault, such as ``constraint_list[2].tolerance`` or ``options.margin``."""
    message: str | None
    """Description of the fault and its remedy, without file and field."""

class UrdfError(KpamError):
    """A robot description cannot be used; the message names file, field and remedy."""

class ConfigError(KpamError):
    """A solver config cannot be used; the message names field and remedy."""

class ProblemError(KpamError):
    """Parts of a problem do not fit each other; the message names field and remedy."""

class Robot:
    """Kinematics, dynamics and collision shapes of a URDF arm. Instances can be pickled.

    Example:
        ```python
        robot = Robot.from_urdf("ur5e.urdf", hand_link="flange")
        T = robot.forward_kinematics([0.8, -1.2, 1.5, -1.9, -1.6, 0.0])  # (4, 4) flange in the base frame
        ```
    """

    @staticmethod
    def from_urdf(
        path: File,
        *,
        hand_link: str,
        srdf: File | None = None,
        base_link: str | None = None,
        package_dirs: Sequence[File] = (),
        joints: Sequence[str] | None = None,
        mesh_tolerance: float | None = None,
    ) -> Robot:
        """Read a URDF and its collision meshes (.stl, .ply, .obj, .dae, .glb, .gltf).

        Args:
            path: URDF file. Mesh paths are relative to its folder.
            hand_link: link that carries the tool. Poses and tool keypoints refer to the frame of this link, and moving
                joints below it are fingers.
            srdf: SRDF file. Pairs of ``disable_collisions``, and links of ``disable_default_collisions`` except the
                pairs of ``enable_collisions``, are not checked for collision. Without an SRDF file, neighbouring
                links and links that overlap in at least 95 % of random configurations are not checked; see
                :meth:`self_collisions`.
            base_link: link of the base frame; default: the only link without a parent.
            package_dirs: folders in which ``package://`` paths are searched: folders of ROS packages, or packages
                themselves. Further folders are those in the environment variables ``ROS_PACKAGE_PATH`` and
                ``AMENT_PREFIX_PATH``, and the folders above the URDF.
            joints: names of the 1 to 16 independent joints that motions move, such as the joints of two arms, or of a
                torso and an arm. All other joints keep their values. Default: the joints between ``base_link`` and
                ``hand_link``. Problems that only concern the hand (:meth:`Scene.problem`, grasps) move those of the
                joints that move the hand.
            mesh_tolerance: distance in m. A collision mesh whose convex hull has points farther than this from the mesh
                and its interior, at about 3000 samples, is decomposed into convex parts, at most 16 for each mesh. The
                parts together contain the mesh, and its interior if the mesh is closed and its triangles all face the
                same side. They are within this distance unless 16 parts are too few. Meshes of more than 100,000
                triangles keep their hull. Pickle the robot to avoid a second decomposition. Default: each mesh becomes
                its convex hull.

        Raises:
            UrdfError: ``mesh_tolerance`` is not positive, or a file cannot be read or used: a limit is missing, a name
                is misspelt or unknown, or xacro is not expanded. The error names the link or joint.
            ProblemError: ``joints`` is empty, or contains an unknown joint, a joint twice or a mimic joint.

        Example:
            ```python
            robot = kpam.Robot.from_urdf("ur5e.urdf", hand_link="flange")
            print(robot.joint_names)
            ```
        """
    def self_collisions(
        self, *, samples: int = 1000, seed: int = 0, always: float = 0.95, srdf: File | None = None
    ) -> list[LinkPair]:
        """Return how often each pair of links overlaps in random configurations, and whether motions check the pair.

        Motions check all pairs except adjacent links, links that always overlap, and the pairs that the robot's SRDF
        disables. Links that were never seen to overlap are checked, because random configurations prove nothing about
        the others.

        Args:
            samples: number of random configurations within the joint limits.
            seed: seed of the random configurations.
            always: fraction of the configurations, above 0 and at most 1. Links that overlap in at least this fraction
                get the relation "always".
            srdf: SRDF file to write. It disables the checks of all pairs whose field ``checked`` is False.

        Returns:
            One dict for each pair of links with collision shapes.

        Raises:
            ProblemError: an argument is out of range, or the file cannot be written.

        Example:
            ```python
            for pair in robot.self_collisions(srdf="fetch.srdf"):
                if not pair["checked"]:
                    print(pair["links"], pair["relation"], pair["fraction"])
            ```
        """
    def apply_mimic(self, q: Numbers) -> Array:
        """Return joints (n,) or (N, n) in which every mimic joint has the value that follows from its source.

        Example:
            ```python
            q[robot.joint_names.index("finger_joint")] = 0.4
            q = robot.apply_mimic(q)  # all fingers are at the place of the drive joint
            ```
        """
    @property
    def name(self) -> str:
        """Name of the robot in the URDF."""
    @property
    def joint_names(self) -> list[str]:
        """Names of the n moving joints. Joint vectors have the same order, which is the order in the URDF."""
    @property
    def planned_joints(self) -> list[str]:
        """Names of the joints that motions move. All other joints keep their values."""
    @property
    def link_names(self) -> list[str]:
        """Names of all links."""
    @property
    def unchecked_pairs(self) -> list[tuple[str, str]]:
        """Pairs of links that are not checked against each other because they overlap in at least 95 % of random
        configurations and no SRDF was given. See :meth:`self_collisions`."""
    @property
    def lower(self) -> Array:
        """(n,) lower joint limits, rad or m; minus infinity for continuous joints."""
    @property
    def upper(self) -> Array:
        """(n,) upper joint limits, rad or m; infinity for continuous joints."""
    @property
    def velocity(self) -> Array:
        """(n,) velocity limits, rad/s or m/s; infinity if the URDF gives none or 0. In this case, planning requires
        the argument or option ``velocity_limits``."""
    @property
    def acceleration(self) -> Array:
        """(n,) acceleration limits, rad/s^2 or m/s^2; infinity if the URDF gives none."""
    @property
    def jerk(self) -> Array:
        """(n,) jerk limits, rad/s^3 or m/s^3; infinity if the URDF gives none."""
    def surface(self, link: str) -> tuple[Array, Array]:
        """Return the triangles (M, 3, 3) of a link's collision shapes, and its spheres (K, 4) as centre and radius.
        All are in the link frame, m."""
    @property
    def effort(self) -> Array:
        """(n,) torque limits, N m (N for sliding joints); infinity if the URDF gives none."""
    @property
    def mass(self) -> float:
        """Total mass of all links and of the payload (:meth:`Scene.with_payload`), kg."""
    def inverse_dynamics(
        self, q: Numbers, velocity: Numbers, acceleration: Numbers, *, gravity: Numbers = (0.0, 0.0, -9.81)
    ) -> Array:
        """Compute the joint torques of a motion from the URDF's masses, without friction and motor inertia.

        Args:
            q: (n,) or (N, n) joints, rad or m.
            velocity: the same shape as ``q``, rad/s or m/s.
            acceleration: the same shape as ``q``, rad/s^2 or m/s^2.
            gravity: (3,) in the base frame, m/s^2.

        Returns:
            Torques of the same shape as ``q``, N m (N for sliding joints).
        """
    def forward_kinematics(self, q: Numbers, link: str | None = None) -> Array:
        """Compute the pose of ``link`` (default: the hand) in the base frame: (n,) -> (4, 4), (N, n) -> (N, 4, 4).

        The entries of mimic joints in ``q`` are ignored: these joints follow their sources.
        """
    def jacobian(self, q: Numbers, link: str | None = None) -> Array:
        """Compute the Jacobian of ``link`` (default: the hand) in base axes.

        Linear velocity of its origin comes first, then angular velocity. Joints (n,) give (6, n), and joints
        (N, n) give (N, 6, n). Units are m or rad per rad or m. The motion of mimic joints belongs to the columns of
        their sources; their own columns are zero.
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
        """Validate a solver config.

        Args:
            config: fields listed in docs/reference/solver.md.

        Raises:
            ConfigError: a field is unknown, or its value is not finite or of the wrong type.
        """
    def to_dict(self) -> dict[str, Any]:
        """Return the config in the form in which it was given: dicts, lists, strings and numbers."""
    @property
    def gripper(self) -> Gripper:
        """Mode of the fingers that the config requests."""
    @property
    def let_go(self) -> float | None:
        """Distance (m) by which the hand retreats along its z axis after the release; None without a release."""

class Shape:
    """A collision shape in the body frame. Instances can be pickled."""

    @staticmethod
    def box(half_extents: Numbers, pose: Numbers | None = None) -> Shape:
        """Return a box with half extents (3,), m, along the axes of ``pose`` (4, 4); default: the body frame.

        Example:
            ```python
            table = Shape.box([0.4, 0.6, 0.02])  # 0.8 m x 1.2 m x 0.04 m
            ```
        """
    @staticmethod
    def sphere(radius: float, center: Numbers | None = None) -> Shape:
        """Return a sphere with ``radius`` (m) around ``center`` (3,), m; default: the origin of the body frame."""
    @staticmethod
    def capsule(radius: float, length: float, pose: Numbers | None = None) -> Shape:
        """Return a capsule along the z axis of ``pose``; ``length`` (m) is the distance between the caps' centres."""
    @staticmethod
    def cylinder(radius: float, length: float, pose: Numbers | None = None) -> Shape:
        """Return a cylinder (m) along the z axis of ``pose``, approximated by a circumscribed prism of 32 sides."""
    @staticmethod
    def convex_hull(points: Numbers) -> Shape:
        """Return the convex hull of (N, 3) points in the body frame; the points may be coplanar."""
    @staticmethod
    def mesh(vertices: Numbers, triangles: npt.ArrayLike) -> Shape:
        """Return a surface of triangles (M, 3) over vertices (N, 3). The surface is not solid: a body entirely inside
        does not collide with the surface."""
    @staticmethod
    def point_cloud(points: Numbers, radius: float) -> Shape:
        """Return a point cloud (N, 3) whose points are spheres of ``radius`` (m). An empty cloud is no obstacle."""
    @staticmethod
    def voxels(occupied: npt.NDArray[np.bool_], voxel_size: float, origin: Numbers = (0.0, 0.0, 0.0)) -> Shape:
        """Return the occupied voxels of a grid as solid cubes.

        Solid blocks of voxels become larger cubes that fill the same space. A body inside a solid collides with it.

        Args:
            occupied: (nx, ny, nz) array of bool. Voxel [i, j, k] is the cube between
                ``origin + voxel_size * [i, j, k]`` and ``origin + voxel_size * [i + 1, j + 1, k + 1]``.
            voxel_size: edge length of a voxel, m.
            origin: (3,) corner of voxel [0, 0, 0] in the body frame, m. The pose of the body rotates the grid.

        Returns:
            The shape; without occupied voxels it is no obstacle.

        Raises:
            ProblemError: the array has another type or shape, the voxel size is not positive and finite, or the solid
                has more than 1,000,000 cubes.

        Example:
            ```python
            occupied = np.zeros((100, 100, 50), dtype=bool)
            occupied[60:70, :, :20] = True  # a wall, 0.2 m thick and 0.4 m high
            wall = Body("map", "rigid", [Shape.voxels(occupied, 0.02, [-1.0, -1.0, 0.0])], np.eye(4))
            scene = scene.with_body(wall)
            ```
        """
    @staticmethod
    def octree(centers: Numbers, sizes: Numbers) -> Shape:
        """Return solid cubes of one or several sizes, for example the occupied leaves of an OctoMap.

        Args:
            centers: (N, 3) centres of the cubes in the body frame, m.
            sizes: (N,) edge lengths, or one edge length for all cubes, m.

        Raises:
            ProblemError: the lists differ in length, a size is not positive and finite, or there are more than
                1,000,000 cubes.

        Example:
            ```python
            leaves = Shape.octree([[0.5, 0.0, 0.1], [0.65, 0.05, 0.05]], [0.2, 0.1])
            ```
        """
    @staticmethod
    def sdf(
        distances: npt.NDArray[np.float32] | npt.NDArray[np.float64],
        voxel_size: float,
        origin: Numbers = (0.0, 0.0, 0.0),
        *,
        threshold: float | None = None,
        unknown: Literal["occupied", "free"] = "occupied",
    ) -> Shape:
        """Return the obstacles of a signed distance field (TSDF or ESDF) as solid cubes.

        A voxel is an obstacle if the distance at its centre is at most ``threshold``. With the default threshold, no
        obstacle in a known voxel is missed, and no point of the cubes is further than a voxel's diagonal (1.73 voxels)
        from an obstacle: no point of a voxel is further than half a diagonal from its centre. Distances may be
        truncated, at more than the threshold.

        Args:
            distances: (nx, ny, nz) array of float32 or float64: signed distance at the centre of each voxel, m,
                negative inside obstacles, NaN if unknown. It must not exceed the true distance. Projective distances
                (a TSDF) do: compute Euclidean distances from them, or add their error to the threshold.
            voxel_size: edge length of a voxel, m.
            origin: (3,) corner of voxel [0, 0, 0] in the body frame, m; the first distance belongs to the point
                ``origin + voxel_size / 2``.
            threshold: largest distance of an occupied voxel, m; default: half a voxel's diagonal, 0.87 voxels. With a
                smaller threshold, obstacles are thinner, and a part of an obstacle may be missed.
            unknown: whether unknown voxels are obstacles. Space outside the grid is free.

        Raises:
            ProblemError: the array has another type or shape, or an infinite distance; an argument is out of range; or
                the solid has more than 1,000,000 cubes.

        Example:
            ```python
            distances = np.where(observed, esdf, np.nan)
            shape = Shape.sdf(distances, 0.02, origin, unknown="free")
            scene = scene.with_body(Body("map", "rigid", [shape], np.eye(4)))
            ```
        """

class Body:
    """A rigid body of a scene. Instances can be pickled."""

    def __init__(
        self,
        name: str,
        role: Literal["table", "object_body", "moving_link", "rigid", "target", "attached"],
        shapes: Sequence[Shape],
        pose: Numbers,
        *,
        keypoints: Mapping[str, Numbers] | None = None,
    ) -> None:
        """Create a rigid body from shapes.

        Args:
            name: name that no other body of the scene has.
            role: relation to the hand. Hand, fingers and the grasped body may touch a ``target``; an ``attached``
                body moves with the hand.
            shapes: collision shapes in the body frame.
            pose: (4, 4) pose of the body in the robot base frame, or in the hand frame for an attached body.
            keypoints: positions (3,) in the body frame, m. Problems on the scene include them.

        Raises:
            ProblemError: the pose is not rigid, or a number is not finite.
        """
    @property
    def name(self) -> str:
        """Name of the body in its scene."""
    @property
    def role(self) -> str:
        """Role of the body, such as "rigid"."""
    def surface(self) -> tuple[Array, Array]:
        """Return the triangles (M, 3, 3) of the surface, and the spheres (K, 4) as centre and radius, including the
        points of point clouds. All are in the body frame, m."""
    @property
    def pose(self) -> Array:
        """(4, 4) pose of the body in the robot base frame, or in the hand frame for an attached body."""

class Joint:
    """A joint of an object: axis, current value and range."""

    def __init__(
        self,
        kind: Literal["revolute", "prismatic"],
        origin: Numbers,
        axis: Numbers,
        value: float,
        lower: float,
        upper: float,
    ) -> None:
        """Create a joint.

        Args:
            kind: "revolute" for a rotation, "prismatic" for a translation.
            origin: (3,) point on the axis in the robot base frame, m.
            axis: (3,) direction of the axis in the robot base frame.
            value: current value, rad or m.
            lower: lower limit of the value, rad or m.
            upper: upper limit of the value, rad or m.
        """

class SceneJoint:
    """A joint of an object and the names of the bodies that it moves. Instances can be pickled."""

    def __init__(self, name: str, joint: Joint, moves: Sequence[str]) -> None:
        """Create a named joint of the scene with the bodies that it moves."""
    @property
    def name(self) -> str:
        """Name of the joint in its scene."""
    @property
    def value(self) -> float:
        """Current value of the joint, rad or m."""
    @property
    def moves(self) -> list[str]:
        """Names of the bodies that the joint moves."""

class Scene:
    """A robot and its surroundings. All problems on a scene share its shapes and its bounding volume hierarchy. A
    scene is immutable: methods that change it return a new one. Instances can be pickled.

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
            bodies: obstacles, targets and attached bodies; names are unique.
            joints: joints of objects, each with the names of the bodies that it moves.

        Raises:
            ProblemError: two bodies or joints share a name, or a joint moves an unknown body.
        """
    def own_points(self, q: Numbers, points: npt.ArrayLike, clearance: float = 0.02) -> npt.NDArray[np.bool_]:
        """Return which of the points (N, 3) (m, base frame) lie within ``clearance`` (m) of the robot at joints ``q``
        (n,) or of its attached bodies. ``points[~scene.own_points(q, points)]`` are the obstacle points of a
        measured cloud."""
    @property
    def robot(self) -> Robot:
        """The arm."""
    @property
    def bodies(self) -> list[Body]:
        """Bodies of the scene, in the order in which they were given."""
    @property
    def joints(self) -> list[SceneJoint]:
        """Joints of objects, in the order in which they were given."""
    @property
    def tool_keypoints(self) -> dict[str, Array]:
        """Keypoints of the attached bodies in the hand frame, named "body/keypoint"."""
    @property
    def object_keypoints(self) -> dict[str, Array]:
        """Keypoints of all other bodies in the base frame, named "body/keypoint"."""
    def with_joint(self, name: str, value: float) -> Scene:
        """Return the scene with a joint at another value (rad or m, within its range); the joint's bodies move, too."""
    def with_pose(self, body: str, pose: Numbers) -> Scene:
        """Return the scene with a body at another pose (4, 4) in the base frame (in the hand frame if attached)."""
    def with_body(self, body: Body) -> Scene:
        """Return the scene with another body, which replaces the body of the same name, if there is one.

        Object joints that move the former body move the new one. All other bodies are shared.

        Example:
            ```python
            for occupied in camera:  # a new map in every cycle
                scene = scene.with_body(Body("map", "rigid", [Shape.voxels(occupied, 0.02, origin)], np.eye(4)))
            ```
        """
    def without_body(self, body: str) -> Scene:
        """Return the scene without a body; object joints no longer move the body."""
    def with_payload(
        self, mass: float, center_of_mass: Numbers = (0.0, 0.0, 0.0), inertia: Numbers | None = None
    ) -> Scene:
        """Return the scene with a payload in the hand, which replaces an earlier payload.

        The payload belongs to the dynamics of ``scene.robot``: to :meth:`Robot.inverse_dynamics`, and to motions with
        ``torque_limits``. A heavier payload makes these motions slower. If a joint cannot hold the payload, the status
        of the motion is "overloaded", and its reason names the joint, the torque and the limit. The payload has no
        shape: attach a body for collision checks.

        Args:
            mass: mass, kg; 0 removes the payload.
            center_of_mass: (3,) in the frame of the hand's link, m.
            inertia: (3, 3) about the centre of mass, in axes of the hand's link, kg m²; default: a point mass.

        Raises:
            ProblemError: a number is not finite, the mass is negative, or the inertia is not symmetric and positive
                semidefinite.

        Example:
            ```python
            loaded = scene.attached("cup", q).with_payload(1.2, [0.0, 0.0, 0.12])
            motion = loaded.plan_to(q, q_goal, torque_limits=scene.robot.effort)
            ```
        """
    def attached(self, body: str, q: Numbers) -> Scene:
        """Return the scene with a body attached to the hand at joints ``q`` (n,); object joints no longer move
        the body."""
    def detached(self, body: str, q: Numbers, on: str | None = None) -> Scene:
        """Return the scene with an attached body released at the hand's pose for joints ``q`` (n,). The body becomes
        a rigid obstacle; the joint ``on``, if given, moves it."""
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
        """Create a problem on this scene.

        The arguments are those of :class:`KeypointProblem` with two differences: the keypoints of the scene's bodies
        are added to the given ones, and ``joint`` is the name of the joint that the config moves. The bodies moved
        by this joint are the moving link.

        Raises:
            ProblemError: the arguments do not fit the scene or each other.
        """
    def grasps(
        self,
        body: str,
        gripper: ParallelGripper,
        center_of_mass: Numbers | None = None,
        options: GraspOptions | None = None,
    ) -> list[Grasp]:
        """Search for grasps of a body in which the hand avoids the other bodies; the search is deterministic.

        Attached bodies are not avoided.

        Args:
            body: name of the body; its shapes are convex hulls or closed meshes.
            gripper: the robot's gripper.
            center_of_mass: (3,) in the body frame, m; default: centroid of the volume, or of the box around a mesh.
            options: options of the search.

        Returns:
            Grasps, best first; may be empty.

        Raises:
            ProblemError: the body does not exist, or an option is unknown or out of its range.
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
        """Plan a pick and its placements with the first grasp that reaches every target.

        Each grasp is also tried with the fingers swapped. A carried body is checked for collisions as part of the
        hand, so targets must lie slightly above the support.

        Args:
            body: name of the body to pick.
            gripper: the robot's gripper.
            q_start: (n,) joints at the start, rad or m.
            grasps: candidate grasps of the body, best first.
            targets: successive target poses (4, 4) of the body in the base frame, each with a direction (3,) about
                which the body may be rotated, or None for a fixed orientation.
            approach: length of the straight approach of the open hand, m.
            lift: (3,) translation of the hand after the grasp, base frame, m; default: 0.1 m upwards. The hand
                approaches targets by the reverse translation.
            options: options of every plan; ``start_velocity`` and ``start_acceleration`` apply to the pick only,
                since later motions start at rest.

        Returns:
            The grasp with its planned motions; None if no grasp allows all motions.

        Raises:
            ProblemError: an argument does not fit the scene.
        """
    def plan_to(
        self,
        q_start: Numbers,
        goal: Numbers | dict[str, Numbers],
        *,
        link: str | None = None,
        margin: float = 0.005,
        samples: int = 100_000,
        seed: int = 0,
        velocity_scale: float = 1.0,
        acceleration_scale: float = 1.0,
        limits: Literal["panda", "fr3", "plain"] | None = None,
        velocity_limits: Numbers | None = None,
        acceleration_limits: Numbers | None = None,
        jerk_limits: Numbers | None = None,
        torque_limits: Numbers | None = None,
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
        """Plan a timed motion from ``q_start`` to rest at a goal, at least ``margin`` away from all obstacles.

        From a moving start, the planner uses the fastest motion within the limits if this motion is collision-free.
        Otherwise it searches a path around the obstacles.

        Args:
            q_start: (n,) values of all joints; joints that are not planned (``Robot.planned_joints``) keep their
                values.
            goal: joints (n,), alternative joints (K, n), a pose (4, 4) of ``link`` in the base frame, or 1 to 256
                alternative poses (K, 4, 4). For a robot with four joints, a (4, 4) array that is a rigid transform is
                a pose. A dict of two link names and their poses brings both links to their poses, such as the hands
                of two arms. Joints that are not planned keep the value of ``q_start``.
            link: link that must reach the goal pose; default: the hand.
            margin: minimum distance between two bodies, 0 to 0.1 m. Pairs that are closer at the start or the goal
                keep that smaller distance. Links whose shapes prevent the margin must only not collide: they are closer
                in all random configurations, or closer than 10 mm in at least a tenth.
            samples: maximum number of random samples of the search.
            seed: seed of the random samples.
            velocity_scale: fraction of the velocity limits that the motion may use, above 0, at most 1.
            acceleration_scale: the same fraction of the acceleration and jerk limits, above 0, at most 1.
            limits: acceleration and jerk limits of a known arm; "fr3" also has velocity limits that depend on the
                position.
            velocity_limits: (n,) rad/s or m/s instead of the URDF's; required if the URDF has none.
            acceleration_limits: (n,) rad/s^2 or m/s^2 instead of the URDF's and those of ``limits``.
            jerk_limits: (n,) rad/s^3 or m/s^3 instead of the URDF's and those of ``limits``.
            torque_limits: (n,) N m (N for sliding joints); default: torques are not limited.
            path: config whose axis constraints hold along the whole motion: the direction between two tool keypoints
                keeps its angle to a direction of the base (``target_axis_frame`` "world") within ``tolerance`` rad.
                At start and goal, the error of the angle must be below 0.85 of the tolerance.
            tool_keypoints: positions (3,) of the keypoints that ``path`` names, hand frame, m; keypoints of attached
                bodies are added.
            start_velocity: (n,) rad/s or m/s at the start; default: at rest.
            start_acceleration: (n,) rad/s^2 or m/s^2 at the start; default: zero.
            start_time: time at which the motion starts, s.
            warm_start: current motion. The planner continues it if it passes the start at ``start_time``, ends at a
                goal and is still collision-free, unless another motion ends earlier.
            max_checks: maximum number of configurations to check for collisions.
            deadline_ms: wall-clock limit of the search, ms; without a limit, the result is reproducible.
            cancel: flag that ends the search from another thread.

        Returns:
            The motion; ``status`` and ``reason`` explain a failure.

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
    def plan_to_many(
        self,
        q_starts: Sequence[Numbers],
        goals: Sequence[Numbers | dict[str, Numbers]],
        *,
        threads: int | None = None,
        **options: Any,
    ) -> list[Motion]:
        """Plan a motion for each pair of a start and a goal, in parallel. Ctrl-C interrupts planning.

        Args:
            q_starts: N starts (n,), rad or m.
            goals: N goals, each as in :meth:`plan_to`: joints (n,) or (K, n), poses (4, 4) or (K, 4, 4), or a dict of
                two poses.
            threads: number of threads, 1 to 256; default: number of cores.
            options: keyword arguments of :meth:`plan_to`, which hold for all motions. ``deadline_ms`` counts from the
                beginning of each motion.

        Returns:
            The same motions as from :meth:`plan_to`, in the order of the pairs.

        Raises:
            ProblemError: an argument does not fit the robot; the error names the first such pair.

        Example:
            ```python
            motions = scene.plan_to_many([q_now] * len(goals), goals, margin=0.01)
            fastest = min((m for m in motions if m.trajectory), key=lambda m: m.trajectory.duration)
            ```
        """
    def plan_along(
        self,
        q_start: Numbers,
        poses: Sequence[Numbers],
        *,
        position_tolerance: float = 0.001,
        rotation_tolerance: float = 0.01,
        free_axis: Numbers | None = None,
        second_link: str | None = None,
        margin: float = 0.005,
        seed: int = 0,
        velocity_scale: float = 1.0,
        acceleration_scale: float = 1.0,
        limits: Literal["panda", "fr3", "plain"] | None = None,
        velocity_limits: Numbers | None = None,
        acceleration_limits: Numbers | None = None,
        jerk_limits: Numbers | None = None,
        torque_limits: Numbers | None = None,
        start_time: float = 0.0,
        max_checks: int | None = None,
        deadline_ms: float | None = None,
        cancel: Cancel | None = None,
    ) -> Motion:
        """Plan a timed motion from rest at ``q_start`` that brings the hand to each of ``poses`` in turn.

        The hand moves on straight lines and rotates uniformly, from its pose at ``q_start`` to the first pose, and from
        each pose to the next. It stops at a pose only if it could not keep the tolerance otherwise. The joints move
        continuously. If the arm is redundant, other motions of the redundant joints are tried if the hand cannot follow
        the lines, or an obstacle is in the way.

        Args:
            q_start: (n,) values of all joints, rad or m; joints that move neither the hand nor ``second_link`` keep
                their values.
            poses: poses (4, 4) of the hand in the base frame.
            position_tolerance: maximum distance of the hand's origin from the lines, 0.0001 to 0.1 m.
            rotation_tolerance: maximum angle between the hand's orientation and the orientation at the nearest point of
                the line, 0.001 to pi rad.
            free_axis: (3,) axis of the hand frame about which the hand may rotate freely. ``rotation_tolerance`` then
                limits the angle between the directions of this axis.
            second_link: link that keeps the pose relative to the hand that it has at ``q_start``, within the same
                tolerances, such as the other hand of a robot that carries a box with both. Collisions of attached
                bodies with the hand of this link are not checked, because it holds them, too. Not with ``free_axis``.
            margin, velocity_scale, acceleration_scale, limits, velocity_limits, acceleration_limits, jerk_limits,
                torque_limits, start_time, max_checks, deadline_ms, cancel: as for :meth:`plan_to`. The checks are
                counted only between two attempts, so a motion that is found first is returned.
            seed: seed of the motions of the redundant joints that are tried.

        Returns:
            The motion. If there is none, ``reason`` gives the cause, for example the pose and the joint at its limit,
            or the two bodies that are too close. The status is "unreachable" if the hand cannot follow a line, and
            "not_found" if an obstacle is in the way or the tolerance is too small.

        Raises:
            ProblemError: an argument does not fit the robot.

        Example:
            ```python
            motion = scene.plan_along(q_now, [above, below], free_axis=[0, 0, 1])  # a drill may rotate about its axis
            ```
        """
    def ik(
        self,
        pose: Numbers | dict[str, Numbers],
        q_start: Numbers,
        *,
        link: str | None = None,
        max_solutions: int = 16,
        seed: int = 0,
        min_distance: float = 0.05,
        posture: Numbers | None = None,
        posture_weights: Numbers | None = None,
        manipulability: float = 0.0,
        margin: float | None = None,
    ) -> Array:
        """Solve inverse kinematics.

        Without ``posture`` and ``manipulability``, the solutions closest to ``q_start`` come first. Otherwise a
        redundant arm is moved without moving the link, until the sum over all joints of ``posture_weights * (q -
        posture)**2``, minus ``manipulability`` times the manipulability, has a local minimum. The solutions with the
        smallest values come first.

        Args:
            pose: (4, 4) pose of ``link`` in the base frame, or a dict of two link names and their poses.
            q_start: (n,) joints at which the search begins, rad or m. Joints that are not planned, and joints of
                another arm than that of ``link``, keep their values.
            link: link that must reach the pose; default: the hand.
            max_solutions: maximum number of solutions, 1 to 256. With 256, an arm of six joints gets all solutions,
                unless joint ranges above a turn multiply their number.
            seed: seed of the start values, 0 to 1,000,000.
            min_distance: two solutions differ by at least this in at least one joint, 0.001 to 10 rad or m.
            posture: (n,) preferred joint values within the limits, rad or m.
            posture_weights: (n,) weights of the squared distances from ``posture``, 0 to 1e6 (1/rad^2 or 1/m^2);
                default: 1 each.
            manipulability: weight of the manipulability, 0 to 1e6. Manipulability is ``sqrt(det(J @ J.T))`` with the
                Jacobian ``J`` of the link (m and rad), or ``sqrt(det(J.T @ J))`` with fewer than six moving joints.
                It is 0 at a singularity. With two links, their sum counts.
            margin: minimum distance between two bodies at a solution, 0 to 0.1 m. Links whose shapes
                prevent the margin must only not collide (see :meth:`plan_to`). With None, obstacles are ignored.

        Returns:
            Distinct joint vectors (K, n), best first; K is 0 if no solution was found. If the arm is redundant, they
            are a sample of its solutions.

        Raises:
            ProblemError: the pose is not rigid, the link is unknown, or an argument is out of range.

        Example:
            ```python
            q = scene.ik(pose, q_now, max_solutions=1, posture=q_home, margin=0.005)  # (1, n), or (0, n)
            ```
        """
    def in_collision(self, q: Numbers) -> bool | npt.NDArray[np.bool_]:
        """Check whether the robot overlaps a body or itself: (n,) -> bool, (N, n) -> (N,) bool.

        Contact rules do not apply. Fixed links, pairs that the SRDF disables, and attached bodies against the hand
        are not checked.
        """
    def distance(self, q: Numbers, max_distance: float = 1.0) -> float | Array:
        """Measure the smallest signed distance (m) over the pairs that :meth:`in_collision` checks, at most
        ``max_distance``: (n,) -> float, (N, n) -> (N,)."""
    def check(self, q: Numbers, reach: float = 0.0) -> list[Any]:
        """List the pairs closer than ``reach`` (m), closest first, as :class:`CheckedPair`: one list for (n,), N
        lists for (N, n)."""

class Motion:
    """Result of planning a motion to a goal. Instances can be pickled."""

    @property
    def status(self) -> MotionStatus:
        """ "solved", or the failure: "start_blocked", "goals_blocked", "unreachable", "not_found", "untimed" (a
        collision-free path was found, but no motion along it within the limits), "overloaded" (a torque limit does not
        suffice to hold the robot and its payload), "late" (the deadline passed), "cancelled"."""
    @property
    def reason(self) -> str:
        """Explanation of a failure in one sentence; empty if solved."""
    @property
    def trajectory(self) -> Trajectory | None:
        """Timed motion, if solved."""
    @property
    def goal(self) -> int | None:
        """Index, in the list of alternative goals, of the goal at which the motion ends."""
    @property
    def corners(self) -> Array | None:
        """(K, n) vertices of the path that the motion follows."""
    @property
    def nearer(self) -> list[tuple[str, str, float]]:
        """Pairs closer than the margin at the start or the goal: two names and the distance (m) that is kept."""
    @property
    def checks(self) -> int | None:
        """Number of configurations checked for collisions."""
    @property
    def assumed_limits(self) -> list[str]:
        """Limits ("acceleration", "jerk") for which defaults are assumed, because neither the arguments nor the URDF
        give them. Empty without a motion."""
    @property
    def warnings(self) -> list[str]:
        """Warnings: assumed limits with their joints, and links that are never checked for collisions."""
    @property
    def cpu_ms(self) -> float:
        """CPU time of planning (ms)."""

class ServoStep:
    """State of the arm after a step of :class:`Servo`, and how the step was chosen."""

    @property
    def position(self) -> Array:
        """(n,) positions of all joints, rad or m."""
    @property
    def velocity(self) -> Array:
        """(n,) velocities of all joints, rad/s or m/s."""
    @property
    def acceleration(self) -> Array:
        """(n,) accelerations of all joints, rad/s^2 or m/s^2."""
    @property
    def status(self) -> ServoStatus:
        """ "tracking", "limited" (limits or obstacles change the motion that the target asks for), or "braking" (no
        step toward the target was proven safe, and the arm follows the stop that was proven last)."""
    @property
    def limited_by(self) -> list[str]:
        """Limits that determine the step, such as "velocity of joint1", "acceleration of joint1", "range of joint1" or
        "distance of hand and post". Empty if the status is "tracking"."""
    @property
    def distance(self) -> float:
        """Smallest signed distance (m) over all checked pairs before the step; infinity if it is above 80 mm."""

class Servo:
    """Differential inverse kinematics for control loops: moves an arm toward a target that may change in every step.

    Every state keeps the limits of position, velocity, acceleration and jerk of all joints, also between two steps, and
    the distance ``margin`` from obstacles and between links. A step is taken only if the stop that may follow it is
    proven to keep the margin, too. Otherwise the arm follows the stop that was proven last. The arm may stop in front
    of an obstacle that a planned motion (:meth:`Scene.plan_to`) would avoid.

    Scenes do not change. If bodies have moved, create a servo of the new scene and ``reset`` it to the arm's state.

    Example:
        ```python
        servo = Servo(scene, q_start)
        for k in range(1000):
            step = servo.step(target_pose(0.001 * k))
            arm.send(step.position, step.velocity)
        ```
    """

    def __init__(
        self,
        scene: Scene,
        q: Numbers,
        *,
        link: str | None = None,
        margin: float = 0.005,
        posture: Numbers | None = None,
        dt: float = 0.001,
        velocity_scale: float = 1.0,
        acceleration_scale: float = 1.0,
        limits: Literal["panda", "fr3", "plain"] | None = None,
        velocity_limits: Numbers | None = None,
        acceleration_limits: Numbers | None = None,
        jerk_limits: Numbers | None = None,
    ) -> None:
        """Create a servo for an arm that rests at the joints ``q``.

        Args:
            scene: robot and obstacles.
            q: (n,) values of all joints; joints that are not planned keep their values.
            link: link that follows poses and velocities; default: the hand.
            margin: minimum distance between two bodies, 0 to 0.1 m. Pairs that are closer at the start keep that
                smaller distance. Pairs that touch at the start, such as an attached body and its support, may move
                apart and touch again; they overlap by at most 0.1 mm. Links that are closer than ``margin`` in every
                configuration only have to avoid collisions.
            posture: (n,) joint values that a redundant arm moves toward without moving the link; default: ``q``.
            dt: length of a step, 0.0001 to 0.1 s.
            velocity_scale: fraction of the velocity limits that may be used, above 0, at most 1.
            acceleration_scale: fraction of the acceleration and jerk limits that may be used, above 0, at most 1.
            limits: acceleration and jerk limits of a known arm; "fr3" also has velocity limits that depend on the
                position.
            velocity_limits: (n,) velocity limits, rad/s or m/s; they override the URDF's and are required if it has
                none.
            acceleration_limits: (n,) acceleration limits, rad/s^2 or m/s^2; they override the URDF's and ``limits``.
            jerk_limits: (n,) jerk limits, rad/s^3 or m/s^3; they override the URDF's and ``limits``.

        Raises:
            ProblemError: an argument does not fit the robot, or bodies overlap at the start.
        """
    def step(self, target: Numbers | None = None, *, twist: Numbers | None = None) -> ServoStep:
        """Move the arm by one step and return its new state. Without arguments, the arm comes to rest.

        Args:
            target: pose (4, 4) of the link in the base frame, or joint values (n,), which may lie beyond the limits.
            twist: (6,) linear velocity (m/s) and angular velocity (rad/s) in the base frame: with a pose, the velocity
                of this pose, which reduces the distance by which the arm lags behind; without a target, the velocity of
                the link.

        Raises:
            ProblemError: an argument has another shape, is not finite, or changes a joint that does not move the hand.
                The state of the arm stays the same.
        """
    def reset(self, q: Numbers, velocity: Numbers | None = None, acceleration: Numbers | None = None) -> None:
        """Set the state of the arm.

        Args:
            q: (n,) values of all joints.
            velocity: (n,) rad/s or m/s; default: at rest.
            acceleration: (n,) rad/s^2 or m/s^2; default: zero.

        Raises:
            ProblemError: the arm is in collision, or cannot stop within the limits and without coming closer than the
                margin. The former state remains.
        """
    @property
    def dt(self) -> float:
        """Length of a step, s."""
    @property
    def warnings(self) -> list[str]:
        """Warnings: assumed limits with their joints, and links that are never checked for collisions."""

class Cancel:
    """Flag that ends planning from another thread: pass the flag to ``plan`` and call ``cancel``. The flag cannot be
    cleared."""

    def __init__(self) -> None:
        """Create a flag that is not set."""
    def cancel(self) -> None:
        """Set the flag."""
    @property
    def is_cancelled(self) -> bool:
        """Whether the flag is set."""

class KeypointProblem:
    """A planning problem: robot, config, keypoints and obstacles, validated on construction. Instances can be pickled.

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
        """Create and validate a problem.

        Args:
            robot: the arm.
            config: constraints and motions.
            q_start: (n,) joints at the start, rad or m.
            tool_keypoints: positions (3,) in the hand frame, m.
            object_keypoints: positions (3,) in the base frame, m.
            T_base_object: (4, 4) pose of the object frame in the base frame.
            joint: the object's joint, which moves the bodies with role ``moving_link``.
            object_axis: axis of the object frame about which the motion "rotate" turns the hand.
            object_yaw: yaw of the object from the scene's randomization, rad; used by ``frames="original"``.
            T_base_world: (4, 4) pose of the world frame in the base frame; default: identity.
            bodies: obstacles, targets and attached bodies.
            options: options of the problem.

        Raises:
            ProblemError: the parts do not fit each other, or an option is unknown or out of range.
        """
    def with_start(
        self, q: Numbers, velocity: Numbers | None = None, time: float = 0.0, *, acceleration: Numbers | None = None
    ) -> KeypointProblem:
        """Return the problem with another start state; all other data are shared with this problem.

        If position, velocity and acceleration are a sample of another motion, the new motion continues that motion
        smoothly.

        Args:
            q: (n,) joints, rad or m.
            velocity: (n,) rad/s or m/s; default: at rest.
            time: time at which the motion starts, s.
            acceleration: (n,) rad/s^2 or m/s^2; default: zero.
        """
    @property
    def point_targets(self) -> list[Array]:
        """Target (3,) of each point constraint in the base frame (m): the object's keypoint, shifted by the offset."""
    @property
    def scene(self) -> Scene:
        """Scene of the problem, in which the object's joint has the name "joint"."""

class Trajectory:
    """A timed motion of all joints. Instances can be pickled."""

    @property
    def times(self) -> Array:
        """(N,) sample times, at most 0.1 s (or a 100,000th of the motion) apart, including every keyframe time."""
    @property
    def positions(self) -> Array:
        """(N, n) joint positions at ``times``."""
    @property
    def duration(self) -> float:
        """Duration of the motion, s."""
    def sample(self, t: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Sample the motion; it is at rest after its end.

        Args:
            t: one time, or times (N,), s.

        Returns:
            Position, velocity and acceleration: (n,) each for one time, (N, n) each for (N,) times.
        """
    def sample_into(self, t: float, position: Array, velocity: Array, acceleration: Array) -> None:
        """Write position, velocity and acceleration at time t (s) into contiguous float64 arrays (n,), without
        allocating memory, for control loops. Raises ProblemError if an array does not fit."""
    def brake(self, t: float) -> Trajectory:
        """Return the fastest stop found from the state at time t (s), along the motion's path and within its limits
        of velocity, acceleration and jerk. Torque limits of the plan are ignored.

        The stop begins at t. If the motion itself comes to rest sooner, the motion is returned. If no stop along the
        path keeps the limits, for example just before the motion reverses, every joint stops independently, and the
        arm may leave the path.
        """
    def splice(self, next: Trajectory, t: float) -> Trajectory:
        """Return this motion until time t (s) and ``next`` from then on.

        Raises ProblemError if ``next`` does not continue the state at t: position, velocity and acceleration must agree
        within 1e-6, and joints that neither motion moves, such as fingers, must have the same position. Use ``since``
        to drop the part before a time.
        """
    def since(self, t: float) -> Trajectory:
        """Return the part of this motion from time t (s) on. Use it to keep a repeatedly spliced motion short."""
    def sample_every(self, dt: float) -> Array:
        """Return positions (ceil(duration / dt) + 1, n), one row every ``dt`` seconds; at most a million rows."""

class SpeedScale:
    """Executes a motion at a speed that may change in every step, for example because a person comes near the robot.

    The robot stays on the path of the motion. Velocity, acceleration and jerk of all joints keep the limits of the
    motion in each step, also while the speed changes; the jerk is the change of the acceleration between two steps,
    divided by ``dt``. Limits are checked at the end of each step. Torque limits of the plan are not considered during
    changes. Equal targets give equal steps.

    Example:
        ```python
        scaled = SpeedScale(motion.trajectory)
        while not scaled.is_finished:
            q, v, a = scaled.step(0.2 if person_is_near() else 1.0)
            arm.send(q, v)
        ```
    """

    def __init__(self, motion: Trajectory, dt: float = 0.001) -> None:
        """Prepare a motion for steps, at its start and at full speed.

        Args:
            motion: the motion at full speed.
            dt: length of a step, 0.0001 to 0.1 s.

        Raises:
            ProblemError: the length of a step is out of range.
        """
    def step(self, target: float) -> tuple[Array, Array, Array]:
        """Advance by one step toward a speed scale, as fast as the limits allow.

        Args:
            target: fraction of the motion's speed, 0 to 1. 0 stops the robot on the path, and a later target continues
                the motion.

        Returns:
            Position, velocity and acceleration (n,) of all joints after the step.

        Raises:
            ProblemError: the target is not 0 to 1; the robot then does not advance.
        """
    @property
    def time(self) -> float:
        """Time of the motion (s) at which the robot is: ``motion.sample(scaled.time)`` has the same position."""
    @property
    def scale(self) -> float:
        """Current speed scale, 0 to 1."""
    @property
    def is_finished(self) -> bool:
        """Whether the robot has reached the end of the motion."""

class Plan:
    """Result of planning: motion, residuals of the constraints, reason of a failure. Instances can be pickled."""

    @property
    def status(self) -> Status:
        """ "solved", "partial" (a part of the motion, if allowed), or the failure: "actuation_infeasible",
        "unreachable", "collision", "start_in_collision", "not_found" (the search ended without a motion; there may be
        one), "too_fast", "cannot_stop" (no motion from the start stays within the joint limits), "untimed" (a path
        was found, but no motion along it within the limits), "cancelled". Only the first two have a trajectory."""
    @property
    def reason(self) -> str:
        """Reason of a failure in one sentence: the missed constraint and its error, the unreached keyframe, or the
        colliding bodies."""
    @property
    def warnings(self) -> list[str]:
        """Warnings about assumed values and omitted checks."""
    @property
    def margin(self) -> float:
        """Clearance (m) that the motion keeps from bodies that it may not touch, except for the pairs in ``tight``."""
    @property
    def tight(self) -> list[TightPair]:
        """Pairs closer than the margin at the start or at a keyframe that may not touch before or after it:
        ``bodies`` (two names), ``at`` ("start" or a keyframe), ``distance`` (m). The motion keeps this distance
        instead of the margin."""
    @property
    def touches(self) -> list[Touch]:
        """Permitted overlaps at keyframes: ``bodies`` (two names), ``at`` (keyframe), ``depth`` (m)."""
    @property
    def guesses(self) -> list[Guess]:
        """Motions that move the object's joint by an estimated amount: ``toward`` (keyframe), ``travel`` (rad or m),
        ``depth`` (m of overlap tolerated because of the estimate)."""
    @property
    def assumed_limits(self) -> list[str]:
        """Limits ("acceleration", "jerk") for which defaults are assumed, because neither options nor URDF give
        them."""
    @property
    def q_actuation(self) -> Array | None:
        """(n,) actuation pose with the lowest cost that meets all constraints, ignoring obstacles."""
    @property
    def cost(self) -> float | None:
        """Cost of ``q_actuation``."""
    @property
    def q_plan(self) -> Array | None:
        """(n,) actuation pose of the trajectory, or of the failed attempt that came furthest."""
    @property
    def q_best_effort(self) -> Array | None:
        """(n,) pose with the smallest constraint error, if no pose meets the constraints."""
    @property
    def residuals(self) -> list[Residual]:
        """One entry for each constraint: ``name``, ``residual`` (m or rad), ``tolerance``, ``satisfied``."""
    @property
    def keyframes(self) -> list[Keyframe]:
        """One entry for each keyframe, in time order: ``label`` ("pre_1", "pre_0", "actuation", "post_0", "let_go"),
        ``time`` (s or None), ``T_base_hand`` (4, 4), ``reached``."""
    @property
    def trajectory(self) -> Trajectory | None:
        """The motion; None unless the status is "solved" or "partial"."""
    @property
    def tried(self) -> int:
        """Number of actuation poses for which the planner attempted to find a motion."""
    @property
    def tried_poses(self) -> list[TriedPose]:
        """Result for each pose that was tried, if ``explain`` was set: ``q`` (n,), ``rank``, ``status``, ``reason``."""
    @property
    def reached_fraction(self) -> float:
        """Fraction of the motion after the actuation pose that is reachable and collision-free, 0..1."""
    @property
    def collisions(self) -> list[Collision]:
        """Collisions that block the motion: ``bodies`` (two names), ``time`` (s or None), ``toward`` (keyframe),
        ``distance`` (m, negative if they overlap), ``point`` (3,)."""
    @property
    def start_overlap(self) -> float:
        """Largest overlap of a checked pair at the start, m."""
    @property
    def cpu_ms(self) -> CpuTimes:
        """Thread CPU time of planning, ms: ``setup``, ``actuation``, ``trajectory``, ``total``. Not preserved by
        pickling."""
    def to_dict(self) -> dict[str, Any]:
        """Return JSON-compatible data of the plan, including ``times`` and ``positions`` of the trajectory."""

def read_urdf(content: bytes, file: str) -> dict[str, Any]:
    """Parse a URDF without interpreting it: every number is validated, and only URDF's own defaults are added.

    Args:
        content: bytes of the file, in the encoding that it declares.
        file: file name for error messages.

    Returns:
        A dict with ``name``, ``links``, ``joints`` and ``materials``; missing or infinite values are None.

    Raises:
        UrdfError: the content is no valid URDF; the error names the link or joint, the attribute and the remedy.

    Example:
        ```python
        document = kpam.read_urdf(Path("ur5e.urdf").read_bytes(), "ur5e.urdf")
        ```
    """

def read_obj(content: bytes) -> tuple[Array, list[tuple[str, npt.NDArray[np.int64]]], list[str]]:
    """Read a Wavefront OBJ file.

    Args:
        content: bytes of the file.

    Returns:
        Vertices (N, 3); the name and the triangles (M, 3) of each material; the names of the material files.

    Raises:
        ValueError: a vertex is not three numbers, or a face has fewer than three vertices or an invalid index.

    Example:
        ```python
        vertices, materials, libraries = kpam.read_obj(Path("link.obj").read_bytes())
        ```
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
    """Plan a timed motion that meets a problem's constraints. Planning releases the GIL and can be interrupted by
    Ctrl-C.

    Example:
        ```python
        result = plan(problem)
        if result.trajectory is None:
            print(result.status, result.reason)
        ```

    Args:
        problem: robot, config, keypoints and obstacles.
        warm_start: earlier plan of this or a similar problem, whose pose and path are tried first.
        resume: label of the next keyframe, if earlier parts of the plan's motion have been executed. ``q_start`` and
            ``start_velocity`` are then the current state; all other data are those of the problem that was planned.
            After the actuation pose, ``warm_start`` is required.
        max_checks: maximum number of states checked for collisions, a limit independent of the machine.
        deadline_ms: wall-clock limit, ms, after which the best result so far is returned; without a limit, the result
            is reproducible.
        cancel: flag that ends planning from another thread.
        explain: whether to record the result for each tried pose in ``Plan.tried_poses``.

    Returns:
        The plan; if ``status`` is neither "solved" nor "partial", ``reason`` names the failing constraint, keyframe
        or pair of bodies.

    Raises:
        ProblemError: ``warm_start`` or ``resume`` does not fit the problem.
    """

def ik(problem: KeypointProblem, max_solutions: int = 10) -> list[ActuationPose]:
    """Find distinct joint vectors of lowest cost that meet the constraints, ignoring obstacles.

    Args:
        problem: robot, config and keypoints.
        max_solutions: maximum number of solutions.

    Returns:
        Solutions, cheapest first: ``q`` (n,) and ``cost``. Use ``Scene.check`` to find the bodies that a pose touches.

    Example:
        ```python
        for pose in kpam.ik(problem, max_solutions=3):
            print(pose["q"], pose["cost"])
        ```
    """

def joint_travel(problem: KeypointProblem, plan: Plan, times: Numbers) -> Array:
    """Return the travel (N,), rad or m, of the object's joint that the planner assumes at times (N,), s, of a plan.

    Example:
        ```python
        plan = kpam.plan(problem)
        travel = kpam.joint_travel(problem, plan, np.linspace(0.0, plan.trajectory.duration, 50))
        ```
    """

class ParallelGripper:
    """A gripper with two flat pads that move symmetrically. Instances can be pickled."""

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
        """Create a gripper; keypoints and shapes are in the hand frame, m.

        Args:
            tool_head: (3,) midpoint between the pads.
            tool_tail: (3,) point behind the midpoint; the fingers point from here to ``tool_head``.
            tool_side: (3,) point next to the midpoint, in the opening direction of one finger.
            pad: (2,) size of a pad, across and along the fingers, m.
            stroke: (2,) smallest and largest distance between the pads, m.
            palm: shapes that do not move with the fingers.
            fingers: shapes of the finger away from ``tool_side`` and of the finger towards it, at opening zero.
        """
    @staticmethod
    def of_robot(robot: Robot, tool_head: Numbers, tool_tail: Numbers, tool_side: Numbers) -> ParallelGripper:
        """Derive the gripper of a robot whose fingers slide along the axis from ``tool_head`` to ``tool_side``.

        Pads and stroke are derived from the shapes and joint limits of the fingers.

        Raises:
            ProblemError: the robot has no such fingers.
        """
    @property
    def T_hand_grip(self) -> Array:
        """(4, 4) pose of the grip frame in the hand frame. Its x axis is the closing axis, z points along the fingers,
        and the origin is midway between the centres of the pads."""
    @property
    def pad(self) -> tuple[float, float]:
        """Size of a pad across and along the fingers, m."""
    @property
    def stroke(self) -> tuple[float, float]:
        """Smallest and largest distance between the pads, m."""

class Grasp:
    """A grasp of an object. Instances can be pickled."""

    @property
    def T_object_hand(self) -> Array:
        """(4, 4) pose of the hand in the object frame."""
    @property
    def T_base_hand(self) -> Array:
        """(4, 4) pose of the hand in the robot base frame, for the object's current pose."""
    @property
    def approach(self) -> Array:
        """(3,) unit direction in which the hand moves towards the object, robot base frame."""
    @property
    def width(self) -> float:
        """Distance between the pads in the grasp, m."""
    @property
    def opening(self) -> float:
        """Distance between the pads during the approach, m."""
    @property
    def score(self) -> float:
        """Score from 0 to 1; grasps with a higher score rank first."""
    @property
    def quality(self) -> GraspQuality:
        """Terms of the score: ``friction_margin`` (rad inside the friction cone), ``contact`` (fraction of a pad in
        contact), ``lever`` (m, lever arm of gravity about the midpoint of the pads), ``clearance`` (m, of the open
        hand), ``tilt`` (rad between approach and straight down)."""

class GraspPlan:
    """A grasp with the planned motions of the pick and its placements."""

    @property
    def index(self) -> int:
        """Index of the grasp in the list of candidates given to ``plan_grasp``."""
    @property
    def T_object_hand(self) -> Array:
        """(4, 4) pose of the hand in the object frame, possibly with the fingers swapped."""
    @property
    def pick(self) -> Plan:
        """Plan from the start to the grasp ("actuation") and the lift ("post_0")."""
    @property
    def carries(self) -> list[Plan]:
        """Plans to the targets, each starting at the end of the previous one."""

def plan_batch(problems: Sequence[KeypointProblem], threads: int | None = None) -> list[Plan]:
    """Plan several problems in parallel. Ctrl-C interrupts planning.

    Args:
        problems: independent problems.
        threads: number of threads, 1 to 256; default: number of cores.

    Returns:
        The same plans as from :func:`plan`, in the order of the problems.

    Example:
        ```python
        plans = kpam.plan_batch([problem, other], threads=2)
        ```
    """

def min_clearance(problem: KeypointProblem, plan: Plan, step: float) -> Clearances | None:
    """Measure the smallest signed distances (m) of checked pairs along a plan's motion.

    Args:
        problem: the problem that was planned.
        plan: its plan.
        step: time between samples of the motion, s; at least a 100,000th of its duration.

    Returns:
        Smallest distance for each kind of pair: "self", "table", "object"; None if the plan has no motion.

    Example:
        ```python
        print(kpam.min_clearance(problem, kpam.plan(problem), 0.01))
        ```
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
) -> tuple[Trajectory, Array]:
    """Return the fastest motion along the cubic spline through waypoints within velocity, acceleration and jerk
    limits. Ctrl-C interrupts the computation.

    Args:
        waypoints: (N, n) joint positions, rad or m; the natural spline is parametrized by chord length.
        velocity_limits, acceleration_limits, jerk_limits: (n,) per second, per second squared and cubed.
        stops: indices of waypoints at which the motion stops, in addition to the last waypoint.
        slowest: (N - 1,) minimum time of each interval between waypoints, s.
        start_velocity, start_acceleration: (n,) at the first waypoint; default: zero. If the start does not move
            towards the second waypoint, the motion leaves the path in a turn, or stops first if no turn is possible.
        start_time: time of the first waypoint, s.
        position_limits: (n,) lower and upper limits within which a moving start must be able to stop.
        braking: (upper, lower, gain, offset) of each joint, or None. Upwards, the joint moves no faster than
            ``-offset + sqrt(gain * (upper - q))``, downwards no faster than ``-offset + sqrt(gain * (q - lower))``.

    Returns:
        The motion from the start time on, and the times (N,) at which it passes the waypoints.

    Raises:
        ProblemError: an argument is invalid; the error names the argument, which is ``start_velocity`` if no motion
            from the start keeps the limits.

    Example:
        ```python
        motion, times = kpam.retime(waypoints, [2.0] * 6, [10.0] * 6, [100.0] * 6)    # waypoints: (N, 6) rad
        ```
    """

def refine(
    problem: KeypointProblem, plan: Plan, *, times: npt.ArrayLike | None = None, keep_paths: bool = False
) -> Refined:
    """Shorten a plan's waypoint path by sequential quadratic programming with Clarabel.

    The cost is the sum of squared joint steps between waypoints, weighted by the problem's ``joint_weights`` (GenSim2
    weights the first joint by 10). Hand poses at keyframes are kept (position exactly, orientation within
    0.03 rad), joint limits are kept, collision-free steps stay collision-free, and the cost never increases.

    Args:
        problem: the problem that was planned.
        plan: its plan, which has a trajectory.
        times: (N,) times of the motion at which waypoints are placed, s, in addition to its start, end and keyframes;
            default: about 40 evenly spaced times.
        keep_paths: whether the hand also stays on its lines and arcs between keyframes after the actuation.

    Returns:
        ``waypoints`` (N, n), ``times`` (N,), ``keyframes`` (indices of their waypoints), ``cost_before``,
        ``cost_after``, ``rounds``. ``retime`` computes a motion from the waypoints.

    Raises:
        ProblemError: the plan has no motion, or a time lies outside the motion.

    Example:
        ```python
        shorter = kpam.refine(problem, kpam.plan(problem))
        print(shorter["cost_before"], shorter["cost_after"])
        ```
    """
