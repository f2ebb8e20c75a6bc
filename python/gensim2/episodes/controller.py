"""Whoever decides what the robot does: a plan, a chain of steps, a policy, a person."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from gensim2.planning.scene import Scene
from gensim2.tasks.measurement import Measurement

Action = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Observation:
    """What a controller may look at before each control step.

    Attributes:
        step: control steps since the reset.
        q, qvel: (n,) robot joints and their velocities.
        measurement: of the objects and the gripper, this instant.
        scene: reads the whole scene, geometry included; dearer, so a function.
    """

    step: int
    q: npt.NDArray[np.float64]
    qvel: npt.NDArray[np.float64]
    measurement: Measurement
    scene: Callable[[], Scene]


class Controller(Protocol):
    """Decides every action of one episode."""

    def reset(self, scene: Scene) -> None:
        """Begin an episode in ``scene``."""
        ...

    def act(self, observation: Observation) -> Action | None:
        """The next action, (m + 1,); None: done."""
        ...
