"""Let another program control an arm with joint targets. The limits and the watchdog are the same as for a policy."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Mapping, Sequence
from typing import Unpack

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.core.errors import GenSim2Error, InputError
from gensim2.core.progress import NULL_PROGRESS
from gensim2.robots import RobotProfile, robot
from gensim2.rollout.inputs import read_task_input
from gensim2.scenes.config import SceneArguments
from gensim2_robot.config import SIMULATED, CameraSource, LineArguments, LineConfig
from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.line import PERIOD
from gensim2_robot.live import looking
from gensim2_robot.mind import Begin, ControllerAnswer, Question
from gensim2_robot.opening import Opened, opened, prepare
from gensim2_robot.session import PATIENCE, Layout, Session
from gensim2_robot.watch import State

READY = PATIENCE + 30.0
"""Time limit for devices to become ready, s; a session has a lower limit and reports missing devices first."""


class HaltedError(GenSim2Error):
    """The watchdog holds or has stopped the arm."""


class GivenActions:
    """Connection to a controller whose actions come from another program. Each action answers one request."""

    is_alive = True
    is_ready = True

    def __init__(self) -> None:
        self._action: npt.NDArray[np.float32] | None = None
        self._question: Question | None = None
        self._lock = threading.Lock()

    def give(self, action: npt.NDArray[np.float32]) -> None:
        """Set the action for the next request."""
        with self._lock:
            self._action = action

    def send(self, message: Begin | Question) -> None:
        if isinstance(message, Question):
            self._question = message

    def poll(self) -> Sequence[ControllerAnswer]:
        """Return the answer to the open request once an action has been set."""
        with self._lock:
            if self._question is None or self._action is None:
                return ()
            action, self._action = self._action, None
        answer = ControllerAnswer(self._question.number, np.repeat(action[None], self._question.count, axis=0))
        self._question = None
        return (answer,)

    def fail(self, fault: str) -> None:
        """Raise an error, because faults cannot be injected into actions that another program gives."""
        wrong = "faults cannot be injected, because the actions come from another program and not from a policy"
        raise InputError(wrong, field="fault")

    def close(self) -> None:
        """Do nothing."""


class Puppet:
    """Control loop in a thread that follows the joint targets of another program.

    The loop reaches each target within 0.1 s if possible.

    If no target arrives for 200 ms while the arm moves, the watchdog holds the arm, as it does with any controller.

    Args:
        task: task that provides the scene for a simulated arm.
        move: whether to send commands to the arm.
        line: see :class:`~gensim2_robot.config.LineConfig` and :class:`~gensim2.scenes.config.SceneArguments`;
            ``policy`` is ignored.

    Raises:
        InputError: an argument is invalid.
    """

    def __init__(self, task: str = "CloseBox", *, move: bool = False, **line: Unpack[LineArguments]) -> None:
        scene: SceneArguments
        source = CameraSource.parse(line.get("cameras", SIMULATED))
        robot_name = line.get("robot", "panda")
        decides = looking(robot_name, tuple(source.devices) or None)
        config, scene = LineConfig.split({**line, "policy": decides, "dry": not move})
        self.profile: RobotProfile = robot(robot_name)
        self._given = read_task_input(task, seed=config.seed, **scene)
        self._prepared = prepare(self._given, config)
        self._mind = GivenActions()
        self._stack = contextlib.ExitStack()
        self._there: Opened | None = None
        self._over, self._begun = threading.Event(), threading.Event()
        self._error: BaseException | None = None
        self._thread: threading.Thread | None = None

    @property
    def cameras(self) -> Mapping[str, tuple[int, int]]:
        """Height and width of the images by camera."""
        there = self._prepared.cameras if self._there is None else self._there.devices.cameras.cameras
        seen = self._prepared.seen.cameras
        return {camera.name: (camera.height, camera.width) for camera in there if camera.name in seen}

    @property
    def is_connected(self) -> bool:
        """Whether the arm accepts targets."""
        return self._begun.is_set() and self._error is None and not self._over.is_set()

    def connect(self) -> None:
        """Open the devices and take control of the arm at its current position; on failure, close all devices.

        Raises:
            HaltedError: the devices are not ready, or the arm is outside its limits.
            DriverError: a device cannot be opened.
        """
        self._over.clear()
        self._begun.clear()
        self._error, self._mind = None, GivenActions()
        with contextlib.ExitStack() as failed:
            failed.callback(self.close)
            self._there = self._stack.enter_context(opened(self._prepared, mind=self._mind, pace=1.0 / PERIOD))
            self._thread = threading.Thread(target=self._run, args=(self._there,), name="puppet", daemon=True)
            self._thread.start()
            self._begun.wait(READY)
            self._require()
            failed.pop_all()

    def state(self) -> ArmState:
        """Return the arm's last state.

        Raises:
            HaltedError: the watchdog holds or has stopped the arm.
        """
        found = self._require().line.arm.state()
        assert found is not None, "the arm has said where it stands"
        return found

    def frames(self) -> Mapping[str, CameraFrame]:
        """Return the newest image of each camera."""
        return dict(self._require().line.frames)

    def send(self, q: npt.ArrayLike, gripper: float) -> Array:
        """Request joints (m,) and a gripper command from -1 to 1; return the joints of the last sent command.

        Raises:
            HaltedError: the watchdog holds or has stopped the arm.
        """
        there = self._require()
        self._mind.give(np.append(np.asarray(q, dtype=np.float32), np.float32(gripper)))
        sent = there.line.arm.sent
        return there.line.arm.joints(self.state().q) if sent is None else sent.q.copy()

    def close(self) -> None:
        """Bring the arm to rest and disconnect it."""
        self._over.set()
        if self._thread is not None:
            self._thread.join(timeout=10.0)
        self._there = self._thread = None
        self._stack.close()

    def _require(self) -> Opened:
        if self._error is not None:
            kind = "" if isinstance(self._error, GenSim2Error) else f"{type(self._error).__name__}: "
            raise HaltedError(f"{kind}{self._error}") from self._error
        if self._there is None or not self._begun.is_set():
            raise HaltedError("the arm is not connected")
        watch = self._there.line.watch
        if watch.state is not State.RUNNING:
            raise HaltedError(f"{watch.state}: {watch.reason}")
        return self._there

    def _run(self, there: Opened) -> None:
        session = Session(there.line, there.devices, self._given, (), None, [], None, NULL_PROGRESS)
        try:
            with there.devices.clock.punctual():
                self._follow(there, session)
        except Exception as error:  # noqa: BLE001 - raised by the caller's next call
            self._error = error
            there.line.arm.release()
        finally:
            self._begun.set()

    def _follow(self, there: Opened, session: Session) -> None:
        if not session.prepare(Layout(self._prepared.config.seed)):
            raise HaltedError(there.line.watch.reason)
        there.line.begin(self._prepared.config.seed)
        self._begun.set()
        while not self._over.is_set():
            there.line.cycle()
        there.line.watch.hold(there.devices.clock.now(), "left")
        while there.line.stopped_ms is None and there.line.arm.sent is not None:
            there.line.cycle()
        there.line.arm.release()
