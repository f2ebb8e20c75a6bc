"""The ROS 2 node: services ``plan_kinematic_path`` and ``apply_planning_scene`` over :class:`gensim2_ros.Planner`."""

from __future__ import annotations

import importlib
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from moveit_msgs.msg import PlanningScene
from moveit_msgs.srv import ApplyPlanningScene, GetMotionPlan
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState, PointCloud2

import gensim2_kpam as kpam

from .arm import Arm
from .planner import Planner
from .refusals import RefusedError
from .responses import motion_plan_response

#: Parameters of MoveIt's joint_limits.yaml: the flag, the value, and the solver's argument.
LIMITS = (
    ("has_velocity_limits", "max_velocity", "velocity_limits"),
    ("has_acceleration_limits", "max_acceleration", "acceleration_limits"),
    ("has_jerk_limits", "max_jerk", "jerk_limits"),
)
#: Prefix of these parameters.
JOINT_LIMITS = "robot_description_planning.joint_limits"


def make(name: str, /, **fields: Any) -> Any:
    """Return the message of a type, such as "std_msgs/msg/Header"."""
    package, _, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)(**fields)


class PlanningNode(Node):
    """Node that answers motion plan requests of MoveIt."""

    def __init__(self) -> None:
        """Read the parameters and the robot, and offer the services."""
        super().__init__("gensim2")
        arm = self._arm()
        margin = self._number("margin", 0.005, 0.0, 0.1)
        self.planner = Planner(arm, margin=margin, options=self._limits(arm))
        self._time_step = self._number("time_step", 0.01, 1e-4, 10.0)
        self._cloud_radius = self._number("cloud_radius", 0.0, 0.0, 10.0)
        self.create_service(GetMotionPlan, "plan_kinematic_path", self._plan)
        self.create_service(ApplyPlanningScene, "apply_planning_scene", self._apply)
        self.create_subscription(JointState, "joint_states", partial(self._refusal, self.planner.set_joints), 10)
        self.create_subscription(PlanningScene, "planning_scene", self._follow, 100)
        if self._cloud_radius > 0.0:
            take = partial(self._refusal, self._cloud)
            self.create_subscription(PointCloud2, "points", take, qos_profile_sensor_data)
        self.get_logger().info(f"plans {list(arm.joints)} of the group {arm.group!r}")

    def _parameter(self, name: str, default: Any) -> Any:
        return self.declare_parameter(name, default).value

    def _number(self, name: str, default: float, lowest: float, highest: float) -> float:
        value = float(self._parameter(name, default))
        if not lowest <= value <= highest:
            raise ValueError(f"the parameter {name} is {value}; it must lie between {lowest} and {highest}")
        return value

    def _arm(self) -> Arm:
        """Read the robot from the parameters that MoveIt's nodes have, too."""
        urdf, srdf = self._parameter("robot_description", ""), self._parameter("robot_description_semantic", "")
        group, hand = self._parameter("group", ""), self._parameter("hand_link", "")
        for name, value in (("robot_description", urdf), ("group", group), ("hand_link", hand)):
            if not value:
                raise ValueError(f"the parameter {name} is empty; set it in the launch file or with -p {name}:=...")
        with tempfile.TemporaryDirectory() as folder:
            files = {"urdf": Path(folder) / "robot.urdf", "srdf": Path(folder) / "robot.srdf"}
            files["urdf"].write_text(self._with_position_limits(urdf), encoding="utf-8")
            if srdf:
                files["srdf"].write_text(srdf, encoding="utf-8")
            return Arm.from_urdf(
                files["urdf"],
                group=group,
                hand_link=hand,
                srdf=files["srdf"] if srdf else None,
                base_link=self._parameter("base_link", "") or None,
            )

    def _with_position_limits(self, urdf: str) -> str:
        """Return the URDF with the position limits of MoveIt's joint_limits.yaml instead of its own."""
        try:
            root = ElementTree.fromstring(urdf)
        except ElementTree.ParseError as error:
            raise ValueError(f"the parameter robot_description is no URDF: {error}") from error
        changed = False
        for joint in root.findall("joint"):
            prefix, limit = f"{JOINT_LIMITS}.{joint.get('name')}", joint.find("limit")
            if joint.get("type") == "fixed" or not self._parameter(f"{prefix}.has_position_limits", False):
                continue
            lower, upper = (float(self._parameter(f"{prefix}.{end}_position", np.nan)) for end in ("min", "max"))
            if limit is None or joint.get("type") == "continuous" or not lower < upper:
                raise ValueError(
                    f"{prefix}: min_position {lower} must be below max_position {upper}, and the URDF must have limits"
                )
            limit.set("lower", str(lower))
            limit.set("upper", str(upper))
            changed = True
        return ElementTree.tostring(root, encoding="unicode") if changed else urdf

    def _limits(self, arm: Arm) -> dict[str, Any]:
        """Return the solver's joint limits. Limits in MoveIt's joint_limits.yaml replace the limits of the URDF."""
        robot, options = arm.robot, {}
        known = self._parameter("limits", "")
        if known:
            options["limits"] = known
        for flag, value, argument in LIMITS:
            own = np.array(getattr(robot, argument.removesuffix("_limits")))
            given = {}
            for name in arm.joints:
                prefix = f"{JOINT_LIMITS}.{name}"
                if self._parameter(f"{prefix}.{flag}", False):
                    given[robot.joint_names.index(name)] = float(self._parameter(f"{prefix}.{value}", 0.0))
            if not given:
                continue
            missing = [n for n in arm.joints if np.isinf(own[(k := robot.joint_names.index(n))]) and k not in given]
            if missing:
                raise ValueError(f"joint_limits: {missing} have no {value} while other joints have; add it")
            # Joints that motions do not move need a number, too.
            own = np.where(np.isinf(own), max(given.values()), own)
            own[list(given)] = list(given.values())
            options[argument] = own
        return options

    def _plan(self, request: Any, response: Any) -> Any:
        answer = self.planner.plan(request.motion_plan_request)
        response.motion_plan_response = motion_plan_response(self.planner.arm, answer, self._time_step, make)
        text = f"{answer.code.name} after {answer.planning_time:.3f} s {answer.message}".rstrip()
        # rclpy refuses another severity at the same line.
        if answer.trajectory is not None:
            self.get_logger().info(text)
        else:
            self.get_logger().warning(text)
        return response

    def _apply(self, request: Any, response: Any) -> Any:
        response.success = not self._refusal(self.planner.apply_scene, request.scene)
        return response

    def _follow(self, message: Any) -> None:
        """Apply a scene of the topic. After a refused scene, whose sender gets no answer, plans are refused, because
        they could hit the objects of this scene."""
        refusal = self._refusal(self.planner.apply_scene, message)
        if refusal:
            self.planner.missing = refusal

    def _cloud(self, message: Any) -> None:
        self.planner.set_cloud(message, self._cloud_radius)

    def _refusal(self, take: Callable[[Any], None], message: Any) -> str:
        """Call ``take`` with a message. Log and return the reason of a refusal; empty if the message was taken."""
        try:
            take(message)
        except RefusedError as refused:
            self.get_logger().error(f"{refused.code.name}: {refused}")
            return str(refused)
        return ""


def main(args: list[str] | None = None) -> None:
    """Run the node until it is interrupted."""
    rclpy.init(args=args)
    try:
        try:
            node = PlanningNode()
        except (ValueError, kpam.KpamError) as error:
            raise SystemExit(f"gensim2_ros: {error}") from error
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
