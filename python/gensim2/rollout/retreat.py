"""Plan a motion to the rest pose after the last step, if the hand is still near its objects."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.planning.scene import Scene
from gensim2.planning.world import PlanningWorld
from gensim2.robots import RobotProfile
from gensim2.rollout.motion import gripper_distance
from gensim2.tasks.measurement import Measurement

Rows = npt.NDArray[np.float32]

NEAR = 0.06
"""Distance (m) between keypoints of gripper and object below which the hand is near; larger than in ``strict``."""
CLEAR = 0.003
"""Distance (m) between hand and object below which the planner assumes that they are in contact."""
SPEED = 0.5
"""Fraction of the joints' velocity and acceleration limits that the motion uses."""
OUT, OUT_SECONDS = 0.08, 1.0
"""Length (m) and duration (s) of the straight motion out of contact."""
MAX_STRIDE = 0.2
"""Maximum joint change (rad or m) per control step on the straight motion; a larger change is a jump of the IK."""
SLACK = 1e-3
"""Maximum decrease (m) of the distance between hand and bodies in a step of the straight motion."""


def is_near(measured: Measurement, names: Collection[str]) -> bool:
    """Return whether a keypoint of the gripper is within ``NEAR`` of a keypoint of the named objects."""
    return any(gripper_distance(measured, name) < NEAR for name in names)


class Retreat:
    """Motion of the arm to its rest pose.

    Args:
        positions, velocities: (N, m) planned arm joints at the end of each control step, rad and rad/s.
        targets: (N, m) targets with which the simulated drives follow the plan, rad.
    """

    def __init__(self, positions: Rows, velocities: Rows, targets: Rows) -> None:
        self.positions, self.velocities, self.targets = positions, velocities, targets
        self.ran = 0

    @property
    def is_over(self) -> bool:
        return self.ran >= len(self.targets)


def planned_retreat(
    world: PlanningWorld, scene: Scene, names: Collection[str], near: bool, profile: RobotProfile
) -> Retreat | None:
    """Plan a collision-free motion to the rest pose; a hand in contact first moves away on a straight line.

    If there is no collision-free motion, only the straight motion is returned.

    Args:
        world: planning world of the episode.
        names: objects that the hand has acted on.
        near: whether a keypoint of the hand is near these objects. If none is, contact of other parts of the hand is
            checked.

    Returns:
        The motion; None if the hand is not near the objects, or no motion is found.
    """
    solver, q = world.of(scene), world.joints(scene)
    if not near and not _touches(solver, q, names):
        return None
    rows: list[Array] = []
    if solver.in_collision(q):  # the hand first leaves the collision, because the planner cannot start in a collision
        rows = _straight_out(solver, q, profile)
        if not rows:
            return None
    last = rows[-1] if rows else q
    goal = last.copy()
    columns = list(profile.arm_columns)
    goal[columns] = np.array(profile.reset_qpos)[columns]
    home = solver.plan_to(last, goal, velocity_scale=SPEED, acceleration_scale=SPEED).trajectory
    if home is not None:
        rows += list(home.sample_every(1.0 / profile.control_hz)[1:])
    # There is no motion to the rest pose, for example at an open door. Only move away from the objects.
    elif not rows:
        rows = _straight_out(solver, q, profile)
    if not rows:
        return None
    positions = np.array(rows)[:, columns]
    velocities = np.gradient(np.vstack([q[columns], positions]), axis=0)[1:] * profile.control_hz
    meant = positions.astype(np.float32)
    targets = profile.simulated_targets(meant, np.full(len(meant), len(meant) - 1))
    return Retreat(meant, velocities.astype(np.float32), targets)


def _straight_out(solver: kpam.Scene, q: Array, profile: RobotProfile) -> list[Array]:
    """Plan a straight motion along which the hand does not come closer to any body.

    The function tries three directions: opposite to the direction of the fingers, up, and both combined.

    Returns:
        Joint positions (n,) at each control step of the motion; empty if all directions are blocked.
    """
    T_base_hand = profile.model.forward_kinematics(q)
    up = np.linalg.inv(profile.T_world_base)[:3, :3] @ np.array([0.0, 0.0, 1.0])
    back = -T_base_hand[:3, 2]
    for direction in (back, up, back + up):
        way = OUT * direction / max(float(np.linalg.norm(direction)), 1e-9)
        rows = _followed(solver, q, T_base_hand, way, profile.steps(OUT_SECONDS))
        if rows:
            return rows
    return []


def _followed(solver: kpam.Scene, q: Array, T_base_hand: Array, way: Array, count: int) -> list[Array]:
    rows: list[Array] = []
    before, distance = q, float(solver.distance(q, CLEAR))
    for share in np.linspace(0.0, 1.0, count + 1)[1:]:
        pose = T_base_hand.copy()
        # The polynomial 3 s^2 - 2 s^3 gives the motion zero velocity at its start and end.
        pose[:3, 3] += share**2 * (3.0 - 2.0 * share) * way
        found = solver.ik(pose, before, max_solutions=1)
        if not len(found) or np.abs(found[0] - before).max() > MAX_STRIDE:
            return []
        nearest = float(solver.distance(found[0], CLEAR))
        if nearest < distance - SLACK:
            return []
        rows.append(found[0])
        before, distance = found[0], nearest
    return rows if distance >= CLEAR else []


def _touches(solver: kpam.Scene, q: Array, names: Collection[str]) -> bool:
    """Return whether a link is within ``CLEAR`` of one of the objects."""
    bodies = {body.split("/")[0] for pair in solver.check(q, CLEAR) for body in pair["bodies"]}
    return not bodies.isdisjoint(names)
