"""Messages of ROS 2 Jazzy: rosbags' own types, and those of MoveIt and OctoMap by their fields."""

from __future__ import annotations

from array import array
from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

#: Fields of the packages that rosbags does not hold, in the order in which they are serialized.
FIELDS = {
    "object_recognition_msgs/ObjectType": "string key; string db",
    "octomap_msgs/Octomap": "std_msgs/Header header; bool binary; string id; float64 resolution; int8[] data",
    "octomap_msgs/OctomapWithPose": ("std_msgs/Header header; geometry_msgs/Pose origin; octomap_msgs/Octomap octomap"),
    "moveit_msgs/AllowedCollisionEntry": "bool[] enabled",
    "moveit_msgs/AllowedCollisionMatrix": (
        "string[] entry_names; AllowedCollisionEntry[] entry_values; string[] default_entry_names; "
        "bool[] default_entry_values"
    ),
    "moveit_msgs/CollisionObject": (
        "std_msgs/Header header; geometry_msgs/Pose pose; string id; object_recognition_msgs/ObjectType type; "
        "shape_msgs/SolidPrimitive[] primitives; geometry_msgs/Pose[] primitive_poses; shape_msgs/Mesh[] meshes; "
        "geometry_msgs/Pose[] mesh_poses; shape_msgs/Plane[] planes; geometry_msgs/Pose[] plane_poses; "
        "string[] subframe_names; geometry_msgs/Pose[] subframe_poses; byte ADD=0; byte REMOVE=1; byte APPEND=2; "
        "byte MOVE=3; byte operation"
    ),
    "moveit_msgs/AttachedCollisionObject": (
        "string link_name; CollisionObject object; string[] touch_links; "
        "trajectory_msgs/JointTrajectory detach_posture; float64 weight"
    ),
    "moveit_msgs/RobotState": (
        "sensor_msgs/JointState joint_state; sensor_msgs/MultiDOFJointState multi_dof_joint_state; "
        "AttachedCollisionObject[] attached_collision_objects; bool is_diff"
    ),
    "moveit_msgs/LinkPadding": "string link_name; float64 padding",
    "moveit_msgs/LinkScale": "string link_name; float64 scale",
    "moveit_msgs/ObjectColor": "string id; std_msgs/ColorRGBA color",
    "moveit_msgs/PlanningSceneWorld": ("CollisionObject[] collision_objects; octomap_msgs/OctomapWithPose octomap"),
    "moveit_msgs/PlanningScene": (
        "string name; RobotState robot_state; string robot_model_name; "
        "geometry_msgs/TransformStamped[] fixed_frame_transforms; AllowedCollisionMatrix allowed_collision_matrix; "
        "LinkPadding[] link_padding; LinkScale[] link_scale; ObjectColor[] object_colors; "
        "PlanningSceneWorld world; bool is_diff"
    ),
    "moveit_msgs/JointConstraint": (
        "string joint_name; float64 position; float64 tolerance_above; float64 tolerance_below; float64 weight"
    ),
    "moveit_msgs/BoundingVolume": (
        "shape_msgs/SolidPrimitive[] primitives; geometry_msgs/Pose[] primitive_poses; shape_msgs/Mesh[] meshes; "
        "geometry_msgs/Pose[] mesh_poses"
    ),
    "moveit_msgs/PositionConstraint": (
        "std_msgs/Header header; string link_name; geometry_msgs/Vector3 target_point_offset; "
        "BoundingVolume constraint_region; float64 weight"
    ),
    "moveit_msgs/OrientationConstraint": (
        "std_msgs/Header header; geometry_msgs/Quaternion orientation; string link_name; "
        "float64 absolute_x_axis_tolerance; float64 absolute_y_axis_tolerance; float64 absolute_z_axis_tolerance; "
        "uint8 parameterization; uint8 XYZ_EULER_ANGLES=0; uint8 ROTATION_VECTOR=1; float64 weight"
    ),
    "moveit_msgs/VisibilityConstraint": (
        "float64 target_radius; geometry_msgs/PoseStamped target_pose; int32 cone_sides; "
        "geometry_msgs/PoseStamped sensor_pose; float64 max_view_angle; float64 max_range_angle; uint8 SENSOR_Z=0; "
        "uint8 SENSOR_Y=1; uint8 SENSOR_X=2; uint8 sensor_view_direction; float64 weight"
    ),
    "moveit_msgs/Constraints": (
        "string name; JointConstraint[] joint_constraints; PositionConstraint[] position_constraints; "
        "OrientationConstraint[] orientation_constraints; VisibilityConstraint[] visibility_constraints"
    ),
    "moveit_msgs/TrajectoryConstraints": "Constraints[] constraints",
    "moveit_msgs/WorkspaceParameters": (
        "std_msgs/Header header; geometry_msgs/Vector3 min_corner; geometry_msgs/Vector3 max_corner"
    ),
    "moveit_msgs/CartesianPoint": (
        "geometry_msgs/Pose pose; geometry_msgs/Twist velocity; geometry_msgs/Accel acceleration"
    ),
    "moveit_msgs/CartesianTrajectoryPoint": "CartesianPoint point; builtin_interfaces/Duration time_from_start",
    "moveit_msgs/CartesianTrajectory": (
        "std_msgs/Header header; string tracked_frame; CartesianTrajectoryPoint[] points"
    ),
    "moveit_msgs/GenericTrajectory": (
        "std_msgs/Header header; trajectory_msgs/JointTrajectory[] joint_trajectory; "
        "CartesianTrajectory[] cartesian_trajectory"
    ),
    "moveit_msgs/MotionPlanRequest": (
        "WorkspaceParameters workspace_parameters; RobotState start_state; Constraints[] goal_constraints; "
        "Constraints path_constraints; TrajectoryConstraints trajectory_constraints; "
        "GenericTrajectory[] reference_trajectories; string pipeline_id; string planner_id; string group_name; "
        "int32 num_planning_attempts; float64 allowed_planning_time; float64 max_velocity_scaling_factor; "
        "float64 max_acceleration_scaling_factor; string cartesian_speed_limited_link; float64 max_cartesian_speed"
    ),
    "moveit_msgs/RobotTrajectory": (
        "trajectory_msgs/JointTrajectory joint_trajectory; "
        "trajectory_msgs/MultiDOFJointTrajectory multi_dof_joint_trajectory"
    ),
    "moveit_msgs/MoveItErrorCodes": (
        "int32 val; int32 SUCCESS=1; int32 UNDEFINED=0; int32 FAILURE=99999; int32 PLANNING_FAILED=-1; "
        "int32 INVALID_MOTION_PLAN=-2; int32 MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE=-3; "
        "int32 CONTROL_FAILED=-4; int32 UNABLE_TO_AQUIRE_SENSOR_DATA=-5; int32 TIMED_OUT=-6; int32 PREEMPTED=-7; "
        "int32 START_STATE_IN_COLLISION=-10; int32 START_STATE_VIOLATES_PATH_CONSTRAINTS=-11; "
        "int32 START_STATE_INVALID=-26; int32 GOAL_IN_COLLISION=-12; int32 GOAL_VIOLATES_PATH_CONSTRAINTS=-13; "
        "int32 GOAL_CONSTRAINTS_VIOLATED=-14; int32 GOAL_STATE_INVALID=-27; int32 UNRECOGNIZED_GOAL_TYPE=-28; "
        "int32 INVALID_GROUP_NAME=-15; int32 INVALID_GOAL_CONSTRAINTS=-16; int32 INVALID_ROBOT_STATE=-17; "
        "int32 INVALID_LINK_NAME=-18; int32 INVALID_OBJECT_NAME=-19; int32 FRAME_TRANSFORM_FAILURE=-21; "
        "int32 COLLISION_CHECKING_UNAVAILABLE=-22; int32 ROBOT_STATE_STALE=-23; int32 SENSOR_INFO_STALE=-24; "
        "int32 COMMUNICATION_FAILURE=-25; int32 CRASH=-29; int32 ABORT=-30; int32 NO_IK_SOLUTION=-31; "
        "string message; string source"
    ),
    "moveit_msgs/MotionPlanResponse": (
        "RobotState trajectory_start; string group_name; RobotTrajectory trajectory; float64 planning_time; "
        "MoveItErrorCodes error_code"
    ),
}

_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4


@cache
def store() -> Any:
    """Return the message types."""
    found = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name, fields in FIELDS.items():
        package, kind = name.split("/")
        types |= get_types_from_msg("\n".join(fields.split("; ")), f"{package}/msg/{kind}")
    found.register(types)
    return found


def make(name: str, /, **fields: Any) -> Any:
    """Return a message; fields that are not given have the defaults of ROS. Serialization checks the types."""
    types = store()
    known = dict(types.fielddefs[name][1])
    assert not set(fields) - set(known), f"{name} has no {set(fields) - set(known)}"
    values = {key: _stored(kind, fields[key]) if key in fields else _default(kind) for key, kind in known.items()}
    return types.types[name](**values)


def message(name: str, /, **fields: Any) -> Any:
    """Return a message that has been serialized to CDR and read again, as a subscriber gets it."""
    types = store()
    return types.deserialize_cdr(bytes(types.serialize_cdr(make(name, **fields), name)), name)


def _default(kind: Any) -> Any:
    number, inner = int(kind[0]), kind[1]
    if number == _NAME:
        values = {"w": 1.0} if inner == "geometry_msgs/msg/Quaternion" else {}
        return make(inner, **values)
    if number == _BASE:
        return {"string": "", "bool": False}.get(inner[0], 0.0 if inner[0].startswith("float") else 0)
    return _stored(kind, [make(inner[0][1])] * inner[1] if number == _ARRAY and inner[0][0] == _NAME else [])


def _stored(kind: Any, value: Any) -> Any:
    """Return a value as rosbags stores it: sequences of numbers as NumPy arrays."""
    number, inner = int(kind[0]), kind[1]
    if number not in (_ARRAY, _SEQUENCE) or int(inner[0][0]) != _BASE or inner[0][1][0] == "string":
        return value
    if isinstance(value, array):
        assert value.typecode == "d", "rclpy stores float64 sequences as array('d')"
    name = {"bool": "bool", "byte": "uint8", "octet": "uint8"}.get(inner[0][1][0], inner[0][1][0])
    return np.asarray(value, dtype=name)
