"""Physics engines: what the headless environment asks of a scene in one of them, and which classes are such scenes."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Protocol, cast

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.robots import RobotProfile
from gensim2.scenes.initial_state import InitialState
from gensim2.scenes.physics import Engine
from gensim2.sim.parts import Array, Part, Row
from gensim2.sim.scene_state import RobotReader


class EngineScene(Protocol):
    """A scene in a physics engine: bodies, drives and contacts.

    Attributes:
        parts: the objects, by name, in the task's order.
        robot: None where the scene was built without it.
    """

    @property
    def parts(self) -> Mapping[str, Part]: ...
    @property
    def robot(self) -> RobotReader | None: ...

    def __init__(self, profile: RobotProfile, physics: str, setup: InitialState, robot: bool) -> None:
        """Build the scene of an initial state.

        Args:
            profile: of the robot.
            physics: the word for its switches.
            setup: where everything stands.
            robot: leave the robot out where False.
        """

    @staticmethod
    def prepare(profile: RobotProfile, physics: str) -> None:
        """Read and build what every scene of a process needs and only the first would pay for."""

    def drive(self, action: npt.ArrayLike) -> None:
        """Set the targets of the robot's drives; (m + 1,) as an action has them."""

    def step(self) -> None:
        """Simulate one step of the robot's ``physics_hz``."""

    def touched(self) -> frozenset[str]:
        """Return the names of the objects that any part of the robot presses against."""

    def pressing_force(self) -> float:
        """Return the force (N) of all contacts of the robot with something else in the last step."""

    def robot_state(self) -> Row:
        """(13 + 2 n,) ManiSkill's: root pose, root velocities, qpos, qvel of the robot."""

    def snapshot(self) -> tuple[Array, str]:
        """Return the full state of the physics, and a digest of the scene to which it belongs.

        Raises:
            InputError: the engine cannot go on from a stored state bit for bit.
        """

    def restore(self, state: Array, scene: str) -> None:
        """Go on from a state of the scene with this digest.

        Raises:
            InputError: the engine cannot, or the digest is that of another scene.
        """


_CLASSES: Mapping[Engine, tuple[str, str]] = {
    "sapien": ("gensim2.sim.sapien_scene", "SapienScene"),
    "mujoco": ("gensim2.sim.mujoco.scene", "MujocoScene"),
}


def scene_class(engine: Engine) -> type[EngineScene]:
    """Return the class of an engine's scenes; only its own packages are imported.

    Raises:
        MissingExtraError: the engine is not installed.
    """
    module, name = _CLASSES[engine]
    return cast(type[EngineScene], getattr(importlib.import_module(module), name))


def checked_command(action: npt.ArrayLike, size: int) -> npt.NDArray[np.float32]:
    """(size,) an action.

    Raises:
        InputError: it has another shape or is not finite.
    """
    command = np.asarray(action, dtype=np.float32)
    if command.shape != (size,) or not np.isfinite(command).all():
        raise InputError(f"must be {size} finite numbers", field="action")
    return command
