"""Cameras in a process of their own, whose pictures come through shared memory.

Nothing of a maker's library runs beside the loop: what it computes, and how long it holds the interpreter, keeps no
cycle waiting. A process that ends, or is ended, is a device that is gone.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.deploy.devices import Frame
from gensim2.deploy.line import DeviceGoneError
from gensim2.deploy.processes import DeviceProcess
from gensim2.errors import GenSim2Error
from gensim2.observations import Camera

OPENING = 60.0
"""Seconds within which cameras must be open."""
POLL = 0.002
"""Seconds between two looks for pictures."""
SLOTS = 6
"""Pictures of a camera that may wait for the loop; what comes while so many wait is dropped."""
BYTES = 5
"""Of a pixel: depth and colours."""


class ProcessCameras:
    """Cameras in a process of their own.

    Args:
        make: makes their driver there: ``cameras``, ``serials``, ``poll()``, ``close()``, and ``fail(fault)`` where it
            can be told to.
        arguments: of ``make``; all of it must travel to another process.

    Attributes:
        cameras: that there are, as their driver says.
        serials: numbers of their devices, by name.

    Raises:
        GenSim2Error: whatever ``make`` raises.
        DeviceGoneError: the cameras are not open within 60 s.
    """

    def __init__(self, make: Callable[..., Any], *arguments: Any) -> None:
        self._process = DeviceProcess("cameras", _serve, make, *arguments)
        try:
            if not self._process.pipe.poll(OPENING):
                raise DeviceGoneError(f"the cameras did not open within {OPENING:g} s")
            (opened,) = self._process.drain(1)
        except GenSim2Error:
            self._process.kill()
            self._process.close()
            raise
        self.cameras: tuple[Camera, ...] = opened.cameras
        self.serials: Mapping[str, str] = opened.serials
        self._slots = _Slots(self.cameras, SharedMemory(opened.memory))
        self._slots.memory.unlink()  # it goes with the last process that has it open, whatever ends that

    def poll(self) -> Sequence[Frame]:
        """Pictures that came.

        Raises:
            DeviceGoneError: the driver has failed, or the process has ended.
        """
        found = []
        for put in self._process.drain():
            found.append(self._slots.take(put))
            self._process.tell((put.camera, put.slot))
        return found

    def fail(self, fault: str) -> None:
        """Let them fail from now on."""
        self._process.tell(fault)

    def close(self) -> None:
        """End the process."""
        self._process.close()
        self._slots.close()


@dataclass(frozen=True)
class _Opened:
    """What a driver says once: its cameras, and the name of the memory that its pictures will be in."""

    cameras: tuple[Camera, ...]
    serials: Mapping[str, str]
    memory: str


@dataclass(frozen=True)
class _Put:
    """A picture that lies in a slot until the slot is given back."""

    camera: str
    slot: int
    number: int
    captured: float
    serial: str


class _Slots:
    """Room for pictures in memory that two processes share.

    A slot belongs to one of them at a time: to the reader from the message that a picture lies in it until the message
    that gives it back.

    Args:
        cameras: whose pictures they are.
        memory: of all slots.
    """

    def __init__(self, cameras: Sequence[Camera], memory: SharedMemory) -> None:
        self.memory = memory
        self._views: dict[str, list[tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint8]]]] = {}
        begin = 0
        for camera in cameras:
            shape, pixels = (camera.height, camera.width), camera.height * camera.width
            self._views[camera.name] = []
            for _ in range(SLOTS):
                depth: npt.NDArray[np.uint16] = np.ndarray(shape, np.uint16, memory.buf, begin)
                colors: npt.NDArray[np.uint8] = np.ndarray((*shape, 3), np.uint8, memory.buf, begin + 2 * pixels)
                self._views[camera.name].append((depth, colors))
                begin += BYTES * pixels + pixels % 2  # depth lies at even places
        self._free = {camera.name: list(range(SLOTS)) for camera in cameras}

    @staticmethod
    def size(cameras: Sequence[Camera]) -> int:
        """Bytes of memory for pictures of these cameras."""
        pixels = [camera.height * camera.width for camera in cameras]
        return max(1, SLOTS * sum(BYTES * each + each % 2 for each in pixels))

    def put(self, frame: Frame) -> _Put | None:
        """Put a picture into a slot; None where all of them wait.

        Raises:
            DeviceGoneError: it has another size than its camera.
        """
        free = self._free[frame.camera]
        if not free:
            return None
        depth, colors = self._views[frame.camera][free[-1]]
        if (frame.depth.shape, frame.colors.shape) != (depth.shape, colors.shape):
            said = f"depth is {frame.depth.shape}, colours are {frame.colors.shape}, must be {colors.shape}"
            raise DeviceGoneError(f"camera {frame.camera}: {said}")
        depth[...], colors[...] = frame.depth, frame.colors
        return _Put(frame.camera, free.pop(), frame.number, frame.captured, frame.serial)

    def take(self, put: _Put) -> Frame:
        """Return a copy of a picture."""
        depth, colors = self._views[put.camera][put.slot]
        return Frame(put.camera, put.number, put.captured, depth.copy(), colors.copy(), put.serial)

    def give_back(self, camera: str, slot: int) -> None:
        """A slot is free again."""
        self._free[camera].append(slot)

    def close(self) -> None:
        """Leave the memory."""
        self._views.clear()
        self.memory.close()


def _serve(pipe: Connection, make: Callable[..., Any], *arguments: Any) -> None:
    driver = make(*arguments)
    slots: _Slots | None = None
    try:
        slots = _Slots(driver.cameras, SharedMemory(create=True, size=_Slots.size(driver.cameras)))
        pipe.send(_Opened(driver.cameras, driver.serials, slots.memory.name))
        while True:
            while pipe.poll():
                message = pipe.recv()
                if message is None:
                    return
                if isinstance(message, str):
                    driver.fail(message)
                else:
                    slots.give_back(*message)
            for frame in driver.poll():
                put = slots.put(frame)
                if put is not None:
                    pipe.send(put)
            time.sleep(POLL)
    except (EOFError, ConnectionError, DeviceGoneError):
        raise
    except Exception as error:  # libraries raise what they like
        raise DeviceGoneError(f"the cameras are gone: {error}") from error
    finally:
        driver.close()
        if slots is not None:
            slots.close()
