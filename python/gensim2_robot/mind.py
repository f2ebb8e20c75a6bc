"""Connect a controller to the control loop of an arm.

The rollout loop, which simulation uses too, asks for one action at a time. :class:`LineBody` collects these actions to
the chunks that the control loop requests.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error
from gensim2.core.seeding import rng
from gensim2.perception import Camera, Observation, ObservationSpec
from gensim2.planning.scene import Scene
from gensim2.policy.remote.client import RemoteController
from gensim2.robots import robot
from gensim2.rollout.controller import Controller, PrivilegedObservation, events_of, is_privileged, spec_of
from gensim2.rollout.controller_spec import CHAIN, ControllerSpec
from gensim2.rollout.driving import drive
from gensim2.rollout.guarded import Guarded
from gensim2.rollout.record import Cause
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import TaskSpec
from gensim2_robot.eyes import CameraPoseError, Eyes, SensorSnapshot, inputs

SLOW = 0.6
"""Delay of an answer under the fault ``policy-slow``, s."""


class Truth(Protocol):
    """Interface to the true state of a simulated world, for privileged controllers."""

    def measure(self) -> Measurement:
        """Return the true measurement of objects and gripper."""
        ...

    def scene_state(self) -> Scene:
        """Return the true scene in the planner's form."""
        ...


@dataclass(frozen=True)
class Begin:
    """Message that starts an episode; ``seed`` is the seed of the controller's random numbers."""

    seed: int


@dataclass(frozen=True, eq=False)
class Question:
    """Request for a controller's next actions.

    Attributes:
        number: number of the request.
        sight: data from which the observation is computed.
        count: number of requested actions, one for each control step.
    """

    number: int
    sight: SensorSnapshot
    count: int


@dataclass(frozen=True, eq=False)
class ControllerAnswer:
    """Answer of a controller.

    Attributes:
        number: number of the request.
        actions: (k, m + 1) targets of the arm's joints, rad, and gripper commands from -1 to 1. They start at the
            control step of the request. If the controller is done, k is smaller than requested.
        done: whether the controller has ended the episode.
        seen: arrays of the controller's observations, by name.
        cloud_ms: time from the newest image to the point cloud, ms; None without a cloud.
        encoding_ms: time for computing the point cloud, ms; None without a cloud.
        acting_ms: computing time of the controller, ms.
        error: reason why there are no actions; None if there is no error.
        refusal: reason why the controller ended the episode without a motion, such as an unexpected object. None
            otherwise.
    """

    number: int
    actions: npt.NDArray[np.float32]
    done: bool = False
    seen: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    cloud_ms: float | None = None
    encoding_ms: float | None = None
    acting_ms: float = 0.0
    error: str | None = None
    refusal: str | None = None


@dataclass(frozen=True)
class MindSpec:
    """Data that is sent to a controller's process, which makes the controller and observations from it.

    Attributes:
        controller: specification of the controller.
        task: task of the episodes.
        cameras: available cameras.
    """

    controller: ControllerSpec
    task: TaskSpec
    robot: str
    cameras: tuple[Camera, ...]


def looked_at(spec: ObservationSpec, cameras: tuple[Camera, ...]) -> ObservationSpec:
    """Return the spec of the data that is displayed and logged.

    The spec is the controller's if the controller uses cameras, and otherwise has all cameras.
    """
    return ObservationSpec(cameras=tuple(each.name for each in cameras)) if spec.is_proprioceptive else spec


class _OverError(GenSim2Error):
    """The control loop has ended the episode."""


class LineBody:
    """Adapter between the control loop, which requests chunks, and the rollout loop.

    ``observe`` waits for a request, and ``step`` collects actions until the chunk is complete.

    Args:
        spec: description of the controller.
        receive: function that waits for a request or the end of the episode.
        send: function that sends answers.
        now: function that returns the time of the control loop's clock, s.
        truth: true state of the scene, for privileged controllers.

    Attributes:
        faults: injected faults of the controller.
        remote: the controller, if it runs on a policy server; else None.
        next: message that ended the episode. ``observe`` has received this message while it waited for a request.
    """

    # The rollout loop waits for the controller, because the arm's loop already measures delays.
    waits = True

    def __init__(
        self,
        spec: MindSpec,
        receive: Callable[[], Any],
        send: Callable[[ControllerAnswer], None],
        now: Callable[[], float],
        truth: Truth | None,
    ) -> None:
        self.profile = robot(spec.robot)
        self._spec, self._receive, self._send, self._now, self._truth = spec, receive, send, now, truth
        self._eyes: dict[ObservationSpec, Eyes] = {}
        self.faults: set[str] = set()
        self.remote: RemoteController | None = None
        self.next: Any = None
        self._forget()

    def _forget(self) -> None:
        self._question: Question | None = None
        self._actions: list[npt.NDArray[np.float32]] = []
        self._seen: tuple[ObservationSpec, Observation] | None = None
        self._measured: Measurement | None = None
        self._shown: dict[str, npt.NDArray[Any]] = {}
        self._cloud_ms: float | None = None
        self._encoding_ms: float | None = None
        self._begun = 0.0

    def fail(self, fault: str) -> None:
        self.faults.add(fault)
        if fault == "policy-token" and self.remote is not None:
            self.remote.disown()

    def prepare(self, spec: ObservationSpec) -> None:
        """Build the data that observations need in advance, so that the first answer is not delayed."""
        self._eyes_of(looked_at(spec, self._spec.cameras) if self._truth is not None else spec)

    def reset(self, seed: int, options: Any = None) -> None:
        self._forget()

    def observe(self, spec: ObservationSpec) -> Observation:
        """Wait for a request, and compute the observation from the data in the request.

        Raises:
            EmptyCloudError: the point cloud is empty.
        """
        if self._question is None:
            found = self._receive()
            while isinstance(found, str):
                self.fail(found)
                found = self._receive()
            if not isinstance(found, Question):
                self.next = found
                raise _OverError("the episode is over")
            self._forget()
            self._question, self._begun = found, time.perf_counter()
        question = self._question
        if self._seen is None or self._seen[0] != spec:
            self._seen = spec, self._look(spec, question.sight)
        observation = self._seen[1]
        step = question.sight.step + len(self._actions)
        observation = replace(observation, step=step, time=step / self.profile.control_hz)
        if self._truth is None:
            return observation
        if self._measured is None:
            self._measured = self._truth.measure()
        return PrivilegedObservation.of(observation, self._measured, self._truth.scene_state)

    def _look(self, spec: ObservationSpec, sight: SensorSnapshot) -> Observation:
        begun = time.perf_counter()
        observation = self._eyes_of(spec).observe(sight)
        shown = observation
        if self._truth is not None and spec.is_proprioceptive:
            # A planner uses no camera, but the log and the page show the point cloud.
            shown = self._eyes_of(ObservationSpec(cameras=tuple(each.name for each in self._spec.cameras))).observe(
                sight
            )
        if shown.cloud is not None:
            self._encoding_ms = 1e3 * (time.perf_counter() - begun)
            self._cloud_ms = 1e3 * (self._now() - max(frame.captured for frame in sight.frames))
        # A controller may request several observations for one control step, so their arrays are merged for the log.
        self._shown |= inputs(shown)
        return observation

    def _eyes_of(self, spec: ObservationSpec) -> Eyes:
        if spec not in self._eyes:
            self._eyes[spec] = Eyes(spec, self.profile, self._spec.cameras, self._spec.task.description)
        return self._eyes[spec]

    def step(self, action: npt.ArrayLike) -> None:
        """Add an action to the chunk, and send the chunk when it is complete."""
        assert self._question is not None, "an action follows from what was seen"
        given = np.asarray(action, dtype=np.float32)
        self._actions.append(np.full_like(given, np.nan) if "policy-nan" in self.faults else given)
        if len(self._actions) >= self._question.count:
            self.answer()

    def answer(self, done: bool = False, error: str | None = None, refusal: str | None = None) -> None:
        """Answer the open request, if there is one. The arguments are those of :class:`ControllerAnswer`."""
        if self._question is None:
            return
        if "policy-slow" in self.faults:
            time.sleep(SLOW)
        actions = np.array(self._actions, dtype=np.float32).reshape(-1, self.profile.action_size)
        if "policy-garbage" in self.faults:
            actions = _garbage(self._question.number, self.profile.action_size)
        spent = 1e3 * (time.perf_counter() - self._begun) - (self._encoding_ms or 0.0)
        times = self._cloud_ms, self._encoding_ms, spent
        self._send(ControllerAnswer(self._question.number, actions, done, self._shown, *times, error, refusal))
        self._question = None

    def close(self) -> None:
        """Do nothing."""


def _garbage(number: int, size: int) -> npt.NDArray[np.float32]:
    """Return random unreachable actions, some of the wrong size, for the fault ``policy-garbage``."""
    draw = rng(0, "garbage", number)
    return draw.normal(0.0, 100.0, (3, size + int(draw.integers(2)))).astype(np.float32)


def _refusal(controller: Controller) -> str | None:
    """Return the reason, with measured values, why a controller refuses to act without seeing the objects.

    Return None if it does not refuse.
    """
    refused = next((each for each in events_of(controller) if each.what == Cause.OBJECT_NOT_SEEN), None)
    if refused is None:
        return None
    seen = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in refused.detail.items())
    return f"{refused.what} ({seen})"


def think(
    spec: MindSpec,
    receive: Callable[[], Any],
    send: Callable[[Any], None],
    now: Callable[[], float],
    truth: Truth | None,
) -> None:
    """Answer the requests of successive episodes, until ``receive`` returns None.

    Args:
        spec: description of the controller.
        receive: function that waits for :class:`Begin`, :class:`Question`, or None.
        send: function that is called with ``"ready"`` once, and then with each answer.
        now: function that returns the time of the control loop's clock, s.
        truth: true state of the scene, for privileged controllers.
    """
    profile = robot(spec.robot)
    made = spec.controller.make(spec.task, profile)
    controller: Controller = made
    if spec.controller.target != CHAIN:
        controller = Guarded(made, spec.controller, spec.task, profile, spec.task.name)
    body = LineBody(spec, receive, send, now, truth if is_privileged(made) else None)
    body.remote = made if isinstance(made, RemoteController) else None
    body.prepare(spec_of(controller))
    send("ready")
    message = receive()
    while message is not None:
        if isinstance(message, Begin):
            body.next = None
            try:
                drive(body, controller, sys.maxsize, seed=message.seed)
                body.answer(done=True, refusal=_refusal(controller))
            except _OverError:
                message = body.next
                continue
            except GenSim2Error as error:
                whose = "" if isinstance(error, CameraPoseError) else "the controller failed: "
                body.answer(error=f"{whose}{error}")
        elif isinstance(message, Question):  # A request of an episode that has ended gets no answer.
            send(ControllerAnswer(message.number, np.empty((0, profile.action_size), dtype=np.float32), done=True))
        elif isinstance(message, str):
            body.fail(message)
        message = receive()
