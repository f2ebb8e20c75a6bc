"""Orientation constraints along the path of a motion, as axis constraints of the solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import gensim2_kpam as kpam

from .goals import FREE, ROTATION_VECTOR, tolerances
from .poses import Array, rotation
from .refusals import ErrorCode, RefusedError
from .world import World

#: Fraction of an axis's tolerance that the solver accepts at the start and at the goal.
ENDS = 0.85


@dataclass(frozen=True)
class PathConstraints:
    """Directions of the hand that keep close to directions of the planning frame.

    Attributes:
        hand: (K, 3) directions in the hand frame.
        base: (K, 3) directions in the planning frame.
        angles: (K,) largest angle between both, rad.
    """

    hand: Array
    base: Array
    angles: Array

    def keeps(self, arm: kpam.Robot, q: Array) -> bool:
        """Return whether joints ``q`` (n,) may be the start or the goal of a motion."""
        now = self.hand @ arm.forward_kinematics(q)[:3, :3].T
        off = np.arccos(np.clip((now * self.base).sum(axis=1), -1.0, 1.0))
        return bool((off <= ENDS * self.angles).all())

    def options(self) -> dict[str, Any]:
        """Return the keyword arguments of ``Scene.plan_to``."""
        if not len(self.hand):
            return {}
        entries, keypoints = [], {"origin": [0.0, 0.0, 0.0]}
        for k, (direction, target, angle) in enumerate(zip(self.hand, self.base, self.angles, strict=True)):
            keypoints[f"axis_{k}"] = direction.tolist()
            entries.append(
                {
                    "type": "frame_axis_parallel",
                    "axis_from_keypoint_name": "origin",
                    "axis_to_keypoint_name": f"axis_{k}",
                    "target_axis": target.tolist(),
                    "target_axis_frame": "world",
                    "target_inner_product": 1.0,
                    "tolerance": float(angle),
                }
            )
        return {"path": kpam.SolverConfig({"constraint_list": entries}), "tool_keypoints": keypoints}


def path_constraints_of(message: Any, world: World, q: Array) -> PathConstraints:
    """Return the path constraints of a ``moveit_msgs/msg/Constraints``.

    Each orientation constraint becomes one direction if the rotation about one axis is free, and two directions
    otherwise. Their angles are chosen so that the motion keeps MoveIt's tolerances: the solver's constraints are a
    little stricter.

    Args:
        message: the constraints.
        world: objects and frames.
        q: (n,) joints at the start.

    Raises:
        RefusedError: a constraint cannot be kept along a path; names the constraint.
    """
    for kind in ("joint", "position", "visibility"):
        if getattr(message, f"{kind}_constraints"):
            raise _refused(f"path_constraints.{kind}_constraints", "only orientation can be kept along a path")
    hand: list[Array] = []
    base: list[Array] = []
    angles: list[float] = []
    for k, each in enumerate(message.orientation_constraints):
        where = f"path_constraints.orientation_constraints[{k}]"
        link = str(each.link_name)
        if link not in world.arm.chains or not world.arm.moves_with_hand(link):
            raise RefusedError(
                ErrorCode.INVALID_LINK_NAME, f"{where}.link_name", f"{link!r} is no link that moves with the hand"
            )
        frame_id = str(each.header.frame_id)
        if world.moves(frame_id):
            raise _refused(f"{where}.header.frame_id", f"{frame_id!r} moves; use a frame that does not")
        frame = world.frame(frame_id, q, f"{where}.header.frame_id")
        wanted = frame[:3, :3] @ rotation(each.orientation, f"{where}.orientation")
        allowed = tolerances(each, where)
        free = [axis for axis in range(3) if allowed[axis] >= FREE]
        strictest = min((allowed[axis] for axis in range(3) if axis not in free), default=np.pi)
        if len(free) == 3:
            continue
        if len(free) == 2 or (free == [1] and int(each.parameterization) != ROTATION_VECTOR):
            raise _refused(
                where,
                "the constraint frees more than a rotation about x or z; set only one of its tolerances to pi or more",
            )
        if not strictest > 0.0:
            raise _refused(where, "the tolerance is 0 rad, so no motion can satisfy it; use at least 0.001 rad")
        strictest = min(strictest, 0.5 * np.pi)
        if free:
            axes = free
            # The rotation vector of a tilt by t and any rotation about the axis is at most pi sin(t / 2) across it.
            vector = int(each.parameterization) == ROTATION_VECTOR
            angle = 2.0 * np.arcsin(strictest / np.pi) if vector else strictest
        else:
            # If two orthogonal axes are each tilted by at most a, the rotation angle t satisfies
            # sin(t / 2) <= sqrt(2) sin(a / 2).
            axes, angle = [0, 2], 2.0 * np.arcsin(np.sin(0.5 * strictest) / np.sqrt(2.0))
        at = world.arm.in_hand(link, q)[:3, :3]
        for axis in axes:
            hand.append(at[:, axis])
            base.append(wanted[:, axis])
            angles.append(float(angle))
    return PathConstraints(np.array(hand).reshape(-1, 3), np.array(base).reshape(-1, 3), np.array(angles))


def _refused(where: str, message: str) -> RefusedError:
    return RefusedError(ErrorCode.PLANNING_FAILED, where, message)
