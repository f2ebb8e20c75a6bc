"""Run a simulated arm and its controller in processes with the machine's clock. Nothing here blocks its caller.

If the process group gets a stop signal, only the supervising process reacts: it stops the arm and then ends the other
processes.
"""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from multiprocessing.connection import Connection, Pipe
from multiprocessing.process import BaseProcess
from typing import Any

from gensim2.core.arrays import Array
from gensim2.core.cores import usable_cores
from gensim2.core.errors import GenSim2Error
from gensim2.core.processes.fork_server import ignore_interrupts, start_fork_server
from gensim2.core.processes.pool import SINGLE_THREADED
from gensim2.planning.scene import Scene
from gensim2.robots import robot
from gensim2.scenes.config import SceneConfig
from gensim2.tasks.measurement import Measurement
from gensim2_robot.arm_limits import CYCLE
from gensim2_robot.clocks import CONTROLLER_PRIORITY, schedule_first
from gensim2_robot.devices import ArmState
from gensim2_robot.mind import Begin, ControllerAnswer, MindSpec, Question, think
from gensim2_robot.pipes import DeviceGoneError, MessagePipe, PictureSlots, Room, SharedPicture

PRELOAD = ("gensim2_robot.real", "gensim2_robot.simulated", "gensim2.sim.sapien_scene")
SLIP = 0.2
"""Maximum delay (s) of the simulated time behind the clock that is caught up; a larger delay is skipped."""

ENDING = 3.0
"""Time limit for a process to end on request, s."""
KILLED = 1.0
"""Time limit for a killed process to end, s; a process whose kernel call waits for a device can take longer."""

_CONTEXT = multiprocessing.get_context("forkserver")
_GONE = (EOFError, OSError)


class DeviceProcess:
    """A child process, and the pipe between this process and the child; no call waits for the child.

    Args:
        what: name of the process for error messages.
        target: function of the process, which is called with the end of the pipe and ``arguments``. Its GenSim2Error is
            sent back.
        arguments: arguments of ``target``.
    """

    def __init__(self, what: str, target: Callable[..., None], *arguments: Any) -> None:
        # Set the preload list before the first process starts. A list that is set later has no effect.
        _CONTEXT.set_forkserver_preload(list(PRELOAD))
        ours, theirs = Pipe()
        self.pipe = MessagePipe(ours, what)
        self._process: BaseProcess = _CONTEXT.Process(
            target=_child, args=(target, theirs, *arguments), daemon=True, name=what
        )
        start_fork_server()
        self._process.start()
        theirs.close()

    def drain(self) -> list[Any]:
        """Return the messages that have arrived.

        Raises:
            DeviceGoneError: the process has ended, or does not answer.
            GenSim2Error: the process has sent this error.
        """
        found = self.pipe.drain()
        for message in found:
            if isinstance(message, GenSim2Error):
                raise message
        return found

    def tell(self, message: Any) -> None:
        self.pipe.tell(message)

    @property
    def is_alive(self) -> bool:
        return self._process.is_alive()

    @property
    def pid(self) -> int | None:
        return self._process.pid

    def kill(self) -> None:
        self._process.kill()

    def close(self) -> list[Any]:
        """End the process within four seconds, by force if necessary, and return the messages that were not read yet.

        A message that was not read may describe shared memory that is not open yet. The caller must still open this
        memory: this deletes its name, and it would not be freed otherwise.
        """
        self.tell(None)
        self._process.join(timeout=ENDING)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(timeout=KILLED)
        unread: list[Any] = []
        with contextlib.suppress(DeviceGoneError):
            unread = self.pipe.drain()
        self.pipe.close()
        return unread


def _child(target: Callable[..., None], pipe: Connection, *arguments: Any) -> None:
    ignore_interrupts()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.environ |= SINGLE_THREADED
    gc.freeze()  # exclude the imported objects from garbage collection, which would take 0.1 s
    try:
        target(pipe, *arguments)
    except GenSim2Error as error:
        with contextlib.suppress(*_GONE):
            pipe.send(error)
    except _GONE:
        return  # the parent has ended


class ProcessArm:
    """Simulated arm in its own process. The process regularly checks the goal and whether the scene is at rest.

    Args:
        scene: settings of the scenes.

    Attributes:
        goal: whether the goal was reached at the most recent check.
        at_rest: whether the scene was at rest at the most recent check.
        eyes: pipe through which the cameras request the state of the simulated world.
        truth: pipe through which a privileged controller requests the state of the simulated world.
    """

    def __init__(self, scene: SceneConfig) -> None:
        self.profile = robot(scene.robot)
        self.eyes, eyes = Pipe()
        self.truth, truth = Pipe()
        self._process = DeviceProcess("arm", _serve_world, scene, eyes, truth)
        self.goal = self.at_rest = False
        self._wanted, self._episode = 0, -1

    def poll(self) -> Sequence[ArmState]:
        found: list[ArmState] = []
        for kind, value in self._process.drain():
            if kind == "states":
                found += value
            elif kind == "goal":
                self.goal, self.at_rest = value
            elif kind == "episode":
                self._episode, self.goal, self.at_rest = value, False, False
                found.clear()
        return found

    def send(self, q: Array, gripper: float, t: float) -> None:
        self._process.tell(("send", q, gripper, t))

    def stand(self) -> None:
        self._process.tell(("stand",))

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """Start to create a new scene; ``is_ready`` becomes true when the scene has been created."""
        self._wanted += 1
        self._process.tell(("reset", seed, options))

    @property
    def is_ready(self) -> bool:
        return self._episode == self._wanted

    def fail(self, fault: str) -> None:
        self._process.tell(("fault", fault))

    def close(self) -> None:
        self._process.close()


def _serve_world(pipe: Connection, scene: SceneConfig, eyes: Connection, truth: Connection) -> None:
    from gensim2_robot.simulated import GOAL_EVERY, SimulatedWorld

    world = SimulatedWorld(scene)
    others = [MessagePipe(eyes, "cameras"), MessagePipe(truth, "controller")]
    begun, cycle, due = False, 0, time.monotonic()
    while True:
        while pipe.poll():
            message = pipe.recv()
            if message is None:
                world.close()
                return
            kind, *values = message
            if kind == "send":
                world.send(*values)
            elif kind == "stand":
                world.stand()
            elif kind == "fault":
                world.faults.add(values[0])
            elif kind == "reset":
                world.reset(*values)
                begun, cycle, due = True, 0, time.monotonic()
                pipe.send(("episode", world.episode))
        if begun:
            world.advance(due)
            said = world.said(due)
            if said:
                pipe.send(("states", said))
            if cycle % GOAL_EVERY == 0:
                pipe.send(("goal", world.look()))
            cycle += 1
            for other in others:
                _answer_world(other, world, due)
        due += CYCLE
        now = time.monotonic()
        if now - due > SLIP:
            due = now
        time.sleep(max(0.0, due - now))


def _answer_world(pipe: MessagePipe, world: Any, now: float) -> None:
    with contextlib.suppress(DeviceGoneError):
        for asked in pipe.drain():
            pipe.tell({"rows": lambda: world.rows(now), "measure": world.measure, "scene": world.scene_state}[asked]())


class ProcessTruth:
    """Access to the true state of a simulated world in another process."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def measure(self) -> Measurement:
        found: Measurement = self._ask("measure")
        return found

    def scene_state(self) -> Scene:
        found: Scene = self._ask("scene")
        return found

    def _ask(self, what: str) -> Any:
        try:
            self._pipe.send(what)
            return self._pipe.recv()
        except _GONE as error:
            raise GenSim2Error("the simulation process has ended") from error


class ProcessMind:
    """Connection to a controller in its own process.

    Args:
        spec: description of the controller.
        world: pipe end with which a privileged controller requests the simulated world's state; otherwise None.
    """

    def __init__(self, spec: MindSpec, world: Connection | None) -> None:
        self._process = DeviceProcess("controller", _serve_mind, spec, world)
        self._slots: PictureSlots | None = None
        self.is_ready = False
        self._gone = False

    def send(self, message: Begin | Question) -> None:
        """Send the start of an episode or a request. A request is dropped if there are no free slots for its images."""
        if isinstance(message, Begin):
            self._process.tell(message)
            return
        assert self._slots is not None, "it is asked when it is ready"
        pictures = [put for frame in message.sight.frames if (put := self._slots.put(frame)) is not None]
        if len(pictures) == len(message.sight.frames):
            self._process.tell((replace(message, sight=replace(message.sight, frames=())), pictures))
        else:
            for picture in pictures:
                self._slots.free(picture)

    def poll(self) -> Sequence[ControllerAnswer]:
        """Return the answers received since the last call.

        Raises:
            GenSim2Error: the controller cannot be created.
        """
        found = []
        try:
            for message in self._process.drain():
                if message == "ready":
                    self.is_ready = True
                elif isinstance(message, Room):
                    self._slots = PictureSlots.enter(message)
                elif isinstance(message, SharedPicture):
                    assert self._slots is not None, "it lies in them"
                    self._slots.free(message)
                else:
                    found.append(message)
        except DeviceGoneError:
            self._gone = True
        return found

    @property
    def is_alive(self) -> bool:
        return not self._gone and self._process.is_alive

    def fail(self, fault: str) -> None:
        if fault == "policy-killed":
            self._process.kill()
        else:
            self._process.tell(fault)

    def close(self) -> None:
        for message in self._process.close():
            if isinstance(message, Room):
                self._slots = PictureSlots.enter(message)
        if self._slots is not None:
            self._slots.close()


def _serve_mind(pipe: Connection, spec: MindSpec, world: Connection | None) -> None:
    slots, room = PictureSlots.make(spec.cameras)
    pipe.send(room)

    def receive() -> Any:
        message = pipe.recv()
        if not isinstance(message, tuple):
            return message
        question, pictures = message
        frames = tuple(map(slots.take, pictures))
        for picture in pictures:
            pipe.send(picture)
        return replace(question, sight=replace(question.sight, frames=frames))

    def send(message: Any) -> None:
        if message == "ready":
            gc.freeze()  # The controller exists now, so the garbage collector can skip its objects.
            # On a single core, a process with real-time priority would block the other processes.
            if usable_cores() > 1:
                schedule_first(CONTROLLER_PRIORITY)
        pipe.send(message)

    think(spec, receive, send, time.monotonic, None if world is None else ProcessTruth(world))
