"""The ROS 2 node on a fake rclpy, which calls its callbacks."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from functools import partial
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from gensim2_ros import ErrorCode

from .ros_messages import make, message, store
from .ros_requests import GOAL, START, UR5E, at, difference, header, joint_goal, joint_state, primitive, request, thing

JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
PARAMETERS = {"robot_description": UR5E.read_text(encoding="utf-8"), "group": "manipulator", "hand_link": "flange"}


class FakeLogger:
    """A logger that collects texts and, like rclpy, refuses another severity at the same line of the caller."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self._severities: dict[int, str] = {}

    def __getattr__(self, severity: str) -> Callable[[str], None]:
        def log(text: str) -> None:
            line = sys._getframe(1).f_lineno
            assert self._severities.setdefault(line, severity) == severity, "Logger severity cannot be changed"
            self.texts.append(text)

        return log


class FakeNode:
    """A node without ROS 2: parameters of ``given``, and callbacks by the name of their service or topic."""

    given: ClassVar[dict[str, Any]] = {}

    def __init__(self, name: str) -> None:
        self.name = name
        self.callbacks: dict[str, Callable[..., Any]] = {}
        self.logger = FakeLogger()

    def declare_parameter(self, name: str, default: Any) -> Any:
        value = self.given.get(name, default)
        assert type(value) is type(default), f"rclpy refuses {name}: {value!r}"
        return SimpleNamespace(value=value)

    def create_service(self, _kind: Any, name: str, callback: Callable[..., Any]) -> None:
        self.callbacks[name] = callback

    def create_subscription(self, _kind: Any, topic: str, callback: Callable[..., Any], _qos: Any) -> None:
        self.callbacks[topic] = callback

    def get_logger(self) -> FakeLogger:
        return self.logger


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The node's module, with modules of ROS 2 whose messages are those of rosbags."""

    def module(name: str, **names: Any) -> None:
        made = ModuleType(name)
        vars(made).update(names)
        monkeypatch.setitem(sys.modules, name, made)

    module("rclpy")
    module("rclpy.node", Node=FakeNode)
    module("rclpy.executors", ExternalShutdownException=RuntimeError)
    module("rclpy.qos", qos_profile_sensor_data=None)
    for package in ("builtin_interfaces", "moveit_msgs", "sensor_msgs", "std_msgs", "trajectory_msgs"):
        kinds = [each.split("/") for each in store().types if each.startswith(f"{package}/msg/")]
        module(package)
        module(f"{package}.msg", **{kind: partial(make, f"{package}/msg/{kind}") for *_, kind in kinds})
    module("moveit_msgs.srv", GetMotionPlan=None, ApplyPlanningScene=None)
    monkeypatch.delitem(sys.modules, "gensim2_ros.node", raising=False)
    monkeypatch.setattr(FakeNode, "given", PARAMETERS)
    yield importlib.import_module("gensim2_ros.node")
    sys.modules.pop("gensim2_ros.node", None)


def plan(node: Any, **fields: Any) -> Any:
    asked = SimpleNamespace(motion_plan_request=request(joint_goal(JOINTS, GOAL), **fields))
    answer = node.callbacks["plan_kinematic_path"](asked, SimpleNamespace()).motion_plan_response
    written = store().serialize_cdr(answer, "moveit_msgs/msg/MotionPlanResponse")
    return store().deserialize_cdr(bytes(written), "moveit_msgs/msg/MotionPlanResponse")


def test_the_services_plan_in_the_scene_of_the_topics(node: Any) -> None:
    planning = node.PlanningNode()
    assert plan(planning).error_code.val == ErrorCode.INVALID_ROBOT_STATE
    planning.callbacks["joint_states"](joint_state(JOINTS, START))
    straight = plan(planning).trajectory.joint_trajectory
    post = thing("post", primitive(1, 0.1, 0.1, 1.0), at(0.5, 0.0, 0.5))
    applied = SimpleNamespace(scene=difference(post))
    assert planning.callbacks["apply_planning_scene"](applied, SimpleNamespace()).success
    around = plan(planning).trajectory.joint_trajectory
    assert len(around.points) > len(straight.points) > 2
    assert planning.logger.texts[-1].startswith("SUCCESS after")
    applied = SimpleNamespace(scene=difference(thing("x", primitive(1, 0.1, 0.1, 0.1), header=header("map"))))
    assert not planning.callbacks["apply_planning_scene"](applied, SimpleNamespace()).success
    assert planning.logger.texts[-1].startswith("FRAME_TRANSFORM_FAILURE: world.collision_objects[0].header.frame_id")
    # The service has told its caller that nothing changed; the sender of a topic does not know it.
    assert plan(planning).error_code.val == ErrorCode.SUCCESS
    planning.callbacks["planning_scene"](applied.scene)
    planning.callbacks["planning_scene"](difference(post))
    refused = plan(planning).error_code
    assert refused.val == ErrorCode.COLLISION_CHECKING_UNAVAILABLE
    assert "world.collision_objects[0].header.frame_id" in refused.message
    planning.callbacks["planning_scene"](message("moveit_msgs/msg/PlanningScene"))
    assert len(plan(planning).trajectory.joint_trajectory.points) == len(straight.points)
    assert "points" not in planning.callbacks


def test_limits_are_those_of_moveits_file(node: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    limits: dict[str, Any] = {"time_step": 0.02}
    for name in JOINTS:
        prefix = f"robot_description_planning.joint_limits.{name}"
        limits |= {f"{prefix}.has_acceleration_limits": True, f"{prefix}.max_acceleration": 2.0}
    prefix = "robot_description_planning.joint_limits.elbow_joint"
    limits |= {f"{prefix}.has_velocity_limits": True, f"{prefix}.max_velocity": 0.1}
    limits |= {f"{prefix}.has_position_limits": True, f"{prefix}.min_position": -2.0, f"{prefix}.max_position": 1.6}
    monkeypatch.setattr(FakeNode, "given", {**PARAMETERS, **limits})
    planning = node.PlanningNode()
    np.testing.assert_allclose(planning.planner.options["acceleration_limits"], 2.0)
    robot = planning.planner.arm.robot
    assert (robot.lower[2], robot.upper[2], robot.upper[0]) == (-2.0, 1.6, 3.1416)
    velocity = planning.planner.arm.robot.velocity.copy()
    velocity[2] = 0.1
    np.testing.assert_allclose(planning.planner.options["velocity_limits"], velocity)
    planning.callbacks["joint_states"](joint_state(JOINTS, START))
    points = plan(planning).trajectory.joint_trajectory.points
    assert np.abs([point.accelerations for point in points]).max() <= 2.0 + 1e-9
    steps = np.diff([point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in points])
    assert 0.015 < steps.min() <= steps.max() <= 0.02 + 1e-9
    del limits["robot_description_planning.joint_limits.wrist_3_joint.has_acceleration_limits"]
    monkeypatch.setattr(FakeNode, "given", {**PARAMETERS, **limits})
    with pytest.raises(ValueError, match=r"\['wrist_3_joint'\] have no max_acceleration"):
        node.PlanningNode()
    del limits[f"{prefix}.max_position"]
    monkeypatch.setattr(FakeNode, "given", {**PARAMETERS, **limits})
    with pytest.raises(ValueError, match=r"elbow_joint: min_position -2\.0 must be below max_position nan"):
        node.PlanningNode()


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("hand_link", "", "is empty"),
        ("robot_description", "robot", "is no URDF"),
        ("time_step", 0.0, r"is 0\.0; it must lie between"),
        ("margin", -0.1, r"is -0\.1; it must lie between"),
        ("cloud_radius", float("nan"), "is nan; it must lie between"),
    ],
)
def test_missing_and_wrong_parameters_are_named(
    node: Any, monkeypatch: pytest.MonkeyPatch, name: str, value: Any, text: str
) -> None:
    monkeypatch.setattr(FakeNode, "given", {**PARAMETERS, name: value})
    with pytest.raises(ValueError, match=f"the parameter {name} {text}"):
        node.PlanningNode()
