"""Limit the force with which the arm can press on an unforeseen obstacle."""

from __future__ import annotations

import numpy as np

from gensim2.core.arrays import Array
from gensim2.robots.profile import RobotProfile

FORCE_LIMIT = 140.0
"""Default limit of the contact force, N, from ISO/TS 15066 for a clamped hand."""
PRESSING = 210.0
"""Maximum force (N) with which the drives press on an object. The value is 1.5 times the limit at which the robot line
stops the arm: with less, many real toasters, faucets and doors are not moved in time.
"""
BEHIND = 0.01
"""The arm is behind its plan if the force limit moves the tool's target farther than this (m) from the planned one."""
BLOCKED_SHARE = 0.3
"""An arm counts as blocked below this fraction of the speed that it would have without an obstacle."""
LEAST_COMPLIANCE = 1e-7
"""Lower bound of the tool's compliance, m/N, for arms in a singular configuration."""
HALVINGS = 40


class Yielding:
    """Shortens the targets of the arm's drives, so that the tool presses on an obstacle with a limited force.

    The drives act as springs and dampers between joints and targets. Assume that an obstacle holds the tool at the
    measured joints ``q``. The force ``F`` (3,) on it follows from ``J K^-1 J^T F = J (targets - q)``, with the tool's
    Jacobian ``J`` (3, m) and the stiffness ``K`` of the drives: it moves the tool against the springs from the position
    of the targets to the position of ``q``. No force sensor is needed.

    Springs and dampers press with at most ``limit``. A moving arm may press harder until its next command.

    Args:
        profile: robot profile.
        limit: maximum force, N.

    Example:
        >>> yielding = Yielding(robot("panda"), limit=100.0)
        >>> targets, short = yielding.targets(q, qvel, asked)
    """

    def __init__(self, profile: RobotProfile, limit: float) -> None:
        self.profile, self.limit = profile, limit
        self._columns = list(profile.arm_columns)
        self._softness = np.array([1.0 / drive.stiffness for drive in profile.arm_drives])

    def force(self, q: Array, targets: Array) -> float:
        """Return the force (N) of the tool on an obstacle that holds it at ``q``.

        Args:
            q: (n,) positions of all active joints, rad or m.
            targets: (m,) targets of the arm's drives, rad or m.
        """
        return self._force(self._jacobians(q)[0], targets - q[self._columns])

    def targets(self, q: Array, qvel: Array, asked: Array, *, is_free: bool) -> tuple[Array, float]:
        """Return targets that keep the force limit, and how far they move the target position of the tool.

        Args:
            q, qvel: (n,) positions and velocities of all active joints, rad or m, and per s.
            asked: (m,) requested targets of the arm's drives, rad or m.
            is_free: whether no contact is expected. Targets then stay on the straight, collision-free line.

        Returns:
            Targets (m,), rad or m, and the distance of the tool's target from the requested one, m.
        """
        # At these targets the spring force cancels the damping force.
        coasting = q[self._columns] + self.profile.lags * qvel[self._columns]
        points = self._jacobians(q)
        stretched = asked - coasting
        force = max(self._force(jacobian, stretched) for jacobian in points)
        if force <= self.limit:
            return asked, 0.0
        if not is_free:
            for jacobian in points:
                stretched = stretched - self._excess(jacobian, stretched, self.limit)
            # Limiting the force at the hand can raise the force at the tool.
            force = max(self._force(jacobian, stretched) for jacobian in points)
        found = coasting + min(1.0, self.limit / force) * stretched
        return found, float(np.linalg.norm(points[0] @ (asked - found)))

    def is_blocked(self, q: Array, qvel: Array, targets: Array) -> bool:
        """Return whether an obstacle stops the arm.

        Args:
            q, qvel: (n,) positions and velocities of all active joints, rad or m, and per s.
            targets: (m,) targets of the arm's drives, rad or m.
        """
        ahead = targets - q[self._columns]
        # Without an obstacle, the distance to the targets is the tracking delay times the velocity.
        return bool(self.profile.lags * qvel[self._columns] @ ahead <= BLOCKED_SHARE * (ahead @ ahead))

    def _jacobians(self, q: Array) -> list[Array]:
        """Return the Jacobians (3, m) of the positions of the tool and of the hand."""
        links = (self.profile.tool_link, None)
        return [np.asarray(self.profile.model.jacobian(q, link)[:3, self._columns]) for link in links]

    def _force(self, jacobian: Array, stretched: Array) -> float:
        moved = jacobian @ stretched
        return float(np.linalg.norm(np.linalg.lstsq(self._compliance(jacobian), moved, rcond=None)[0]))

    def _compliance(self, jacobian: Array) -> Array:
        """Return the displacement of the tool for each force on it (3, 3), m/N."""
        return np.asarray((jacobian * self._softness) @ jacobian.T)

    def _excess(self, jacobian: Array, stretched: Array, limit: float) -> Array:
        """Return the change (m,) of the springs that must be taken back so that the force keeps the limit.

        Of all permitted forces, the one with the nearest target of the tool remains. An arm that is almost stretched
        presses hard along its stretch even if the targets are only millimetres ahead. Only these millimetres are taken
        back.
        """
        compliance, directions = np.linalg.eigh(self._compliance(jacobian))
        compliance = np.maximum(compliance, LEAST_COMPLIANCE)
        force = directions.T @ (jacobian @ stretched) / compliance
        if np.linalg.norm(force) <= limit:
            return np.zeros_like(stretched)
        # The rest is force * compliance^2 / (compliance^2 + x), and decreases with x.
        square = compliance**2
        low, high = 0.0, float(square.max() * np.linalg.norm(force) / limit)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            if np.linalg.norm(force * square / (square + middle)) > limit:
                low = middle
            else:
                high = middle
        rest = force * square / (square + high)
        return np.asarray(self._softness * (jacobian.T @ (directions @ (force - rest))))
