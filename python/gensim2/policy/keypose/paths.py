"""Compute joint waypoints of a keypose program by inverse kinematics of the program's hand poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation, Slerp

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.policy.keypose.program import ACTUATION, APPROACH, KEYPOSES, KeyposeProgram

STEP, TURN = 0.015, 0.08
"""Distance (m) and angle (rad) between the hand poses along a path."""
JUMP = 0.35
"""Joint difference (rad or m) between consecutive poses above which the arm would have to change its posture."""
GRAZE = 0.01
"""Tolerated penetration (m) into the cloud, because points are modelled as balls."""
BRANCHES = 8
"""Number of arm postures tried at the actuation pose, for each of the two finger orders."""


@dataclass(frozen=True)
class JointPath:
    """A program as joint waypoints.

    Attributes:
        joints: (W, n) waypoints, starting at the approach pose.
        at: (KEYPOSES,) waypoint index of each pose of the program; -1 for poses that are not reached.
        touches: number of waypoints at which the arm collides with the table or with itself.
        depth: maximum penetration of the arm into the cloud, m.
    """

    joints: Array
    at: npt.NDArray[np.int64]
    touches: int
    depth: float = np.inf

    @property
    def reached(self) -> int:
        """Return the number of the program's poses that are reached."""
        return int((self.at >= 0).sum())

    @property
    def is_whole(self) -> bool:
        """Return whether all poses are reached without a collision with the table or the robot itself."""
        return self.reached == KEYPOSES and self.touches == 0

    @property
    def rank(self) -> tuple[int, int, float]:
        """Sort key of the path; a better path has a larger key. Penetration depths are rounded to 1 cm, so that similar
        postures compare as equal.
        """
        return self.reached, -self.touches, -round(self.depth, 2)


def joint_path(
    program: KeyposeProgram, q: Array, scene: kpam.Scene, depth: Callable[[Array], float]
) -> JointPath | None:
    """Return a joint path that executes the program, preferably without a collision between arm and point cloud.

    The arm can reach the actuation pose in several postures, and each posture leads to a different path. The function
    returns the first path that executes the complete program without a collision. If there is no such path, it returns
    the path that reaches the most poses of the program. If several paths reach the same number of poses, it prefers the
    path with the fewest positions at which the robot collides with the table or with itself, and then the path with the
    smallest penetration into the cloud. The function returns None if the arm cannot reach the actuation pose.

    Args:
        program: hand poses in the base frame.
        q: (n,) current joint positions; postures close to this position are tried first.
        scene: the robot and the known obstacles.
        depth: function that returns the arm's maximum penetration (m) into the cloud on a path of joint positions (W,
            n).
    """
    best: JointPath | None = None
    for path in _paths(program, q, scene):
        if best is not None and path.rank[:2] < best.rank[:2]:
            continue
        path = replace(path, depth=depth(path.joints))
        if path.is_whole and path.depth <= GRAZE:
            return path
        if best is None or path.rank > best.rank:
            best = path
    return best


def _paths(program: KeyposeProgram, q: Array, scene: kpam.Scene) -> Iterator[JointPath]:
    """Yield a joint path for each arm posture at the actuation pose. The caller computes the path's ``depth``."""
    poses = program.poses
    turned = poses.copy()
    turned[:, :3, :2] *= -1.0  # Half a turn about the approach axis swaps the two fingers.
    starts = [
        (float(np.abs(found - q).max()), number, each, found)
        for number, each in enumerate((poses, turned))
        for found in scene.ik(each[ACTUATION], q, max_solutions=BRANCHES)
    ]
    for _, _, each, found in sorted(starts, key=lambda start: start[:2]):
        yield _followed(each, found, scene)


def _followed(poses: Array, acting: Array, scene: kpam.Scene) -> JointPath:
    """Return the joint path through the poses of a program, for one arm posture ``acting`` at the actuation pose.

    Starting from the actuation pose, the path is computed backwards to the approach pose and forwards to the last pose.
    It stops at the first pose that the arm cannot reach.
    """
    at = np.full(KEYPOSES, -1)
    back = _follow(poses[ACTUATION], poses[APPROACH], acting, scene)
    way = [] if back is None else back[::-1]
    if back is not None:
        at[APPROACH] = 0
    way.append(acting)
    at[ACTUATION] = len(way) - 1
    for number in range(ACTUATION + 1, KEYPOSES):
        onward = _follow(poses[number - 1], poses[number], way[-1], scene)
        if onward is None:
            break
        way += onward
        at[number] = len(way) - 1
    joints = np.array(way)
    return JointPath(joints, at, int(np.count_nonzero(scene.in_collision(joints))))


def _follow(begin: Array, end: Array, q: Array, scene: kpam.Scene) -> list[Array] | None:
    """Return joint positions that move the hand along the line from the pose ``begin`` to the pose ``end``.

    The list does not contain the position at ``begin``. The result is None if the arm cannot follow the line.
    """
    found: list[Array] = []
    for pose in between(begin, end):
        near = scene.ik(pose, q, max_solutions=1)
        if len(near) == 0 or np.abs(near[0] - q).max() > JUMP:
            return None
        q = near[0]
        found.append(q)
    return found


def between(begin: Array, end: Array) -> Array:
    """Return N poses (N, 4, 4) along the line between two poses, without the first pose; N is 0 for equal poses."""
    turns = Rotation.from_matrix(np.stack([begin[:3, :3], end[:3, :3]]))
    angle = (turns[0].inv() * turns[1]).magnitude()
    count = int(np.ceil(max(np.linalg.norm(end[:3, 3] - begin[:3, 3]) / STEP, angle / TURN) - 1e-6))
    if count == 0:
        return np.zeros((0, 4, 4))
    shares = np.arange(1, count + 1) / count
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Slerp([0.0, 1.0], turns)(shares).as_matrix()
    poses[:, :3, 3] = begin[:3, 3] + shares[:, None] * (end[:3, 3] - begin[:3, 3])
    return poses
