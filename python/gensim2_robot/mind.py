"""The controller's side of the line: the rollout's own loop, asked by questions, answering with chunks of actions."""

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
from gensim2.rollout.controller import Controller, PrivilegedObservation, is_privileged, spec_of
from gensim2.rollout.controller_spec import CHAIN, ControllerSpec
from gensim2.rollout.driving import drive
from gensim2.rollout.guarded import Guarded
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import TaskSpec
from gensim2_robot.eyes import CameraPoseError, Eyes, SensorSnapshot, inputs

SLOW = 0.6
"""Seconds that a controller takes for an answer that is told to be slow."""


class Truth(Protocol):
    """Truth of a simulated world, for a privileged controller."""

    def measure(self) -> Measurement:
        """Measure the objects and the gripper, now."""
        ...

    def scene_state(self) -> Scene:
        """Return the scene as a planner sees it."""
        ...


@dataclass(frozen=True)
class Begin:
    """An episode begins; ``seed`` is of what the controller draws."""

    seed: int


@dataclass(frozen=True, eq=False)
class Question:
    """Question to a controller about its next actions.

    Attributes:
        number: counts questions.
        sight: what there is to be seen.
        count: actions that are wanted, one a control step.
    """

    number: int
    sight: SensorSnapshot
    count: int


@dataclass(frozen=True, eq=False)
class ControllerAnswer:
    """Answer of a controller.

    Attributes:
        number: of the question.
        actions: (k, m + 1) targets of the arm's joints in rad and the gripper from -1 to 1, for the control steps from
            the question's on; fewer than wanted where the controller is done.
        done: the controller has nothing more to do.
        seen: all arrays that it was given, by name.
        cloud_ms: from the newest picture to the point cloud, ms; None where none was made.
        encoding_ms: to make the cloud of the pictures at hand, ms; None where none was made.
        acting_ms: that the controller computed, ms.
        error: why there is no action.
    """

    number: int
    actions: npt.NDArray[np.float32]
    done: bool = False
    seen: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    cloud_ms: float | None = None
    encoding_ms: float | None = None
    acting_ms: float = 0.0
    error: str | None = None


@dataclass(frozen=True)
class MindSpec:
    """Recipe of a controller and its observations; travels to its process.

    Attributes:
        controller: decides.
        task: what is to be done.
        robot: name of the robot.
        cameras: that there are.
    """

    controller: ControllerSpec
    task: TaskSpec
    robot: str
    cameras: tuple[Camera, ...]


def looked_at(spec: ObservationSpec, cameras: tuple[Camera, ...]) -> ObservationSpec:
    """Return the observation spec of the line for a controller: its own, or all cameras where it uses none."""
    return ObservationSpec(cameras=tuple(each.name for each in cameras)) if spec.is_proprioceptive else spec


class _OverError(GenSim2Error):
    """The episode has ended on the line's side."""


class LineBody:
    """The line as the body of the rollout: it is looked at when a question comes, and takes as many actions.

    Args:
        spec: see :class:`MindSpec`.
        receive: waits for a question, or for what ends the episode.
        send: of answers.
        now: the line's clock, s.
        truth: for a privileged controller.

    Attributes:
        faults: that the controller has.
        remote: the controller, where it is elsewhere.
        next: message that ended the episode.
    """

    waits = True  # the line judges by its own clock how long an answer takes

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
        """Fail from now on."""
        self.faults.add(fault)
        if fault == "policy-token" and self.remote is not None:
            self.remote.disown()

    def prepare(self, spec: ObservationSpec) -> None:
        """Build before the first question what it would have to wait for."""
        self._eyes_of(looked_at(spec, self._spec.cameras) if self._truth is not None else spec)

    def reset(self, seed: int, options: Any = None) -> None:
        """The line resets; here nothing is known yet."""
        self._forget()

    def observe(self, spec: ObservationSpec) -> Observation:
        """Wait for the observation of the question, and return it.

        Raises:
            EmptyCloudError: the cameras see nothing that a point cloud keeps.
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
            # A planner looks through no camera: the cloud is made all the same, for the log and for whoever watches.
            shown = self._eyes_of(ObservationSpec(cameras=tuple(each.name for each in self._spec.cameras))).observe(
                sight
            )
        if shown.cloud is not None:
            self._encoding_ms = 1e3 * (time.perf_counter() - begun)
            self._cloud_ms = 1e3 * (self._now() - max(frame.captured for frame in sight.frames))
        self._shown |= inputs(shown)  # a controller may look in several ways at one instant
        return observation

    def _eyes_of(self, spec: ObservationSpec) -> Eyes:
        if spec not in self._eyes:
            self._eyes[spec] = Eyes(spec, self.profile, self._spec.cameras, self._spec.task.description)
        return self._eyes[spec]

    def step(self, action: npt.ArrayLike) -> None:
        """Note one action; the chunk is sent when it is whole."""
        assert self._question is not None, "an action follows from what was seen"
        given = np.asarray(action, dtype=np.float32)
        self._actions.append(np.full_like(given, np.nan) if "policy-nan" in self.faults else given)
        if len(self._actions) >= self._question.count:
            self.answer()

    def answer(self, done: bool = False, error: str | None = None) -> None:
        """Answer the question, if one is open."""
        if self._question is None:
            return
        if "policy-slow" in self.faults:
            time.sleep(SLOW)
        actions = np.array(self._actions, dtype=np.float32).reshape(-1, self.profile.action_size)
        if "policy-garbage" in self.faults:
            actions = _garbage(self._question.number, self.profile.action_size)
        spent = 1e3 * (time.perf_counter() - self._begun) - (self._encoding_ms or 0.0)
        self._send(
            ControllerAnswer(
                self._question.number, actions, done, self._shown, self._cloud_ms, self._encoding_ms, spent, error
            )
        )
        self._question = None

    def close(self) -> None:
        """Nothing is held."""


def _garbage(number: int, size: int) -> npt.NDArray[np.float32]:
    """Actions of another size, or of no arm."""
    draw = rng(0, "garbage", number)
    return draw.normal(0.0, 100.0, (3, size + int(draw.integers(2)))).astype(np.float32)


def think(
    spec: MindSpec,
    receive: Callable[[], Any],
    send: Callable[[Any], None],
    now: Callable[[], float],
    truth: Truth | None,
) -> None:
    """Answer questions, episode after episode, until None comes.

    Args:
        spec: how the controller is made.
        receive: waits for :class:`Begin`, :class:`Question`, or None.
        send: takes ``"ready"`` once, then answers.
        now: the line's clock, s.
        truth: what a privileged controller is told.
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
                body.answer(done=True)
            except _OverError:
                message = body.next
                continue
            except GenSim2Error as error:
                whose = "" if isinstance(error, CameraPoseError) else "the controller failed: "
                body.answer(error=f"{whose}{error}")
        elif isinstance(message, Question):  # of an episode that this controller is done with
            send(ControllerAnswer(message.number, np.empty((0, profile.action_size), dtype=np.float32), done=True))
        elif isinstance(message, str):
            body.fail(message)
        message = receive()
