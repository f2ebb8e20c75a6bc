"""Run simulated devices and a controller in this process with a simulated clock, for reproducible runs."""

from __future__ import annotations

import queue
import signal
import threading
from collections.abc import Mapping, Sequence
from typing import Any

from gensim2.core.arrays import Array
from gensim2.core.errors import GenSim2Error
from gensim2.core.seeding import rng
from gensim2_robot.arm_limits import CYCLE
from gensim2_robot.clocks import SimulatedClock
from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.mind import SLOW, Begin, ControllerAnswer, MindSpec, Question, Truth, think
from gensim2_robot.pipes import DeviceGoneError
from gensim2_robot.simulated import GOAL_EVERY, RATE, SimulatedCameras, SimulatedWorld

WAITING = 0.1
"""Time between checks for a stop signal while waiting, s."""


class LocalArm:
    """Simulated arm in this process with a simulated clock.

    The arm regularly checks the goal and whether the scene is at rest.

    Attributes:
        goal: whether the goal was reached at the most recent check.
        at_rest: whether the scene was at rest at the most recent check.
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
        return self._world.said(self._clock.now())

    def send(self, q: Array, gripper: float, t: float) -> None:
        self._world.send(q, gripper, t)

    def stand(self) -> None:
        self._world.stand()

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        self._world.reset(seed, options)
        self._cycles, self.goal, self.at_rest = 0, False, False

    @property
    def is_ready(self) -> bool:
        return True

    def fail(self, fault: str) -> None:
        self._world.faults.add(fault)

    def close(self) -> None:
        self._world.close()


class LocalCameras:
    """Simulated cameras that run in this process with a simulated clock.

    Args:
        world: simulated world that the cameras see.
        cameras: cameras to simulate.
        clock: clock that gives the times of images.
        rate: frame rate, Hz.
        latency: range (s) from which the delay of images is drawn for each episode.
        seed: seed of the delay.
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
        now = self._clock.now()
        found = [frame for at, frame in self._coming if at <= now]
        self._coming = [each for each in self._coming if each[0] > now]
        return found

    def fail(self, fault: str) -> None:
        self._cameras.faults.add(fault)

    def close(self) -> None:
        """Do nothing."""


class LocalMind:
    """Controller in a thread of this process.

    The clock does not advance until the controller answers. The answer arrives after a simulated delay.

    Args:
        spec: specification of the controller.
        truth: true state of the scene for privileged controllers.
        clock: clock of the loop.
        latency: range (s) from which the delay of answers is drawn with the episode's seed.
        interrupted: list of received stop signals; the first signal ends all waiting.

    Raises:
        GenSim2Error: a stop signal arrived before the controller was created, or before its answer.
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
        except BaseException as error:  # noqa: BLE001 - passed to the waiting caller
            self._error = error
            self._outbox.put(None)

    def send(self, message: Begin | Question) -> None:
        """Send a message; if it is a request, wait for the answer."""
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
        """Wait for the controller's next message."""
        while True:
            try:
                return self._outbox.get(timeout=WAITING)
            except queue.Empty:
                if self._interrupted:
                    self.is_alive = False
                    name = signal.Signals(self._interrupted[0]).name
                    raise DeviceGoneError(f"a person or the system asked the program to stop (signal {name})") from None

    def poll(self) -> Sequence[ControllerAnswer]:
        now = self._clock.now()
        found = [answer for at, answer in self._coming if at <= now]
        self._coming = [each for each in self._coming if each[0] > now]
        return found if self.is_alive else []

    @property
    def is_ready(self) -> bool:
        return True

    def fail(self, fault: str) -> None:
        if fault == "policy-killed":
            self.is_alive = False
        elif fault == "policy-slow":
            self._slow = True
        else:
            self._inbox.put(fault)

    def close(self) -> None:
        self._inbox.put(None)
        self._thread.join(timeout=10 if self.is_alive else WAITING)
