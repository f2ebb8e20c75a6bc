"""Finger motions along a step, and the gripper commands for them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gensim2.planning.actions import Acts, grip_force, grip_on
from gensim2.planning.scene import Scene
from gensim2.planning.strategies import Strategy
from gensim2.robots import CLOSED, OPEN, RobotProfile

Array = npt.NDArray[np.float64]

#: A gripper command nearer than this to the one that a step begins with needs no time of its own.
SAME_COMMAND = 0.1


class Fingers:
    """The fingers of a robot.

    Args:
        profile: the robot.
    """

    def __init__(self, profile: RobotProfile) -> None:
        self._profile = profile
        #: Where finger joints stand among the robot's active joints.
        self.joints = list(profile.gripper_columns)

    def acts(
        self, scene: Scene, strategy: Strategy, opening: float = OPEN, grip: float = CLOSED, gently: bool = False
    ) -> Acts:
        """Return the finger motions along a step that begins in ``scene``.

        Args:
            opening: command at which an empty hand arrives where it closes.
            grip: command to which it closes.
            gently: whether it closes slowly.
        """
        present = _clipped(self._profile.gripper.command_at(scene.q[self.joints]))
        fingers = strategy.fingers
        if scene.held is not None or fingers in ("hold", "release"):
            # What is held is pressed; bare fingers stay where they are.
            command = present if scene.held is None else self._grip(scene)
            return Acts(fingers, command, lets_go=strategy.let_go is not None)
        command = CLOSED if fingers == "closed" else opening
        # Fingers that only come nearer to what they will grasp do so on the way.
        before = abs(command - present) > SAME_COMMAND and (fingers != "grasp" or command > present)
        return Acts(fingers, command, opening, grip, gently, before, strategy.let_go is not None)

    def _grip(self, scene: Scene) -> float:
        """The command that goes on holding what the hand has."""
        if scene.held_width is None:
            return CLOSED
        assert scene.held is not None
        force = grip_force(scene.objects[scene.held].mass or 0.0) if scene.held_force is None else scene.held_force
        return grip_on(scene.held_width, force, self._profile, scene.finger_stiffness)

    def command(self, opening: float) -> float:
        """The gripper command that takes the pads so far (m) apart."""
        return _clipped(self._profile.gripper.command(opening))

    def positions(self, command: float) -> Array:
        """(g,) joints of the gripper at a command."""
        return self._profile.gripper.at_command(command)

    def around(self, q: Array, width: float, scene: Scene) -> Array:
        """(n,) joints ``q`` of a hand that has taken what keeps its pads ``width`` (m) apart.

        Stiff drives stand about where they were sent, soft ones where what they press on stops them.
        """
        if scene.finger_stiffness is None or scene.finger_stiffness >= self._profile.finger_drive.stiffness:
            return q
        stopped = q.copy()
        stopped[self.joints] = self._profile.gripper.at_opening(width)
        return stopped


def _clipped(command: float) -> float:
    return float(np.clip(command, CLOSED, OPEN))
