"""Open real devices by the names that are given on the command line. The cameras run in their own process."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gensim2.core.errors import GenSim2Error, InputError, near
from gensim2.perception import Camera
from gensim2.robots import RobotProfile
from gensim2_robot.config import CameraSource
from gensim2_robot.devices import CameraFrame
from gensim2_robot.drivers.streamed import StreamedArm
from gensim2_robot.pipes import DeviceGoneError, PictureSlots
from gensim2_robot.processes import DeviceProcess

if TYPE_CHECKING:
    from gensim2_robot.drivers.logged import LoggedCameras
    from gensim2_robot.drivers.realsense import RealSenseCameras

OPENING = 60.0
"""Time limit for cameras to open, s."""
POLL = 0.002
"""Time between two polls for images, s."""


class ProcessCameras:
    """Cameras in their own process.

    Args:
        make: function that creates the cameras' driver in the process. The driver has ``cameras``, ``serials``,
            ``poll()``, ``close()``, and optionally ``fail(fault)``.
        arguments: picklable arguments of ``make``.
        interrupted: list of received stop signals; the first signal ends the opening.

    Attributes:
        cameras: cameras as reported by the driver.
        serials: serial number of each camera's device, by camera name.

    Raises:
        GenSim2Error: ``make`` raised a GenSim2Error, which is raised again.
        DeviceGoneError: ``make`` failed, the process ended, the cameras did not open within 60 s, or there was a stop
            signal.
    """

    def __init__(self, make: Callable[..., Any], *arguments: Any, interrupted: Sequence[int] = ()) -> None:
        self._process = DeviceProcess("cameras", _serve, make, *arguments)
        try:
            (room, serials), *self._early = self._opened(interrupted)
        except GenSim2Error:
            self._process.kill()
            for message in self._process.close():
                if isinstance(message, tuple):  # the first message, which names the shared memory
                    PictureSlots.enter(message[0]).close()
            raise
        self.cameras: tuple[Camera, ...] = room.cameras
        self.serials: Mapping[str, str] = serials
        self._slots = PictureSlots.enter(room)

    def _opened(self, interrupted: Sequence[int]) -> list[Any]:
        """Wait until the cameras are open."""
        until = time.monotonic() + OPENING
        while not (found := self._process.drain()):
            if interrupted:
                name = signal.Signals(interrupted[0]).name
                wrong = "a person or the system asked the program to stop while the cameras were opened"
                raise DeviceGoneError(f"{wrong} (signal {name})")
            if time.monotonic() > until:
                raise DeviceGoneError(f"the cameras did not open within {OPENING:g} s")
            time.sleep(POLL)
        return found

    def poll(self) -> Sequence[CameraFrame]:
        """Return the images received since the last call.

        Raises:
            DeviceGoneError: the driver has failed, or the process has ended or does not answer.
        """
        found = []
        pictures, self._early = [*self._early, *self._process.drain()], []
        for picture in pictures:
            found.append(self._slots.take(picture))
            self._process.tell(picture)
        return found

    def fail(self, fault: str) -> None:
        self._process.tell(fault)

    def close(self) -> None:
        self._process.close()
        self._slots.close()


def _serve(pipe: Connection, make: Callable[..., Any], *arguments: Any) -> None:
    try:
        driver = make(*arguments)
    except GenSim2Error:
        raise
    except Exception as error:  # The arm's library can raise exceptions of any type.
        raise DeviceGoneError(f"the cameras cannot be opened: {type(error).__name__}: {error}") from error
    try:
        slots, room = PictureSlots.make(driver.cameras)
        pipe.send((room, driver.serials))
        while True:
            while pipe.poll():
                message = pipe.recv()
                if message is None:
                    return
                if isinstance(message, str):
                    driver.fail(message)
                else:
                    slots.free(message)
            for frame in driver.poll():
                picture = slots.put(frame)
                if picture is not None:
                    pipe.send(picture)
            time.sleep(POLL)
    except (EOFError, ConnectionError, DeviceGoneError):
        raise
    except Exception as error:  # The libraries of devices may raise exceptions of any type.
        raise DeviceGoneError(f"the connection to the cameras is lost: {error}") from error
    finally:
        driver.close()


def open_arm(word: str, profile: RobotProfile) -> StreamedArm:
    """Connect to an arm.

    Args:
        word: ``franka:HOST``, ``panda:HOST``, ``ur:HOST`` or ``xarm:HOST``.

    Raises:
        MissingExtraError: the maker's library is not installed.
        DriverError: the connection fails.
    """
    kind, _, host = word.partition(":")
    if kind == "franka":
        from gensim2_robot.drivers.franka import FrankaArm

        return FrankaArm(host, profile)
    if kind == "panda":
        from gensim2_robot.drivers.franka import PandaPyArm

        return PandaPyArm(host, profile)
    if kind == "ur":
        from gensim2_robot.drivers.ur import URArm

        return URArm(host, profile)
    from gensim2_robot.drivers.xarm import XArm

    return XArm(host, profile)


def open_cameras(
    source: CameraSource, there: Sequence[Camera], rate: float, interrupted: Sequence[int] = ()
) -> ProcessCameras:
    """Open RealSense cameras or recordings in their own process.

    Args:
        source: source with devices or files.
        there: available cameras with their names, image sizes and initial guesses of their poses.
        rate: frame rate of real cameras, Hz. Recordings are played at their recorded rate.
        interrupted: list of received stop signals; the first signal ends the opening.

    Raises:
        InputError: a camera is unknown, a file is not a recording, or logs of runs are mixed with other files.
        MissingExtraError: the maker's library is not installed.
        DriverError: a device is not connected.
    """
    known = {camera.name: camera for camera in there}
    for name in source.devices:
        if name not in known:
            raise InputError(f"unknown camera {name!r}", field="--cameras", remedy=near(name, known))
    named = tuple(known[name] for name in source.devices)
    if source.kind == "recording":
        from gensim2_robot.drivers.logged import is_log

        logs = [is_log(Path(file)) for file in source.devices.values()]
        if any(logs) and not all(logs):
            said = "some are logs of the line, some recordings of a RealSense"
            raise InputError(said, field="--cameras", remedy="all of one kind, played by one clock")
        if all(logs):
            return ProcessCameras(logged_cameras, source, named, interrupted=interrupted)
    return ProcessCameras(realsense_cameras, source, named, round(rate), interrupted=interrupted)


def realsense_cameras(source: CameraSource, cameras: Sequence[Camera], rate: int) -> RealSenseCameras:
    """Open RealSense cameras or their recordings in this process; see :func:`open_cameras`."""
    from gensim2_robot.drivers.realsense import RealSenseCameras, connected, recorded

    if source.kind == "recording":
        devices = recorded({name: Path(file) for name, file in source.devices.items()})
    else:
        devices = connected(source.devices)
    return RealSenseCameras(cameras, devices, rate)


def logged_cameras(source: CameraSource, cameras: Sequence[Camera]) -> LoggedCameras:
    """Open logs of runs in this process; see :func:`open_cameras`."""
    from gensim2_robot.drivers.logged import LoggedCameras

    return LoggedCameras(cameras, {name: Path(file) for name, file in source.devices.items()})


class ByHand:
    """A real scene that a person arranges and judges.

    The program does not know whether the goal is met or the scene is at rest.
    """

    is_ready = True
    goal: bool | None = None
    at_rest: bool | None = None

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """Do nothing, because a person lays out the scene."""
