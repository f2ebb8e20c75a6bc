"""Pictures in memory that two processes share: what goes through their pipe is short, and neither waits for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.shared_memory import SharedMemory

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error
from gensim2.perception import Camera
from gensim2_robot.devices import Frame

SLOTS = 6
"""Pictures of a camera that may wait for their reader; what comes while so many wait is dropped."""
BYTES = 5
"""Of a pixel: depth and colours."""


@dataclass(frozen=True)
class Room:
    """Memory for pictures; travels to the process that enters it.

    Attributes:
        cameras: whose pictures they are.
        name: of the memory.
    """

    cameras: tuple[Camera, ...]
    name: str


@dataclass(frozen=True)
class SharedPicture:
    """A picture that lies in a slot until the slot is given back; the rest as a :class:`Frame` has it."""

    camera: str
    slot: int
    number: int
    captured: float
    serial: str


class PictureSlots:
    """One side of the memory.

    A slot belongs to one process at a time: to the reader from the message that a picture lies in it until the message
    that gives it back. Whoever makes the memory says its name to the other; that it is called so is forgotten as soon
    as both have it, and it goes with the last of them, whatever ends that.
    """

    def __init__(self, cameras: Sequence[Camera], memory: SharedMemory) -> None:
        self._memory = memory
        self._slots: dict[str, list[tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint8]]]] = {}
        begin = 0
        for camera in cameras:
            shape, pixels = (camera.height, camera.width), camera.height * camera.width
            self._slots[camera.name] = []
            for _ in range(SLOTS):
                depth: npt.NDArray[np.uint16] = np.ndarray(shape, np.uint16, memory.buf, begin)
                colors: npt.NDArray[np.uint8] = np.ndarray((*shape, 3), np.uint8, memory.buf, begin + 2 * pixels)
                self._slots[camera.name].append((depth, colors))
                begin += _bytes(camera)
        self._free = {camera.name: list(range(SLOTS)) for camera in cameras}

    @classmethod
    def make(cls, cameras: Sequence[Camera]) -> tuple[PictureSlots, Room]:
        """Make the memory; returns what the other process needs to enter it."""
        memory = SharedMemory(create=True, size=max(1, SLOTS * sum(map(_bytes, cameras))))
        return cls(cameras, memory), Room(tuple(cameras), memory.name)

    @classmethod
    def enter(cls, room: Room) -> PictureSlots:
        """Enter what another process has made."""
        memory = SharedMemory(room.name)
        memory.unlink()
        return cls(room.cameras, memory)

    def put(self, frame: Frame) -> SharedPicture | None:
        """Put a picture into a slot; None where all of them wait.

        Raises:
            GenSim2Error: it has another size than its camera.
        """
        free = self._free[frame.camera]
        if not free:
            return None
        depth, colors = self._slots[frame.camera][free[-1]]
        if (frame.depth.shape, frame.colors.shape) != (depth.shape, colors.shape):
            said = f"depth is {frame.depth.shape}, colours are {frame.colors.shape}, must be {colors.shape}"
            raise GenSim2Error(f"camera {frame.camera}: {said}")
        depth[...], colors[...] = frame.depth, frame.colors
        return SharedPicture(frame.camera, free.pop(), frame.number, frame.captured, frame.serial)

    def take(self, picture: SharedPicture) -> Frame:
        """Return a copy of a picture; its slot is to be given back."""
        depth, colors = self._slots[picture.camera][picture.slot]
        return Frame(picture.camera, picture.number, picture.captured, depth.copy(), colors.copy(), picture.serial)

    def free(self, picture: SharedPicture) -> None:
        """Its slot was given back."""
        self._free[picture.camera].append(picture.slot)

    def close(self) -> None:
        """Leave the memory."""
        self._slots.clear()
        self._memory.close()


def _bytes(camera: Camera) -> int:
    """Bytes of a slot; depth begins at an even one."""
    pixels = camera.height * camera.width
    return BYTES * pixels + pixels % 2
