"""Describe motions as keypose programs: hand poses, gripper commands at the poses, and times between the poses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm, logm

from gensim2.core.arrays import Array
from gensim2.planning.step_plan import StepPlan
from gensim2.robots import RobotProfile

Float32 = npt.NDArray[np.float32]

PATH_POSES = 8
"""Number of evenly spaced hand poses between the actuation pose and the end of the motion in contact."""
APPROACH, ACTUATION, PATH, RETREAT = 0, 1, slice(2, 2 + PATH_POSES), 2 + PATH_POSES
"""Indices of the approach, actuation, path and retreat poses in a program."""
KEYPOSES = 3 + PATH_POSES
"""Number of poses in a program: approach, actuation pose, path, and retreat."""
TURN_LENGTH = 0.15
"""Path length (m) equivalent to a rotation of the hand by one radian."""
SAME_COMMAND = 0.1
"""Gripper commands that differ by at most this amount count as equal and take no time."""
LONGEST = 3.0
"""Maximum extension of a push, as a multiple of the last quarter of its path."""
_DENSE = 200


@dataclass(frozen=True)
class KeyposeProgram:
    """Motion of one task step as K hand poses, independent of the robot.

    Attributes:
        positions: (K, 3) positions of the hand in the robot's base frame, m.
        rotations: (K, 3, 3) hand rotations, base frame.
        gripper: (K + 1,) commands from -1 to 1: first the command before the arm moves, then the command at each pose.
        seconds: (K,) time from the previous pose to each pose, s. The first entry is unused: the planner times the free
            motion.
        force: force of each finger on the grasped object, N; else 0.
    """

    positions: Float32
    rotations: Float32
    gripper: Float32
    seconds: Float32
    force: float = 0.0

    def __post_init__(self) -> None:
        shapes = {"positions": (KEYPOSES, 3), "rotations": (KEYPOSES, 3, 3), "gripper": (KEYPOSES + 1,)}
        for name, shape in (*shapes.items(), ("seconds", (KEYPOSES,))):
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} must have the shape {shape}, but has {getattr(self, name).shape}")

    @property
    def poses(self) -> Array:
        poses = np.tile(np.eye(4), (KEYPOSES, 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = self.rotations, self.positions
        return poses

    @property
    def is_push(self) -> bool:
        """Return whether the motion is a push: the gripper command stays constant from the actuation pose on."""
        return float(np.abs(self.gripper[ACTUATION:] - self.gripper[ACTUATION]).max()) <= SAME_COMMAND

    def longer(self, further: float) -> KeyposeProgram:
        """Return the program with its last path pose and its retreat pose moved ``further`` (m) along the path.

        The extension continues the translation or rotation of the last quarter of the path.
        """
        poses, last = self.poses, PATH.stop - 1
        gone = float(np.linalg.norm(poses[last, :3, 3] - poses[last - 2, :3, 3]))
        if gone < 1e-3:
            return self
        share = min(further / gone, LONGEST)
        quarter = np.linalg.inv(poses[last - 2]) @ poses[last]
        end = poses[last] @ expm(share * np.real(logm(quarter)))
        back = end @ np.linalg.inv(poses[last]) @ poses[RETREAT]
        positions, rotations, seconds = self.positions.copy(), self.rotations.copy(), self.seconds.copy()
        for number, pose in ((last, end), (RETREAT, back)):
            positions[number], rotations[number] = pose[:3, 3], pose[:3, :3]
        seconds[last] *= 1.0 + 2.0 * share
        return replace(self, positions=positions, rotations=rotations, seconds=seconds)


def program_of(planned: StepPlan, profile: RobotProfile) -> KeyposeProgram:
    """Return the program of a planned step.

    Raises:
        ValueError: the plan has no motion, or does not reach its actuation pose.
    """
    if planned.plan is None or planned.plan.trajectory is None or planned.schedule is None:
        raise ValueError(f"the step has no motion: {planned.reason}")
    trajectory, rows = planned.plan.trajectory, planned.schedule
    reached = {frame["label"]: frame["time"] for frame in planned.plan.keyframes if frame["time"] is not None}
    if "actuation" not in reached:
        raise ValueError("the motion does not reach its actuation pose")
    acting = reached["actuation"]
    first = min((time for label, time in reached.items() if label.startswith("pre_")), default=acting)
    lets_go = reached.get("let_go")
    ends = [time for label, time in reached.items() if label.startswith("post_")]
    end = max(ends, default=acting if lets_go is not None else trajectory.duration)
    times = np.array([first, acting, *_evenly(planned, profile, acting, end), end if lets_go is None else lets_go])
    joints = np.array([trajectory.sample(time)[0] for time in times])
    poses = profile.model.forward_kinematics(joints)
    commands = rows.commands
    half = 0.5 / profile.control_hz
    last = [max(0, int(np.searchsorted(rows.times, time + half)) - 1) for time in times]
    return KeyposeProgram(
        positions=poses[:, :3, 3].astype(np.float32),
        rotations=poses[:, :3, :3].astype(np.float32),
        gripper=np.concatenate([commands[:1], commands[last]]).astype(np.float32),
        seconds=np.diff(times, prepend=0.0).astype(np.float32),
        force=float(planned.force or 0.0),
    )


def _evenly(planned: StepPlan, profile: RobotProfile, begin: float, end: float) -> Array:
    """Return ``PATH_POSES`` times, which divide the hand's motion between ``begin`` and ``end`` into parts of equal
    length. The length includes rotations: an angle counts as the angle times ``TURN_LENGTH``.
    """
    assert planned.plan is not None
    assert planned.plan.trajectory is not None
    times = np.linspace(begin, end, _DENSE)
    joints = np.array([planned.plan.trajectory.sample(time)[0] for time in times])
    poses = profile.model.forward_kinematics(joints)
    gone = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    between = np.einsum("nij,nij->n", poses[:-1, :3, :3], poses[1:, :3, :3])
    gone += TURN_LENGTH * np.arccos(np.clip((between - 1.0) / 2.0, -1.0, 1.0))
    way = np.concatenate([[0.0], np.cumsum(gone)])
    if way[-1] < 1e-4:
        return np.full(PATH_POSES, end)
    return np.interp(np.linspace(0.0, way[-1], PATH_POSES + 1)[1:], way, times)
