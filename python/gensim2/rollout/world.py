"""Protocols of the loop: a body that acts and sees, and of a simulator what only it knows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from gensim2.perception import Observation, ObservationSpec
from gensim2.planning.scene import Scene
from gensim2.robots import RobotProfile
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import TaskSpec

if TYPE_CHECKING:
    from gensim2.scenes.initial_state import InitialState

Tree = dict[str, Any]
"""Arrays by name, nested; leaves are numpy arrays."""


class Body(Protocol):
    """Robot that acts: a simulated one, or a real one.

    Attributes:
        profile: of the robot.
        waits: it stands still while a controller thinks. One that does not must be given an action every control step.
    """

    profile: RobotProfile
    waits: bool

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """Begin an episode."""
        ...

    def step(self, action: npt.ArrayLike) -> None:
        """One control step, (m + 1,)."""
        ...

    def observe(self, spec: ObservationSpec) -> Observation:
        """Observe the present instant."""
        ...

    def close(self) -> None:
        """Release the resources."""
        ...


class World(Body, Protocol):
    """One task's scene: a body, and what only a simulator knows. :class:`gensim2.sim.headless.HeadlessEnv` is one."""

    task: TaskSpec
    seed: int
    elapsed_steps: int
    control_mode: str

    @property
    def initial_state(self) -> InitialState:
        """Initial state that the last reset drew."""
        ...

    @property
    def reset_options(self) -> Mapping[str, Any]:
        """Options with which a reset to the same seed gives the same scene."""
        ...

    def reset(self, seed: int, options: Mapping[str, Any] | None = None, *, robot: bool = True) -> None:
        """A fresh scene; without the arm where ``robot`` is False."""
        ...

    def wait(self) -> None:
        """One control step in which nothing is commanded."""
        ...

    def measure(self) -> Measurement:
        """Everything that criteria and verdicts go by; without the arm as if it stood as at the start."""
        ...

    def scene_state(self) -> Scene:
        """The scene as a planner sees it."""
        ...

    def touched(self) -> frozenset[str]:
        """Names of the objects that any part of the robot touches."""
        ...

    @property
    def is_finite(self) -> bool:
        """Whether physics still gives numbers."""
        ...

    def state(self) -> Tree:
        """ManiSkill's ``env_states`` of this instant."""
        ...

    def observation(self, tool: bool = True) -> npt.NDArray[np.float32]:
        """(D,) the environment's state observation of this instant: qpos, qvel, pose of the tool (7,), objects.

        Args:
            tool: False leaves NaN for the tool's pose, for recordings, which work out those of an episode at once.
        """
        ...
