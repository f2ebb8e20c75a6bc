"""Real devices by the words of the command line. None of them was ever tried on hardware (docs/robot.md)."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gensim2.deploy.config import CameraSource
from gensim2.deploy.devices import Frame
from gensim2.deploy.drivers.streamed import StreamedArm
from gensim2.errors import InputError, near
from gensim2.observations import Camera
from gensim2.robots import RobotProfile

POLL = 0.002
"""Seconds between two looks for pictures."""
KEPT = 60
"""Pictures that wait to be polled at most."""


def open_arm(word: str, profile: RobotProfile) -> StreamedArm:
    """Connect to an arm.

    Args:
        word: ``franka:HOST``, ``ur:HOST`` or ``xarm:HOST``, as a :class:`~gensim2.deploy.config.LineConfig` has it.
        profile: of the robot.

    Raises:
        MissingExtraError: the maker's library is not installed.
        DriverError: the arm cannot be connected to.
    """
    kind, _, host = word.partition(":")
    if kind == "franka":
        from gensim2.deploy.drivers.franka import FrankaArm

        return FrankaArm(host, profile)
    if kind == "ur":
        from gensim2.deploy.drivers.ur import URArm

        return URArm(host, profile)
    from gensim2.deploy.drivers.xarm import XArm

    return XArm(host, profile)


class PolledCameras:
    """Cameras whose library is asked in a thread of its own, so that the loop waits for no picture.

    Args:
        driver: RealSense cameras, or another maker's.
    """

    def __init__(self, driver: Any) -> None:
        self._driver = driver
        self.cameras: tuple[Camera, ...] = driver.cameras
        self.serials: Mapping[str, str] = driver.serials
        self._frames: deque[Frame] = deque(maxlen=KEPT)
        self._over = False
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="cameras", daemon=True)
        self._thread.start()

    def poll(self) -> Sequence[Frame]:
        """Pictures that came.

        Raises:
            DeviceGoneError: the maker's library has failed.
        """
        from gensim2.deploy.line import DeviceGoneError

        if self._error is not None:
            raise DeviceGoneError(f"the cameras are gone: {self._error}") from self._error
        found = []
        while self._frames:
            found.append(self._frames.popleft())
        return found

    def close(self) -> None:
        """Leave the devices."""
        self._over = True
        self._thread.join(timeout=3.0)
        self._driver.close()

    def _run(self) -> None:
        try:
            while not self._over:
                self._frames.extend(self._driver.poll())
                time.sleep(POLL)
        except Exception as error:  # noqa: BLE001 - libraries raise what they like; the loop is told at its next look
            self._error = error


def open_cameras(source: CameraSource, there: Sequence[Camera], rate: float) -> PolledCameras:
    """Open RealSense cameras, or recordings of them.

    Args:
        source: with their devices or files.
        there: cameras by their names, with pixels and a first guess of their poses.
        rate: pictures a second; recordings give what they have.

    Raises:
        InputError: a name is none of theirs, or a file is no recording.
        MissingExtraError: the maker's library is not installed.
        DriverError: a device is not there.
    """
    from gensim2.deploy.drivers.realsense import RealSenseCameras, connected, recorded

    known = {camera.name: camera for camera in there}
    for name in source.devices:
        if name not in known:
            raise InputError(f"there is no camera {name!r}", field="--cameras", remedy=near(name, known))
    if source.kind == "recording":
        devices = recorded({name: Path(file) for name, file in source.devices.items()})
    else:
        devices = connected(source.devices)
    return PolledCameras(RealSenseCameras([known[name] for name in devices], devices, round(rate)))


class ByHand:
    """A table that a person sets and judges: nothing is known of the goal."""

    is_ready = True
    goal: bool | None = None

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """A person has laid everything out."""
