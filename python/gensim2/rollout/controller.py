"""Define the interface of controllers, such as planners and policies, which choose the actions of an episode."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from gensim2.perception import Observation, ObservationSpec
from gensim2.planning.scene import Scene
from gensim2.rollout.record import Cause, StepRecord
from gensim2.tasks.measurement import Measurement

Action = npt.NDArray[np.float32]

ACTUATION: Literal["actuation"] = "actuation"
"""Name of the event that the hand has reached an actuation pose."""

PROPRIOCEPTIVE = ObservationSpec(modalities=())
"""Observation spec with only the robot's state, without cameras."""


@dataclass(frozen=True, eq=False)
class PrivilegedObservation(Observation):
    """Observation of a privileged controller, with the true state of the simulated world.

    Attributes:
        measurement: true state of objects and gripper.
        scene: function that computes the current scene with the geometry of all objects. The function is slow, so it is
            called only when needed. It must be called before the next control step, because it reads the simulator.
    """

    measurement: Measurement
    scene: Callable[[], Scene]

    @staticmethod
    def of(observation: Observation, measurement: Measurement, scene: Callable[[], Scene]) -> PrivilegedObservation:
        """Return a privileged observation, which adds the true state to ``observation``."""
        seen = observation
        return PrivilegedObservation(
            seen.step, seen.time, seen.language, seen.arrays, seen.cloud, seen.cameras, measurement, scene
        )

    @property
    def q(self) -> npt.NDArray[np.float64]:
        return self.joint_positions.astype(np.float64)

    @property
    def qvel(self) -> npt.NDArray[np.float64]:
        return self.joint_velocities.astype(np.float64)


@dataclass(frozen=True, eq=False)
class Reference:
    """Desired state at the end of an action's control step, independent of the robot's drives.

    Attributes:
        joint_positions, joint_velocities: (m,) positions (rad or m) and velocities (rad/s or m/s) of the arm joints.
        gripper: (2,) commanded distance of the pads, m, and force of each finger, N. NaN where unknown.
        action: (m + 1,) action before noise was added; None if no noise was added.
    """

    joint_positions: npt.NDArray[np.float32]
    joint_velocities: npt.NDArray[np.float32]
    gripper: npt.NDArray[np.float32]
    action: Action | None = None


@dataclass(frozen=True)
class Event:
    """Event reported by a controller.

    Attributes:
        at_step: number of control steps since the reset.
        step: name of the task step.
        what: ``ACTUATION`` if the hand has reached the actuation pose; otherwise the kind of deviation.
        detail: measured values, as plain data.
    """

    at_step: int
    step: str
    what: Cause | Literal["actuation"]
    detail: dict[str, Any] = field(default_factory=dict)


class Controller(Protocol):
    """Interface of a controller, which chooses every action of an episode (docs/guides/controllers.md).

    A controller class may define these optional attributes:

    - ``privileged = True``: the constructor also gets ``task`` and ``profile``, and each observation is a
      :class:`PrivilegedObservation` with the true state of the simulator.
    - ``observation_spec``: the required observations, as an :class:`~gensim2.perception.ObservationSpec` or its fields.
      By default, an observation has a point cloud; for a privileged controller it has only the robot's state. The spec
      is read before every observation, so a controller can save time with ``PROPRIOCEPTIVE`` when it needs no cloud.
    - ``reference``: a :class:`Reference`, which is read and recorded after every action. It is None if the action has
      no reference.
    - ``close()``: a method that releases resources such as connections. It is called when the controller is no longer
      needed.
    - ``turn``, ``history``, ``events``: name of the current task step, records of all started steps, and reported
      events. ``turn`` is read after every action, ``history`` and ``events`` after the episode. Without these
      attributes a step ends when its criterion holds.
    """

    def reset(self, observation: Any, seed: int) -> None:
        """Start an episode, and discard all data of the previous episode.

        Args:
            observation: first observation, an :class:`~gensim2.perception.Observation`.
            seed: seed of the controller's random numbers, which differs from the seed of the scene.
        """
        ...

    def act(self, observation: Any) -> npt.ArrayLike | None:
        """Return the next action (m + 1,): arm joint targets and gripper command (-1 to 1); None ends the episode."""
        ...


def is_privileged(controller: Controller | type) -> bool:
    """Return whether a controller or its class is privileged."""
    return bool(getattr(controller, "privileged", False))


def spec_of(controller: Controller) -> ObservationSpec:
    """Return the observation spec of a controller.

    Raises:
        InputError: the controller's ``observation_spec`` is invalid.
    """
    given = getattr(controller, "observation_spec", None)
    if given is None and is_privileged(controller):
        return PROPRIOCEPTIVE
    return ObservationSpec.of(given)


def reference_of(controller: Controller) -> Reference | None:
    """Return the reference of a controller's last action; None if the controller reports no reference."""
    reference: Reference | None = getattr(controller, "reference", None)
    return reference


def turn_of(controller: Controller) -> str | None:
    """Return the name of a controller's current step; None if the controller reports no step."""
    turn: str | None = getattr(controller, "turn", None)
    return turn


def history_of(controller: Controller) -> Sequence[StepRecord]:
    """Return a controller's records of its started steps; None if the controller reports no records."""
    history: Sequence[StepRecord] = getattr(controller, "history", ())
    return history


def events_of(controller: Controller) -> Sequence[Event]:
    """Return the events that a controller has reported, oldest first."""
    events: Sequence[Event] = getattr(controller, "events", ())
    return events


class WrappedController:
    """Base class of controllers that wrap another controller, ``_controller``, and pass on its optional attributes."""

    _controller: Controller

    @property
    def observation_spec(self) -> ObservationSpec:
        return spec_of(self._controller)

    @property
    def reference(self) -> Reference | None:
        return reference_of(self._controller)

    @property
    def turn(self) -> str | None:
        return turn_of(self._controller)

    @property
    def history(self) -> Sequence[StepRecord]:
        return history_of(self._controller)

    @property
    def events(self) -> Sequence[Event]:
        return events_of(self._controller)
