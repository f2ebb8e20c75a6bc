"""Check sent commands by finite differences and by the kinematics of the ray caster.

The code of the limits is not used.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.perception.raycast.kinematics import Tree, read_urdf
from gensim2_robot.arm_limits import CYCLE, ArmLimits

SHARE = 1e-6
"""Tolerance for rounding errors, as a fraction of a limit."""
BLOCK = 5000


def limits_passed(commands: Sequence[Array], limits: ArmLimits) -> int:
    """Return how many commands exceed a limit.

    The commands (m,) follow each other at intervals of one cycle and start at rest.
    """
    if not commands:
        return 0
    q = np.array(commands)
    still = np.repeat(q[:1], 3, axis=0)
    velocity = np.diff(np.concatenate([still, q]), axis=0) / CYCLE
    acceleration = np.diff(velocity, axis=0) / CYCLE
    jerk = np.diff(acceleration, axis=0) / CYCLE
    passed = (q < limits.lower - SHARE).any(axis=1) | (q > limits.upper + SHARE).any(axis=1)
    for rates, most in ((velocity[2:], limits.velocity), (acceleration[1:], limits.acceleration), (jerk, limits.jerk)):
        passed |= (np.abs(rates) > (1.0 + SHARE) * most + 1e-9).any(axis=1)
    passed |= _too_near_an_end(q, velocity[2:], limits)
    tool = np.concatenate([_tool(q[first : first + BLOCK], limits) for first in range(0, len(q), BLOCK)])
    pace = np.linalg.norm(np.diff(tool, axis=0, prepend=tool[:1]), axis=1) / CYCLE
    passed |= pace > (1.0 + SHARE) * limits.tool_speed
    passed |= (tool < limits.low - SHARE).any(axis=1) | (tool > limits.high + SHARE).any(axis=1)
    passed |= np.asarray(limits.scene.distance(limits.whole(q), limits.clearance + 1e-3)) < limits.clearance - SHARE
    return int(passed.sum())


def _too_near_an_end(q: Array, velocity: Array, limits: ArmLimits) -> npt.NDArray[np.bool_]:
    """Return a mask (N,) of commands with ``(|v| + offset)^2 > gain * room``, too fast towards a joint's end."""
    if limits.braking is None:
        return np.zeros(len(q), dtype=bool)
    ends = limits.braking
    room = np.where(velocity > 0.0, ends.upper - q, q - ends.lower)
    pace = (1.0 - SHARE) * np.abs(velocity) - 1e-9
    return np.asarray(((pace > 0.0) & ((pace + ends.offset) ** 2 > ends.gain * room)).any(axis=1))


def _tool(q: Array, limits: ArmLimits) -> Array:
    profile = limits.profile
    tree = Tree.of(read_urdf(profile.urdf), (*profile.arm_joints, *profile.gripper.joints))
    poses = tree.poses(np.tile(np.eye(4), (len(q), 1, 1)), limits.whole(q))
    return np.asarray(poses[:, tree.names.index(profile.tool_link), :3, 3])
