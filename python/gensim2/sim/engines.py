"""Define the interface of scenes in a physics engine, and select the class that implements it."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Protocol, cast

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.robots import RobotProfile
from gensim2.scenes.initial_state import InitialState
from gensim2.scenes.physics import Engine
from gensim2.sim.parts import Part, Row
from gensim2.sim.scene_state import RobotReader


class EngineScene(Protocol):
    """A scene in a physics engine: bodies, drives and contacts.

    Attributes:
        parts: objects by name, in the task's order.
        robot: the robot; None in a scene without a robot.
    """

    @property
    def parts(self) -> Mapping[str, Part]: ...
    @property
    def robot(self) -> RobotReader | None: ...

    def __init__(self, profile: RobotProfile, physics: str, setup: InitialState, robot: bool) -> None:
        """Build the scene of an initial state.

        Args:
            physics: name of the physics settings.
            robot: False leaves the robot out.
        """

    @staticmethod
    def prepare(profile: RobotProfile, physics: str) -> None:
        """Load modules and data that all scenes of a process need."""

    def drive(self, action: npt.ArrayLike) -> None:
        """Set the targets of the robot's drives from an action (m + 1,)."""

    def step(self) -> None:
        """Simulate one step at the robot's ``physics_hz``."""

    def touched(self) -> frozenset[str]:
        """Return the names of the objects in contact with the robot."""

    def pressing_force(self) -> float:
        """Return the total contact force (N) on the robot in the last step."""

    def robot_state(self) -> Row:
        """Return the robot's state (13 + 2 n,) in ManiSkill's format.

        The state has the root's pose and velocities, then the joints' positions and velocities.
        """

    def snapshot(self) -> tuple[Array, str]:
        """Return the full physics state, and a hash that identifies the scene to which the state belongs.

        Raises:
            InputError: the engine cannot store a state from which the simulation continues exactly.
        """

    def restore(self, state: Array, scene: str) -> None:
        """Set the physics state. ``scene`` is the hash of the scene in which the state was saved.

        Raises:
            InputError: the engine cannot restore states, or the hash belongs to another scene.
        """


_CLASSES: Mapping[Engine, tuple[str, str]] = {
    "sapien": ("gensim2.sim.sapien_scene", "SapienScene"),
    "mujoco": ("gensim2.sim.mujoco.scene", "MujocoScene"),
}


def scene_class(engine: Engine) -> type[EngineScene]:
    """Return the scene class of an engine; only the packages of this engine are imported.

    Raises:
        MissingExtraError: the engine is not installed.
    """
    module, name = _CLASSES[engine]
    return cast(type[EngineScene], getattr(importlib.import_module(module), name))


def checked_command(action: npt.ArrayLike, size: int) -> npt.NDArray[np.float32]:
    """Return a checked action (size,).

    Raises:
        InputError: the action has the wrong shape or is not finite.
    """
    command = np.asarray(action, dtype=np.float32)
    if command.shape != (size,) or not np.isfinite(command).all():
        raise InputError(f"must be {size} finite numbers", field="action")
    return command
