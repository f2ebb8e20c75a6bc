"""Messages of answers."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import gensim2_kpam as kpam

from .arm import Arm
from .planner import Answer
from .poses import Array

#: Function that makes a message: the type's name, such as "std_msgs/msg/Header", and all fields by name.
Make = Callable[..., Any]


def joint_trajectory(arm: Arm, trajectory: kpam.Trajectory | None, time_step: float, make: Make) -> Any:
    """Return the ``trajectory_msgs/msg/JointTrajectory`` of a motion: the joints of the group, and points with
    position, velocity and acceleration at most ``time_step`` (s) apart.

    Args:
        arm: the robot.
        trajectory: the motion; None gives a trajectory without points.
        time_step: largest time between two points, s.
        make: function that makes messages.
    """
    names = list(arm.joints) if trajectory is not None else []
    points = _points(arm, trajectory, time_step, make) if trajectory is not None else []
    return make("trajectory_msgs/msg/JointTrajectory", header=_header(arm, make), joint_names=names, points=points)


def motion_plan_response(arm: Arm, answer: Answer, time_step: float, make: Make) -> Any:
    """Return the ``moveit_msgs/msg/MotionPlanResponse`` of an answer.

    Args:
        arm: the robot.
        answer: the answer.
        time_step: largest time between two points, s.
        make: function that makes messages, called with the type's name and all fields.

    Example:
        ```python
        def make(name, /, **fields):  # of rclpy
            package, _, kind = name.split("/")
            return getattr(importlib.import_module(f"{package}.msg"), kind)(**fields)


        response = motion_plan_response(planner.arm, planner.plan(request), 0.01, make)
        ```
    """
    return make(
        "moveit_msgs/msg/MotionPlanResponse",
        trajectory_start=_state(arm, answer.q_start, make),
        group_name=arm.group,
        trajectory=make(
            "moveit_msgs/msg/RobotTrajectory",
            joint_trajectory=joint_trajectory(arm, answer.trajectory, time_step, make),
            multi_dof_joint_trajectory=make(
                "trajectory_msgs/msg/MultiDOFJointTrajectory", header=_header(arm, make), joint_names=[], points=[]
            ),
        ),
        planning_time=answer.planning_time,
        error_code=make(
            "moveit_msgs/msg/MoveItErrorCodes", val=int(answer.code), message=answer.message, source="gensim2"
        ),
    )


def _points(arm: Arm, trajectory: kpam.Trajectory, time_step: float, make: Make) -> list[Any]:
    count = int(np.ceil(trajectory.duration / time_step)) + 1
    times = np.linspace(0.0, trajectory.duration, max(count, 2))
    columns = [arm.robot.joint_names.index(name) for name in arm.joints]
    position, velocity, acceleration = (each[:, columns] for each in trajectory.sample(times))
    velocity[-1], acceleration[-1] = 0.0, 0.0
    return [
        make(
            "trajectory_msgs/msg/JointTrajectoryPoint",
            positions=_numbers(q),
            velocities=_numbers(v),
            accelerations=_numbers(a),
            effort=_numbers([]),
            time_from_start=_duration(float(t), make),
        )
        for t, q, v, a in zip(times, position, velocity, acceleration, strict=True)
    ]


def _duration(seconds: float, make: Make) -> Any:
    sec, nanosec = divmod(round(seconds * 1e9), 10**9)
    return make("builtin_interfaces/msg/Duration", sec=sec, nanosec=nanosec)


def _header(arm: Arm, make: Make) -> Any:
    stamp = make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=arm.base_frames[0])


def _state(arm: Arm, q: Array, make: Make) -> Any:
    names = arm.robot.joint_names if len(q) else []
    return make(
        "moveit_msgs/msg/RobotState",
        joint_state=make(
            "sensor_msgs/msg/JointState",
            header=_header(arm, make),
            name=list(names),
            position=_numbers(q),
            velocity=_numbers([]),
            effort=_numbers([]),
        ),
        multi_dof_joint_state=make(
            "sensor_msgs/msg/MultiDOFJointState",
            header=_header(arm, make),
            joint_names=[],
            transforms=[],
            twist=[],
            wrench=[],
        ),
        attached_collision_objects=[],
        is_diff=False,
    )


def _numbers(values: Sequence[float] | Array) -> array[float]:
    """Return numbers as the type in which rclpy stores float64 sequences."""
    return array("d", [float(value) for value in values])
