"""Whoever decides what the robot does: a plan, a chain of steps, a policy, a person."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from gensim2.planning.scene import Scene
from gensim2.rollout.record import Cause, StepRecord
from gensim2.tasks.measurement import Measurement

Action = npt.NDArray[np.float32]

ACTUATION: Literal["actuation"] = "actuation"
"""What an event is called by which the hand is at an actuation pose."""


@dataclass(frozen=True)
class Observation:
    """What a controller may look at before each control step.

    Attributes:
        step: control steps since the reset.
        q, qvel: (n,) robot joints and their velocities.
        measurement: of the objects and the gripper, this instant.
        scene: reads the whole scene, geometry included; dearer, so a function, and only good for this instant.
    """

    step: int
    q: npt.NDArray[np.float64]
    qvel: npt.NDArray[np.float64]
    measurement: Measurement
    scene: Callable[[], Scene]


@dataclass(frozen=True)
class Event:
    """What a controller noticed.

    Attributes:
        at_step: control steps since the reset.
        step: name of the task's step.
        what: ``ACTUATION``: the hand is where the motions before the contact end; else the deviation.
        detail: numbers beside it, as plain data.
    """

    at_step: int
    step: str
    what: Cause | Literal["actuation"]
    detail: dict[str, Any] = field(default_factory=dict)


class Controller(Protocol):
    """Decides every action of one episode.

    ``turn`` is read after every action, ``history`` and ``events`` when the episode is over. A controller that knows
    nothing of steps leaves them empty; then a step's turn ends where its criterion is true.
    """

    def reset(self, scene: Scene) -> None:
        """Begin an episode in ``scene``; forget the one before."""
        ...

    def act(self, observation: Observation) -> Action | None:
        """The next action, (m + 1,); None: done."""
        ...

    @property
    def turn(self) -> str | None:
        """Name of the task's step whose turn it is; None: nobody knows."""
        ...

    @property
    def history(self) -> Sequence[StepRecord]:
        """One a step that was begun, however often; the loop says ``paper`` and ``done``."""
        ...

    @property
    def events(self) -> Sequence[Event]:
        """In order."""
        ...
