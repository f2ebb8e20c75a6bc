"""Requests and objects that several tests send."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gensim2_ros import Arm, Planner
from scipy.spatial.transform import Rotation

from .ros_messages import make, message

ROOT = Path(__file__).parents[2]
UR5E = ROOT / "examples/robots/ur5e.urdf"
PANDA = ROOT / "python/gensim2/robots/franka_description/panda.urdf"
#: Joints of the UR5e on both sides of a post at x = 0.5 m, rad.
START = np.array([0.8, -1.2, 1.5, -1.9, -1.6, 0.0])
GOAL = np.array([-0.8, -1.2, 1.5, -1.9, -1.6, 0.0])
#: Joints of the Panda with open fingers.
PANDA_START = np.array([0.0, -0.32, 0.0, -2.61799, 0.0, 2.23, 0.785398, 0.04, 0.04])


def ur5e_planner(**options: Any) -> Planner:
    """Return a planner of the UR5e, which is at ``START``."""
    arm = Arm.from_urdf(UR5E, group="manipulator", hand_link="flange")
    planner = Planner(arm, options=options or {"acceleration_limits": [5.0] * 6, "jerk_limits": [100.0] * 6})
    planner.set_joints(joint_state(arm.joints, START))
    return planner


def panda_planner() -> Planner:
    """Return a planner of the Panda, which is at ``PANDA_START``."""
    arm = Arm.from_urdf(PANDA, group="panda_arm", hand_link="panda_hand", srdf=PANDA.with_suffix(".srdf"))
    planner = Planner(arm, options={"limits": "panda"})
    planner.set_joints(joint_state(arm.robot.joint_names, PANDA_START))
    return planner


def joint_state(names: Sequence[str], values: Any) -> Any:
    return message("sensor_msgs/msg/JointState", name=list(names), position=np.asarray(values, float))


def header(frame: str = "") -> Any:
    return make("std_msgs/msg/Header", frame_id=frame)


def vector3(xyz: Sequence[float]) -> Any:
    return make("geometry_msgs/msg/Vector3", x=float(xyz[0]), y=float(xyz[1]), z=float(xyz[2]))


def quaternion(turn: Any) -> Any:
    """Return the message of a rotation matrix (3, 3)."""
    x, y, z, w = (float(each) for each in Rotation.from_matrix(turn).as_quat())
    return make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def pose(matrix: Any) -> Any:
    """Return the message of a pose (4, 4)."""
    x, y, z = (float(each) for each in matrix[:3, 3])
    return make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=quaternion(matrix[:3, :3]),
    )


def at(x: float, y: float, z: float, turn: Any = None) -> np.ndarray:
    """Return the pose (4, 4) of an origin (m) and a rotation vector (rad)."""
    out = np.eye(4)
    out[:3, 3] = [x, y, z]
    if turn is not None:
        out[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    return out


def primitive(kind: int, *dimensions: float, corners: Sequence[tuple[float, float]] = ()) -> Any:
    points = [make("geometry_msgs/msg/Point32", x=float(x), y=float(y)) for x, y in corners]
    polygon = make("geometry_msgs/msg/Polygon", points=points)
    return make("shape_msgs/msg/SolidPrimitive", type=kind, dimensions=list(dimensions), polygon=polygon)


def thing(name: str, shape: Any = None, place: Any = None, **fields: Any) -> Any:
    """Return a CollisionObject; ``place`` (4, 4) is the pose of its shape."""
    shapes = (
        {}
        if shape is None
        else {"primitives": [shape], "primitive_poses": [pose(np.eye(4) if place is None else place)]}
    )
    return make("moveit_msgs/msg/CollisionObject", **{"id": name, "header": header(), **shapes, **fields})


def difference(*things: Any, **fields: Any) -> Any:
    """Return a PlanningScene that is a difference with the collision objects ``things``."""
    world = {"world": make("moveit_msgs/msg/PlanningSceneWorld", collision_objects=list(things))}
    return message("moveit_msgs/msg/PlanningScene", **{"is_diff": True, **world, **fields})


def joint_goal(names: Sequence[str], values: Any) -> Any:
    fields = {"tolerance_above": 1e-3, "tolerance_below": 1e-3, "weight": 1.0}
    pairs = zip(names, values, strict=True)
    each = [make("moveit_msgs/msg/JointConstraint", joint_name=n, position=float(v), **fields) for n, v in pairs]
    return make("moveit_msgs/msg/Constraints", joint_constraints=each)


def orientation(link: str, turn: Any, tolerances: Sequence[float], *, vector: bool = False, frame: str = "") -> Any:
    x, y, z = tolerances
    return make(
        "moveit_msgs/msg/OrientationConstraint",
        header=header(frame),
        link_name=link,
        orientation=quaternion(turn),
        absolute_x_axis_tolerance=x,
        absolute_y_axis_tolerance=y,
        absolute_z_axis_tolerance=z,
        parameterization=int(vector),
        weight=1.0,
    )


def position(link: str, point: Any, *, offset: Sequence[float] = (0, 0, 0), frame: str = "") -> Any:
    region = make(
        "moveit_msgs/msg/BoundingVolume",
        primitives=[primitive(2, 0.001)],
        primitive_poses=[pose(at(*point))],
    )
    fields = {"target_point_offset": vector3(offset), "constraint_region": region, "weight": 1.0}
    return make("moveit_msgs/msg/PositionConstraint", header=header(frame), link_name=link, **fields)


def pose_goal(positions: Sequence[Any], orientations: Sequence[Any] = ()) -> Any:
    fields = {"position_constraints": list(positions), "orientation_constraints": list(orientations)}
    return make("moveit_msgs/msg/Constraints", **fields)


def request(*goals: Any, **fields: Any) -> Any:
    """Return a MotionPlanRequest of the UR5e."""
    known = {"group_name": "manipulator", "allowed_planning_time": 20.0, "goal_constraints": list(goals)}
    return message("moveit_msgs/msg/MotionPlanRequest", **{**known, **fields})
