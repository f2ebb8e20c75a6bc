"""Goal constraints of ``moveit_msgs/msg/Constraints`` as goals of the solver."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import gensim2_kpam as kpam

from .poses import Array, about, inverse, rigid, rotation, vector
from .refusals import ErrorCode, RefusedError
from .world import World

#: Number of angles that are tried for a full turn, by the number of free rotations.
ANGLES = {0: 2, 1: 24, 2: 12, 3: 6}
#: Number of solutions of inverse kinematics for each tried pose, and in all.
EACH, ENOUGH = 4, 32
XYZ_EULER_ANGLES, ROTATION_VECTOR = 0, 1
#: Smallest tolerance (rad) that leaves a rotation free. It is a little below pi, because many programs send 3.14.
FREE = np.pi - 2e-3


@dataclass(frozen=True)
class PoseGoal:
    """Poses of a link that meet a goal: one pose, or samples if rotations are free.

    Attributes:
        poses: (4, 4) in the planning frame; the exact pose comes first.
        link: link that must reach one of the poses.
    """

    poses: tuple[Array, ...]
    link: str


Goal = Array | PoseGoal


def goal_of(message: Any, where: str, world: World, q: Array) -> Goal:
    """Return the goal of a ``moveit_msgs/msg/Constraints``: joints (n,), or poses of a link.

    Args:
        message: the constraints.
        where: path of the message in the request.
        world: objects and frames.
        q: (n,) joints at the start.

    Raises:
        RefusedError: the constraints cannot be a goal; names the constraint.
    """
    if message.visibility_constraints:
        raise _unknown(f"{where}.visibility_constraints", "the solver cannot see; use position and orientation")
    if message.joint_constraints:
        if message.position_constraints or message.orientation_constraints:
            raise _unknown(where, "mixes joint constraints with a pose; use one of them, or two goals")
        return _joints(message.joint_constraints, f"{where}.joint_constraints", world, q)
    if len(message.position_constraints) != 1 or len(message.orientation_constraints) > 1:
        raise _unknown(where, "needs joint constraints, or one position constraint and at most one orientation")
    return _pose(message, where, world, q)


def joint_goals(goals: Sequence[Goal], scene: kpam.Scene, q: Array, keeps: Callable[[Array], bool], late: Any) -> Array:
    """Return joint vectors (K, n) without collision that meet one of several goals.

    Args:
        goals: the goals.
        scene: robot and obstacles.
        q: (n,) joints at the start.
        keeps: whether joints (n,) meet the path constraints.
        late: function that returns whether the time is over.

    Raises:
        RefusedError: the start is in collision, no joints meet a goal, or all such joints are in collision or violate
            the path constraints.
    """
    overlaps = scene.check(q)
    if overlaps:
        raise RefusedError(
            ErrorCode.START_STATE_IN_COLLISION, "start_state", f"{' and '.join(overlaps[0]['bodies'])} overlap"
        )
    found = [goal for goal in goals if isinstance(goal, np.ndarray)]
    reached, violated = False, False
    for goal in goals:
        if isinstance(goal, np.ndarray):
            continue
        for pose in goal.poses:
            if late() or len(found) >= ENOUGH:
                break
            rows = scene.ik(pose, q, link=goal.link, max_solutions=EACH, margin=0.0)
            kept = [row for row in rows if keeps(row)]
            violated = violated or len(kept) < len(rows)
            if not len(rows) and not reached:
                reached = len(scene.ik(pose, q, link=goal.link, max_solutions=1)) > 0
            found.extend(kept)
    if found:
        return np.array(found)
    if late():
        raise RefusedError(ErrorCode.TIMED_OUT, "goal_constraints", "the time is over; allow more planning time")
    if violated:
        raise RefusedError(
            ErrorCode.GOAL_VIOLATES_PATH_CONSTRAINTS, "goal_constraints", "every goal violates the path constraints"
        )
    if reached:
        raise RefusedError(ErrorCode.GOAL_IN_COLLISION, "goal_constraints", "every goal is in collision")
    raise RefusedError(ErrorCode.NO_IK_SOLUTION, "goal_constraints", "no joints bring the link to a goal")


def _joints(messages: Any, where: str, world: World, q: Array) -> Array:
    names, goal = world.arm.robot.joint_names, q.copy()
    for k, message in enumerate(messages):
        name, value = str(message.joint_name), float(message.position)
        above, below = float(message.tolerance_above), float(message.tolerance_below)
        if name not in names:
            raise _invalid(f"{where}[{k}].joint_name", f"there is no joint {name!r}; the robot has {names}")
        if not (np.isfinite(value) and above >= 0.0 and below >= 0.0):
            raise _invalid(f"{where}[{k}]", f"position {value} must be finite, and tolerances must be at least 0")
        here = float(q[names.index(name)])
        if name in world.arm.joints:
            goal[names.index(name)] = value
        elif not value - below <= here <= value + above:
            raise _invalid(
                f"{where}[{k}].position",
                f"{value} cannot be reached: the group {world.arm.group!r} does not move {name!r}, which is at {here}",
            )
    return np.asarray(world.arm.robot.apply_mimic(goal))


def _pose(message: Any, where: str, world: World, q: Array) -> PoseGoal:
    place = message.position_constraints[0]
    inner = f"{where}.position_constraints[0]"
    link = str(place.link_name)
    T_link_frame, link = _carrier(link, f"{inner}.link_name", world, q)
    region = place.constraint_region
    if not region.primitives or len(region.primitive_poses) != len(region.primitives):
        raise _unknown(f"{inner}.constraint_region", "needs primitives, each with its pose")
    frame = world.frame(place.header.frame_id, q, f"{inner}.header.frame_id")
    centre = vector(region.primitive_poses[0].position, f"{inner}.constraint_region.primitive_poses[0]")
    target = frame[:3, :3] @ centre + frame[:3, 3]
    offset = vector(place.target_point_offset, f"{inner}.target_point_offset")
    turns = _turns(message, where, world, q, str(place.link_name))
    poses = [rigid(turn, target - turn @ offset) @ inverse(T_link_frame) for turn in turns]
    exact, rest = poses[0], poses[1:]
    now = world.arm.robot.forward_kinematics(q, link)[:3, :3]
    rest.sort(key=lambda pose: -float(np.trace(pose[:3, :3].T @ now)))
    return PoseGoal((exact, *rest), link)


def _turns(message: Any, where: str, world: World, q: Array, link: str) -> list[Array]:
    """Return the rotations (3, 3) of the link that are tried; the rotation without an error comes first."""
    if not message.orientation_constraints:
        now = world.frame(link, q, where)[:3, :3]
        return [now @ turn for turn in _errors([True] * 3)]
    turning = message.orientation_constraints[0]
    inner = f"{where}.orientation_constraints[0]"
    if str(turning.link_name) != link:
        raise _unknown(f"{inner}.link_name", f"{turning.link_name!r} is another link than {link!r} of the position")
    free = [tolerance >= FREE for tolerance in tolerances(turning, inner)]
    if int(turning.parameterization) == ROTATION_VECTOR and sum(free) == 2:
        raise _unknown(inner, "leaves two components of the rotation vector free; use XYZ_EULER_ANGLES")
    frame = world.frame(turning.header.frame_id, q, f"{inner}.header.frame_id")
    wanted = frame[:3, :3] @ rotation(turning.orientation, f"{inner}.orientation")
    return [wanted @ turn for turn in _errors(free)]


def tolerances(message: Any, where: str) -> list[float]:
    """Return the three tolerances of an OrientationConstraint, rad."""
    values = [float(getattr(message, f"absolute_{axis}_axis_tolerance")) for axis in "xyz"]
    if not all(value >= 0.0 for value in values):
        raise _invalid(where, f"the tolerances {values} must be at least 0 rad")
    if int(message.parameterization) not in (XYZ_EULER_ANGLES, ROTATION_VECTOR):
        raise _invalid(f"{where}.parameterization", f"{message.parameterization} is unknown; use 0 or 1")
    return values


def _errors(free: Sequence[bool]) -> list[Array]:
    """Return rotations whose intrinsic XYZ Euler angles are zero where they are not free; the identity first."""
    count = ANGLES[sum(free)]
    whole = np.arange(count) * 2.0 * np.pi / count
    # The second angle lies between -90 and 90 degrees.
    half = np.arange(count // 2) * 2.0 * np.pi / count
    half = np.where(half >= 0.5 * np.pi, half - np.pi, half)
    angles = [grid if isfree else [0.0] for grid, isfree in zip((whole, half, whole), free, strict=True)]
    return [about(0, a) @ about(1, b) @ about(2, c) for a, b, c in itertools.product(*angles)]


def _carrier(name: str, where: str, world: World, q: Array) -> tuple[Array, str]:
    """Return the link that carries a frame, and the frame's pose (4, 4) in this link."""
    if name in world.arm.chains:
        return np.eye(4), name
    item = world.owner(name)
    if item is None or item.link is None:
        raise RefusedError(ErrorCode.INVALID_LINK_NAME, where, f"{name!r} is neither a link nor an attached object")
    at = world.arm.robot.forward_kinematics(q, item.link)
    return inverse(at) @ world.frame(name, q, where), item.link


def _invalid(where: str, message: str) -> RefusedError:
    return RefusedError(ErrorCode.INVALID_GOAL_CONSTRAINTS, where, message)


def _unknown(where: str, message: str) -> RefusedError:
    return RefusedError(ErrorCode.UNRECOGNIZED_GOAL_TYPE, where, message)
