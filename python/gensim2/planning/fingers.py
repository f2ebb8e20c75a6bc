"""Choose the gripper commands of a step."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gensim2.planning.actions import Acts, grip_force, grip_on
from gensim2.planning.scene import Scene
from gensim2.planning.strategies import Strategy
from gensim2.robots import CLOSED, OPEN, RobotProfile

Array = npt.NDArray[np.float64]

#: If a gripper command differs by less than this from the initial command, the arm does not wait for the fingers.
SAME_COMMAND = 0.1


class Fingers:
    """Chooses gripper commands for one robot.

    Args:
        profile: profile of the robot.
    """

    def __init__(self, profile: RobotProfile) -> None:
        self._profile = profile
        #: Indices of the finger joints in the robot's active joints.
        self.joints = list(profile.gripper_columns)

    def acts(
        self, scene: Scene, strategy: Strategy, opening: float = OPEN, grip: float = CLOSED, gently: bool = False
    ) -> Acts:
        """Return the gripper commands of a step that begins in ``scene``.

        Args:
            scene: scene at the start of the step.
            strategy: strategy of the step.
            opening: gripper command of the empty hand while it moves to a grasp.
            grip: command to which the hand closes.
            gently: whether the hand closes slowly.
        """
        present = _clipped(self._profile.gripper.command_at(scene.q[self.joints]))
        fingers = strategy.fingers
        if scene.held is not None or fingers in ("hold", "release"):
            # Fingers that hold an object continue to press on the object. Empty fingers keep their position.
            command = present if scene.held is None else self._grip(scene)
            return Acts(fingers, command, lets_go=strategy.let_go is not None)
        command = CLOSED if fingers == "closed" else opening
        # Move the fingers before the arm starts, with two exceptions: the fingers already have almost the commanded
        # position, or they only close to the opening for the approach to a grasp.
        before = abs(command - present) > SAME_COMMAND and (fingers != "grasp" or command > present)
        return Acts(fingers, command, opening, grip, gently, before, strategy.let_go is not None)

    def _grip(self, scene: Scene) -> float:
        """Return the gripper command with which the fingers continue to press on the grasped object."""
        if scene.held_width is None:
            return CLOSED
        assert scene.held is not None
        force = grip_force(scene.objects[scene.held].mass or 0.0) if scene.held_force is None else scene.held_force
        return grip_on(scene.held_width, force, self._profile, scene.finger_stiffness)

    def command(self, opening: float) -> float:
        """Return the gripper command at which the pads are ``opening`` metres apart."""
        return _clipped(self._profile.gripper.command(opening))

    def positions(self, command: float) -> Array:
        """Return the positions (g,) of the gripper's joints at a gripper command."""
        return self._profile.gripper.at_command(command)

    def around(self, q: Array, width: float, scene: Scene) -> Array:
        """Return the robot's joints (n,) after the hand has closed on an object ``width`` (m) wide.

        Stiff drives almost reach their command, so ``q`` is unchanged; soft ones stop at the object's surface.
        """
        if scene.finger_stiffness is None or scene.finger_stiffness >= self._profile.finger_drive.stiffness:
            return q
        stopped = q.copy()
        stopped[self.joints] = self._profile.gripper.at_opening(width)
        return stopped


def _clipped(command: float) -> float:
    return float(np.clip(command, CLOSED, OPEN))
