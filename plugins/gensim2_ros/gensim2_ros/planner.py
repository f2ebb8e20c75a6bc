"""Answer motion plan requests of MoveIt with the solver."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import gensim2_kpam as kpam

from .arm import Arm
from .goals import PoseGoal, goal_of, joint_goals
from .path_constraints import PathConstraints, path_constraints_of
from .poses import Array, transform
from .refusals import ErrorCode, RefusedError
from .world import World

#: Name of the pipeline and of the planner in requests; an empty name is the same.
NAMES = ("", "gensim2")
#: Speeds (rad/s or m/s) of a start state that count as rest, because measured speeds are never zero.
REST = 0.01
#: Largest distance (rad or m) of a measured start from the joint limits that is moved to the limit.
BEYOND = 0.002
#: Planning time (s) of a request without one, as in MoveIt.
PLANNING_TIME = 1.0
#: Error code of each status of a motion.
CODES = {
    "solved": ErrorCode.SUCCESS,
    "start_blocked": ErrorCode.START_STATE_IN_COLLISION,
    "goals_blocked": ErrorCode.GOAL_IN_COLLISION,
    "unreachable": ErrorCode.NO_IK_SOLUTION,
    "not_found": ErrorCode.PLANNING_FAILED,
    "untimed": ErrorCode.PLANNING_FAILED,
    "overloaded": ErrorCode.PLANNING_FAILED,
    "cannot_stop": ErrorCode.START_STATE_INVALID,
    "late": ErrorCode.TIMED_OUT,
    "cancelled": ErrorCode.PREEMPTED,
}


@dataclass(frozen=True)
class Answer:
    """Answer to a motion plan request.

    Attributes:
        code: error code of MoveIt.
        message: why there is no motion; with a motion, the solver's warnings.
        planning_time: wall-clock time of planning, s.
        q_start: (n,) joints at the start; empty if the start state was refused.
        trajectory: the motion, if any.
    """

    code: ErrorCode
    message: str
    planning_time: float
    q_start: Array
    trajectory: kpam.Trajectory | None


class Planner:
    """Plans motions of an arm in the world of MoveIt's messages.

    Messages may be those of ``rclpy`` or any objects with the same fields. All methods that take a message raise
    :class:`RefusedError` if the solver cannot honour it, and then change nothing.

    Example:
        ```python
        planner = Planner(Arm.from_urdf("ur5e.urdf", group="manipulator", hand_link="flange"))
        planner.set_joints(joint_state)
        planner.apply_scene(planning_scene)
        answer = planner.plan(motion_plan_request)
        if answer.trajectory is None:
            print(answer.code.name, answer.message)
        ```
    """

    def __init__(self, arm: Arm, *, margin: float = 0.005, options: Mapping[str, Any] | None = None) -> None:
        """Create a planner of an arm in an empty world, with unknown joints.

        Args:
            arm: the robot.
            margin: minimum distance between two bodies, m.
            options: further keyword arguments of ``Scene.plan_to``, such as ``limits`` or ``acceleration_limits``.
        """
        self.arm, self.margin, self.options = arm, margin, dict(options or {})
        self.joints: dict[str, float] = {}
        self.world = World(arm)
        #: Fault of a planning scene that the world lacks; plans are refused until a whole scene is applied. Else empty.
        self.missing = ""

    def set_joints(self, message: Any) -> None:
        """Take the positions of a ``sensor_msgs/msg/JointState`` for the current ones. Joints of other robots and
        messages without positions are ignored."""
        if len(message.position):
            self.joints = {**self.joints, **_positions(message, "", self.arm.robot.joint_names)}

    def apply_scene(self, message: Any) -> None:
        """Apply a ``moveit_msgs/msg/PlanningScene``, whole or a difference."""
        joints = self._joints(message.robot_state, "robot_state")
        world = self.world.updated(message, self.arm.vector(joints))
        self.joints, self.world = joints, world
        if not message.is_diff:
            self.missing = ""

    def set_cloud(self, message: Any, radius: float) -> None:
        """Replace the cloud obstacle by spheres of ``radius`` (m) at the points of a ``sensor_msgs/msg/PointCloud2``.
        Points on the robot are left out, and so are points more than 100 m away."""
        q = self._known(self.arm.vector(self.joints), "joint_states")
        self.world = self.world.with_cloud(message, radius, q)

    def plan(self, request: Any) -> Answer:
        """Plan the motion of a ``moveit_msgs/msg/MotionPlanRequest``.

        Refusals are answers, too: their code and message say which field cannot be honoured.
        """
        begun = time.perf_counter()
        q = np.zeros(0)
        try:
            _check(request, self.arm)
            if self.missing:
                raise RefusedError(
                    ErrorCode.COLLISION_CHECKING_UNAVAILABLE,
                    "planning_scene",
                    f"the scene of a topic was refused ({self.missing}); send a whole scene, with is_diff false",
                )
            q = self._start(request.start_state)
            motion = self._motion(request, q, begun)
        except RefusedError as refused:
            return Answer(refused.code, str(refused), time.perf_counter() - begun, q, None)
        message = "; ".join(motion.warnings) if motion.trajectory is not None else motion.reason
        return Answer(CODES[motion.status], message, time.perf_counter() - begun, q, motion.trajectory)

    def _motion(self, request: Any, q: Array, begun: float) -> kpam.Motion:
        world = self.world.with_state(request.start_state, "start_state", q)
        path = path_constraints_of(request.path_constraints, world, q)
        if not request.goal_constraints:
            raise RefusedError(ErrorCode.INVALID_GOAL_CONSTRAINTS, "goal_constraints", "is empty; give a goal")
        goals = [goal_of(each, f"goal_constraints[{k}]", world, q) for k, each in enumerate(request.goal_constraints)]
        allowed = float(request.allowed_planning_time)
        end = begun + (allowed if allowed > 0.0 else PLANNING_TIME)
        options = {
            **self.options,
            **path.options(),
            "margin": self.margin,
            "velocity_scale": _scale(request, "max_velocity_scaling_factor"),
            "acceleration_scale": _scale(request, "max_acceleration_scaling_factor"),
            "start_velocity": self._velocity(request.start_state),
        }
        try:
            scene = world.scene(q)
            goal: Any
            if len(goals) == 1 and isinstance(goals[0], PoseGoal) and len(goals[0].poses) == 1:
                goal, options["link"] = goals[0].poses[0], goals[0].link
            else:
                goal = self._goals(goals, scene, q, path, end)
            return self._first(scene, q, goal, options, int(request.num_planning_attempts), end)
        except kpam.ProblemError as error:
            raise _problem(error, path, self.arm) from error

    def _start(self, state: Any) -> Array:
        """Return the joints (n,) at the start. Values slightly beyond a limit, which are usual for measured joints, are
        moved to the limit."""
        robot = self.arm.robot
        q = self._known(self.arm.vector(self._joints(state, "start_state")), "start_state")
        inside = np.clip(q, robot.lower, robot.upper)
        return np.asarray(robot.apply_mimic(np.where(np.abs(q - inside) <= BEYOND, inside, q)))

    def _goals(self, goals: Any, scene: kpam.Scene, q: Array, path: PathConstraints, end: float) -> Array:
        def keeps(row: Array) -> bool:
            return path.keeps(self.arm.robot, row)

        return joint_goals(goals, scene, q, keeps, lambda: time.perf_counter() > end)

    @staticmethod
    def _first(scene: kpam.Scene, q: Array, goal: Any, options: Any, attempts: int, end: float) -> kpam.Motion:
        """Return the first motion that is found with different seeds, or the last failure."""
        for attempt in range(max(1, attempts)):
            left = max(1.0, 1000.0 * (end - time.perf_counter()))
            motion = scene.plan_to(q, goal, seed=attempt, deadline_ms=left, **options)
            if motion.status != "not_found":
                break
        return motion

    def _joints(self, state: Any, where: str) -> dict[str, float]:
        """Return the current joint values, overwritten by the values that a RobotState gives."""
        for k, each in enumerate(state.multi_dof_joint_state.transforms):
            inner = f"{where}.multi_dof_joint_state.transforms[{k}]"
            if not np.allclose(transform(each, inner), np.eye(4), atol=1e-6):
                raise RefusedError(ErrorCode.INVALID_ROBOT_STATE, inner, "must be the identity: the base is fixed")
        found = _positions(state.joint_state, f"{where}.joint_state.")
        for name in found:
            if name not in self.arm.robot.joint_names:
                raise RefusedError(
                    ErrorCode.INVALID_ROBOT_STATE, f"{where}.joint_state.name", f"there is no joint {name!r}"
                )
        return {**self.joints, **found}

    def _velocity(self, state: Any) -> Array | None:
        """Return the velocity (n,) of a start state, or None at rest."""
        names, speeds = list(state.joint_state.name), [float(each) for each in state.joint_state.velocity]
        if not speeds:
            return None
        where = "start_state.joint_state.velocity"
        if len(speeds) != len(names) or not np.isfinite(speeds).all():
            raise RefusedError(
                ErrorCode.START_STATE_INVALID, where, f"{speeds} must be finite, one for each of the {len(names)} names"
            )
        given = dict(zip(names, speeds, strict=True))
        out = np.array([given.get(name, 0.0) for name in self.arm.robot.joint_names])
        out[[name not in self.arm.joints for name in self.arm.robot.joint_names]] = 0.0
        return out if np.abs(out).max() > REST else None

    def _known(self, q: Array, where: str) -> Array:
        unknown = [name for name, value in zip(self.arm.robot.joint_names, q, strict=True) if np.isnan(value)]
        if unknown:
            raise RefusedError(
                ErrorCode.INVALID_ROBOT_STATE,
                where,
                f"the joints {unknown} have no value; publish a JointState, or give them in the start state",
            )
        return q


def _positions(message: Any, where: str, known: Sequence[str] | None = None) -> dict[str, float]:
    """Return the positions of a JointState by name, or only those of the joints ``known``."""
    names, values = [str(name) for name in message.name], [float(each) for each in message.position]
    found = {name: value for name, value in zip(names, values, strict=False) if known is None or name in known}
    if len(names) != len(values) or not np.isfinite(list(found.values())).all():
        raise RefusedError(
            ErrorCode.INVALID_ROBOT_STATE,
            f"{where}position",
            f"{values} must be finite, one for each of the {len(names)} names",
        )
    return found


def _check(request: Any, arm: Arm) -> None:
    """Refuse a request with a field that the solver cannot honour."""
    for name in ("pipeline_id", "planner_id"):
        if getattr(request, name) not in NAMES:
            raise RefusedError(
                ErrorCode.PLANNING_FAILED,
                name,
                f"{getattr(request, name)!r} is not available; leave it empty or use 'gensim2'",
            )
    if request.group_name != arm.group:
        raise RefusedError(
            ErrorCode.INVALID_GROUP_NAME, "group_name", f"{request.group_name!r} is not planned here; use {arm.group!r}"
        )
    if request.trajectory_constraints.constraints:
        raise RefusedError(ErrorCode.PLANNING_FAILED, "trajectory_constraints", "cannot be kept; use path constraints")
    if request.reference_trajectories:
        raise RefusedError(ErrorCode.PLANNING_FAILED, "reference_trajectories", "cannot be followed; leave them out")
    if float(request.max_cartesian_speed) > 0.0:
        raise RefusedError(
            ErrorCode.PLANNING_FAILED, "max_cartesian_speed", "cannot be kept; use max_velocity_scaling_factor"
        )


def _scale(request: Any, name: str) -> float:
    """Return a scaling factor; 0, the default of the message, is 1."""
    value = float(getattr(request, name))
    if not 0.0 <= value <= 1.0:
        raise RefusedError(ErrorCode.PLANNING_FAILED, name, f"{value} must be above 0 and at most 1, or 0 for 1")
    return value or 1.0


def _problem(error: kpam.ProblemError, path: PathConstraints, arm: Arm) -> RefusedError:
    """Return the refusal of a problem that the solver does not accept."""
    field, message = error.field or "", error.message or str(error)
    indices = re.findall(r"\[(\d+)\]", field)
    if field.startswith(("q_start[", "goal[")) and int(indices[-1]) < len(arm.robot.joint_names):
        message = f"{arm.robot.joint_names[int(indices[-1])]}: {message}"
    violates = len(path.hand) > 0 and message.startswith("violates")
    if field.startswith("q_start"):
        code = ErrorCode.START_STATE_VIOLATES_PATH_CONSTRAINTS if violates else ErrorCode.START_STATE_INVALID
        return RefusedError(code, "start_state", message)
    if field.startswith("start_"):
        return RefusedError(ErrorCode.START_STATE_INVALID, "start_state", message)
    if field.startswith("goal"):
        code = ErrorCode.GOAL_VIOLATES_PATH_CONSTRAINTS if violates else ErrorCode.GOAL_STATE_INVALID
        return RefusedError(code, "goal_constraints", message)
    if field == "link":
        return RefusedError(ErrorCode.INVALID_LINK_NAME, "goal_constraints", message)
    return RefusedError(ErrorCode.PLANNING_FAILED, field or "request", message)
