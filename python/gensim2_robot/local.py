"""Simulated devices and a controller in this process, by a simulated clock: the same run every time."""

from __future__ import annotations

import queue
import signal
import threading
from collections.abc import Mapping, Sequence
from typing import Any

from gensim2.core.errors import GenSim2Error
from gensim2.core.seeding import rng
from gensim2_robot.arm_limits import CYCLE, Array
from gensim2_robot.clocks import SimulatedClock
from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.mind import SLOW, Begin, ControllerAnswer, MindSpec, Question, Truth, think
from gensim2_robot.pipes import DeviceGoneError
from gensim2_robot.simulated import GOAL_EVERY, RATE, SimulatedCameras, SimulatedWorld

WAITING = 0.1
"""Seconds after which a wait looks for a signal that asks to stop."""


class LocalArm:
    """The simulated arm by a simulated clock.

    Attributes:
        goal, at_rest: whether the task's goal held, and the scene was at rest, at the last look.
    """

    def __init__(self, world: SimulatedWorld, clock: SimulatedClock) -> None:
        self._world, self._clock, self.profile = world, clock, world.profile
        self._reached, self._cycles = clock.now(), 0
        self.goal = self.at_rest = False
        clock.hooks.append(self._advance)

    def _advance(self, now: float) -> None:
        while self._reached + 0.5 * CYCLE < now:
            self._reached += CYCLE
            self._world.advance(self._reached)
            if self._cycles % GOAL_EVERY == 0:
                self.goal, self.at_rest = self._world.look()
            self._cycles += 1

    def poll(self) -> Sequence[ArmState]:
        """States of the cycles that went by."""
        return self._world.said(self._clock.now())

    def send(self, q: Array, gripper: float, t: float) -> None:
        """Targets of the next cycle."""
        self._world.send(q, gripper, t)

    def stand(self) -> None:
        """Stop where the arm is."""
        self._world.stand()

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """A fresh scene."""
        self._world.reset(seed, options)
        self._cycles, self.goal, self.at_rest = 0, False, False

    @property
    def is_ready(self) -> bool:
        """Whether the scene is there."""
        return True

    def fail(self, fault: str) -> None:
        """Let it fail from now on."""
        self._world.faults.add(fault)

    def close(self) -> None:
        """Give up the world."""
        self._world.close()


class LocalCameras:
    """Simulated cameras by a simulated clock.

    Args:
        world: that they look at.
        cameras: that there are.
        clock: by which they take pictures.
        rate: pictures a second.
        latency: range of the seconds from a picture to its arrival, drawn each episode.
        seed: of it.
    """

    def __init__(
        self,
        world: SimulatedWorld,
        cameras: SimulatedCameras,
        clock: SimulatedClock,
        rate: float = RATE,
        latency: tuple[float, float] = (0.03, 0.03),
        seed: int = 0,
    ) -> None:
        self._rate = rate
        self._world, self._cameras, self._clock = world, cameras, clock
        self._range, self._seed = latency, seed
        self._latency, self._episode = latency[0], 0
        self.cameras = cameras.cameras
        self.serials: Mapping[str, str] = cameras.serials
        self._due = 0.0
        self._coming: list[tuple[float, CameraFrame]] = []
        clock.hooks.append(self._take)

    def _take(self, now: float) -> None:
        if now < self._due or self._world.episode == 0:
            return
        if self._world.episode != self._episode:
            self._episode = self._world.episode
            self._latency = rng(self._seed, "delay of pictures", self._episode).uniform(*self._range)
        self._due = max(self._due + 1.0 / self._rate, now)
        self._coming += [(now + self._latency, frame) for frame in self._cameras.take(self._world.rows(now))]

    def poll(self) -> Sequence[CameraFrame]:
        """Pictures that have arrived."""
        now = self._clock.now()
        found = [frame for at, frame in self._coming if at <= now]
        self._coming = [each for each in self._coming if each[0] > now]
        return found

    def fail(self, fault: str) -> None:
        """Let them fail from now on."""
        self._cameras.faults.add(fault)

    def close(self) -> None:
        """Nothing is held."""


class LocalMind:
    """A controller in a thread; the clock stands still until it has answered, and the answer takes its time by it.

    Args:
        spec: how the controller is made.
        truth: for a privileged one.
        clock: of the line.
        latency: range of the seconds from a question to its answer, drawn each episode by its
            seed.
        interrupted: numbers of signals that have asked to stop; once there is one, no answer is waited for.

    Raises:
        GenSim2Error: a signal asked to stop before the controller was made, or before it answered.
    """

    def __init__(
        self,
        spec: MindSpec,
        truth: Truth,
        clock: SimulatedClock,
        latency: tuple[float, float] = (0.05, 0.05),
        interrupted: Sequence[int] = (),
    ) -> None:
        self._clock, self._range, self._interrupted = clock, latency, interrupted
        self._latency = latency[0]
        self._inbox: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._outbox: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._coming: list[tuple[float, ControllerAnswer]] = []
        self._slow = False
        self.is_alive = True
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, args=(spec, truth), daemon=True)
        self._thread.start()
        if self._said() is None:
            assert self._error is not None
            raise self._error

    def _run(self, spec: MindSpec, truth: Truth) -> None:
        try:
            think(spec, self._inbox.get, self._outbox.put, self._clock.now, truth)
        except BaseException as error:  # noqa: BLE001 - told to whoever waits for it
            self._error = error
            self._outbox.put(None)

    def send(self, message: Begin | Question) -> None:
        """Say or ask something; waits for the answer to a question."""
        if isinstance(message, Begin):
            self._latency = rng(message.seed, "delay of answers").uniform(*self._range)
        self._inbox.put(message)
        if isinstance(message, Question) and self.is_alive:
            answer = self._said()
            if answer is None:
                raise GenSim2Error(f"the controller failed: {self._error}") from self._error
            late = SLOW if self._slow else 0.0
            self._coming.append((self._clock.now() + self._latency + late, answer))

    def _said(self) -> Any:
        """Wait for the controller's next word."""
        while True:
            try:
                return self._outbox.get(timeout=WAITING)
            except queue.Empty:
                if self._interrupted:
                    self.is_alive = False
                    name = signal.Signals(self._interrupted[0]).name
                    raise DeviceGoneError(f"a person or the system asked to stop: {name}") from None

    def poll(self) -> Sequence[ControllerAnswer]:
        """Answers whose time has come."""
        now = self._clock.now()
        found = [answer for at, answer in self._coming if at <= now]
        self._coming = [each for each in self._coming if each[0] > now]
        return found if self.is_alive else []

    @property
    def is_ready(self) -> bool:
        """Whether the controller is made."""
        return True

    def fail(self, fault: str) -> None:
        """Let it fail from now on."""
        if fault == "policy-killed":
            self.is_alive = False
        elif fault == "policy-slow":
            self._slow = True
        else:
            self._inbox.put(fault)

    def close(self) -> None:
        """Let the controller go."""
        self._inbox.put(None)
        self._thread.join(timeout=10 if self.is_alive else WAITING)
