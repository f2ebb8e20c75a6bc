"""Camera drivers for a subprocess: fakes, and software devices of the RealSense library."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from gensim2.core.errors import InputError
from gensim2.perception import Camera
from gensim2.robots import robot
from gensim2_robot.devices import CameraFrame
from gensim2_robot.pipes import PictureSlots
from gensim2_robot.simulated import simulated_cameras

SERIAL = "827112070000"
LEFT = replace(simulated_cameras(robot("panda"), 32, 24)[0], name="left")


def picture(number: int, camera: Camera = LEFT) -> tuple[np.ndarray, np.ndarray]:
    """Return depth and colours of a fake image; all images differ."""
    draw, shape = np.random.default_rng(number), (camera.height, camera.width)
    return draw.integers(300, 900, shape).astype(np.uint16), draw.integers(0, 256, (*shape, 3)).astype(np.uint8)


class Fake:
    """A fake that gives three images at a time; ``broken``: its library fails; ``large``: its images grow."""

    def __init__(self, *cameras: Camera) -> None:
        self.cameras, self.serials = cameras, {camera.name: SERIAL for camera in cameras}
        self._number, self._fault = 0, ""

    def poll(self) -> list[CameraFrame]:
        if self._fault == "broken":
            raise RuntimeError("xioctl(VIDIOC_DQBUF) failed")
        found = []
        for _ in range(3):
            for camera in self.cameras:
                given = replace(camera, width=64) if self._fault == "large" else camera
                found.append(
                    CameraFrame(camera.name, self._number, 10.0 + self._number, *picture(self._number, given), SERIAL)
                )
            self._number += 1
        return found

    def fail(self, fault: str) -> None:
        self._fault = fault

    def close(self) -> None: ...


def refused(*_: Any) -> Any:
    """Raise the error of cameras that cannot be opened."""
    raise InputError("is no recording of a RealSense", file="left.db3", field="cameras.left")


class Filmed:
    """A software device of the real library that gives a new image every 50 ms."""

    def __init__(self, *_: Any) -> None:
        from gensim2_robot.drivers.realsense import RealSenseCameras, SoftwareDevice

        self._device = SoftwareDevice(LEFT, SERIAL, 20)
        self._driver = RealSenseCameras([LEFT], {"left": self._device.device}, 20)
        self.cameras, self.serials = self._driver.cameras, self._driver.serials
        self._number, self._due = 0, time.monotonic()

    def poll(self) -> Sequence[CameraFrame]:
        if (now := time.monotonic()) >= self._due:
            self._device.give(CameraFrame("left", self._number, now, *picture(self._number)))
            self._number, self._due = self._number + 1, self._due + 0.05
        return self._driver.poll()

    def close(self) -> None:
        self._driver.close()


def repeat(pipe: Connection, count: int, size: int) -> None:
    """Send large messages, and then echo what arrives."""
    for _ in range(count):
        pipe.send(bytes(size))
    while (message := pipe.recv()) is not None:
        pipe.send(message)


def announce(pipe: Connection, *_: object) -> None:
    """Announce shared memory, and end on request."""
    _, room = PictureSlots.make(())
    pipe.send(room)
    pipe.recv()
