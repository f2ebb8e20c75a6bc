"""Define the interfaces of robots and of simulated worlds."""

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
    """A simulated or a real robot.

    Attributes:
        profile: profile of the robot.
        waits: whether the robot waits for the controller; if False, it needs an action in every control step.
    """

    profile: RobotProfile
    waits: bool

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """Start an episode."""
        ...

    def step(self, action: npt.ArrayLike) -> None:
        """Execute one control step with an action (m + 1,)."""
        ...

    def observe(self, spec: ObservationSpec) -> Observation:
        """Return an observation of the current instant."""
        ...

    def close(self) -> None:
        """Release the resources."""
        ...


class World(Body, Protocol):
    """Interface of a simulated scene of a task, for example :class:`gensim2.sim.headless.HeadlessEnv`."""

    task: TaskSpec
    seed: int
    elapsed_steps: int
    control_mode: str

    @property
    def initial_state(self) -> InitialState:
        """Initial state after the last reset."""
        ...

    @property
    def reset_options(self) -> Mapping[str, Any]:
        """Options with which :meth:`reset` reproduces the current scene, together with the seed of the last reset."""
        ...

    def reset(self, seed: int, options: Mapping[str, Any] | None = None, *, robot: bool = True) -> None:
        """Create a new scene; if ``robot`` is False, the scene has no arm."""
        ...

    def wait(self) -> None:
        """Execute one control step without a command."""
        ...

    def measure(self) -> Measurement:
        """Return the measurements for the criteria. Without an arm, an arm in its start position is assumed."""
        ...

    def scene_state(self) -> Scene:
        """Return the scene in the planner's form."""
        ...

    def touched(self) -> frozenset[str]:
        """Return the names of the objects that the robot touches."""
        ...

    @property
    def is_finite(self) -> bool:
        """Return whether all values of the simulation are finite."""
        ...

    def state(self) -> Tree:
        """Return ManiSkill's ``env_states`` of this instant."""
        ...

    def observation(self, tool: bool = True) -> npt.NDArray[np.float32]:
        """Return the state observation (D,).

        The observation has joint positions, joint velocities, the tool pose (7,), and the objects' values.

        Args:
            tool: whether to compute the tool pose; else it is NaN. Recordings compute the poses of all steps together.
        """
        ...
