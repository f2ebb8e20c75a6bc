"""Controllers: a plan, a chain of steps, a policy, a person; all of them decide actions in the same loop."""

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
"""Name of the event that the hand is at an actuation pose."""

PROPRIOCEPTIVE = ObservationSpec(modalities=())
"""The robot's own state and no camera."""


@dataclass(frozen=True, eq=False)
class PrivilegedObservation(Observation):
    """Observation of a privileged controller, beyond that of a robot: the truth of a simulated world.

    Attributes:
        measurement: of the objects and the gripper, this instant.
        scene: reads the whole scene, geometry included; dearer, so a function, and only good for this instant.
    """

    measurement: Measurement
    scene: Callable[[], Scene]

    @staticmethod
    def of(observation: Observation, measurement: Measurement, scene: Callable[[], Scene]) -> PrivilegedObservation:
        """An observation with the truth beside it."""
        seen = observation
        return PrivilegedObservation(
            seen.step, seen.time, seen.language, seen.arrays, seen.cloud, seen.cameras, measurement, scene
        )

    @property
    def q(self) -> npt.NDArray[np.float64]:
        """(n,) robot joints, for arithmetic."""
        return self.joint_positions.astype(np.float64)

    @property
    def qvel(self) -> npt.NDArray[np.float64]:
        """(n,) their velocities."""
        return self.joint_velocities.astype(np.float64)


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference of an action at the end of its control step, independent of the robot's drives.

    Attributes:
        joint_positions, joint_velocities: (m,) of the arm, rad or m, and a second.
        gripper: (2,) distance of the pads that is commanded, m, and the force (N) by which each finger is to press on
            what it holds; NaN: none is meant.
        action: (m + 1,) that was meant where another was sent; None: what was sent.
    """

    joint_positions: npt.NDArray[np.float32]
    joint_velocities: npt.NDArray[np.float32]
    gripper: npt.NDArray[np.float32]
    action: Action | None = None


@dataclass(frozen=True)
class Event:
    """Event reported by a controller.

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
    """Decides every action of one episode (docs/guides/controllers.md).

    A class may say more by attributes, all of them optional:

    - ``privileged = True``: it is made with ``task`` and ``profile`` beside its own arguments, and is shown
      :class:`PrivilegedObservation`.
    - ``observation_spec``: an :class:`~gensim2.perception.ObservationSpec` or its fields, what it looks at; without,
      point clouds by the defaults, and of a privileged one the robot's own state. It is read before every observation:
      a controller that looks now and then has ``PROPRIOCEPTIVE`` in between.
    - ``reference``: a :class:`Reference`, read after every action and recorded; None: it means no more than the action.
    - ``close()``: gives up what the controller holds open, a connection for example; called once it is not needed.
    - ``turn``, ``history``, ``events``: the name of the task's step that it is at, a record of each step that was
      begun, and what was noticed; ``turn`` is read after every action, the others when the episode is over. Without
      them a step's turn ends where its criterion is true.
    """

    def reset(self, observation: Any, seed: int) -> None:
        """Begin an episode and forget the one before.

        Args:
            observation: an :class:`~gensim2.perception.Observation`, the first.
            seed: of everything that the controller draws; not that of the scene.
        """
        ...

    def act(self, observation: Any) -> npt.ArrayLike | None:
        """The next action, (m + 1,): targets of the arm's joints and the gripper from -1 to 1; None: done."""
        ...


def is_privileged(controller: Controller | type) -> bool:
    """Whether a controller, or its class, says that it is shown the truth."""
    return bool(getattr(controller, "privileged", False))


def spec_of(controller: Controller) -> ObservationSpec:
    """Return the observation spec of a controller.

    Raises:
        InputError: its ``observation_spec`` is none.
    """
    given = getattr(controller, "observation_spec", None)
    if given is None and is_privileged(controller):
        return PROPRIOCEPTIVE
    return ObservationSpec.of(given)


def reference_of(controller: Controller) -> Reference | None:
    """Return the reference of a controller's last action; None where it says nothing."""
    reference: Reference | None = getattr(controller, "reference", None)
    return reference


def turn_of(controller: Controller) -> str | None:
    """Name of the task's step that a controller is at; None where it says nothing."""
    turn: str | None = getattr(controller, "turn", None)
    return turn


def history_of(controller: Controller) -> Sequence[StepRecord]:
    """One a step that was begun, however often; empty where the controller says nothing."""
    history: Sequence[StepRecord] = getattr(controller, "history", ())
    return history


def events_of(controller: Controller) -> Sequence[Event]:
    """Return the events that a controller reports, in order; empty where it reports none."""
    events: Sequence[Event] = getattr(controller, "events", ())
    return events


class WrappedController:
    """Base of a controller around another one; ``_controller`` is the other.

    What a controller may tell beside its actions is read from the one inside.
    """

    _controller: Controller

    @property
    def observation_spec(self) -> ObservationSpec:
        """Spec of the controller's next observation."""
        return spec_of(self._controller)

    @property
    def reference(self) -> Reference | None:
        """The controller's."""
        return reference_of(self._controller)

    @property
    def turn(self) -> str | None:
        """The controller's."""
        return turn_of(self._controller)

    @property
    def history(self) -> Sequence[StepRecord]:
        """The controller's."""
        return history_of(self._controller)

    @property
    def events(self) -> Sequence[Event]:
        """The controller's."""
        return events_of(self._controller)
