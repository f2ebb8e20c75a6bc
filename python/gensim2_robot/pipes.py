"""Exchange data with device processes. Messages go through pipes, and images through shared memory."""

from __future__ import annotations

import os
import pickle
import struct
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error
from gensim2.perception import Camera
from gensim2_robot.devices import CameraFrame

MAX_WAITING = 500
"""Maximum number of messages that wait in addition to those in the kernel's buffer. The loop sends 100 per second."""
CHUNK = 1 << 16
MAX_CHUNKS = 256
"""Maximum number of bytes and of reads in one poll, so that a flood of messages does not delay the loop."""
_LENGTH = struct.Struct("!i")
_LONG = struct.Struct("!Q")


class DeviceGoneError(GenSim2Error):
    """The process of a device has ended or does not answer."""


class MessagePipe:
    """One end of a pipe between two processes. The methods of this class never block.

    The pipe replaces ``Connection``, which can wait forever for a suspended process: ``send`` if the buffer is full,
    and ``recv`` for the rest of a message. The other end may still be a ``Connection``.

    Args:
        connection: connection of this end.
        what: name of the other end for error messages.
    """

    def __init__(self, connection: Connection, what: str) -> None:
        self._connection, self._what = connection, what
        os.set_blocking(connection.fileno(), False)
        self._came = bytearray()
        self._going: deque[memoryview] = deque()
        self._is_over = self._is_stuck = False

    def tell(self, message: Any) -> None:
        """Send a message. If sending fails, the next call of :meth:`drain` raises an error."""
        if self._is_over or self._is_stuck:
            return
        if len(self._going) >= MAX_WAITING:
            self._is_stuck = True
            return
        data = bytes(ForkingPickler.dumps(message))
        head = _LENGTH.pack(len(data)) if len(data) < 1 << 31 else _LENGTH.pack(-1) + _LONG.pack(len(data))
        self._going.append(memoryview(head + data))
        self._flush()

    def drain(self) -> list[Any]:
        """Return the complete messages that have arrived.

        Raises:
            DeviceGoneError: the other process has ended, or does not read the messages sent to it.
        """
        self._flush()
        self._read()
        if self._is_stuck:
            raise DeviceGoneError(f"the process of the {self._what} does not answer")
        found = []
        while (message := self._next()) is not None:
            # Unpickling is safe, because the message comes from a process that this program has started.
            found.append(pickle.loads(message))
        if not found and self._is_over:
            raise DeviceGoneError(f"the process of the {self._what} has ended")
        return found

    def close(self) -> None:
        self._is_over = True
        self._connection.close()

    def _flush(self) -> None:
        try:
            while self._going and not self._is_over:
                sent = os.write(self._connection.fileno(), self._going[0])
                if sent < len(self._going[0]):
                    self._going[0] = self._going[0][sent:]
                else:
                    self._going.popleft()
        except BlockingIOError:
            return
        except OSError:  # the process has ended, but its last messages can still be read
            self._going.clear()

    def _read(self) -> None:
        try:
            for _ in range(0 if self._is_over else MAX_CHUNKS):
                data = os.read(self._connection.fileno(), CHUNK)
                self._came += data
                if not data:
                    self._is_over = True
                    return
        except BlockingIOError:
            return
        except OSError:
            self._is_over = True

    def _next(self) -> bytes | None:
        """Return the next message; None if no message has arrived completely."""
        if len(self._came) < _LENGTH.size:
            return None
        (length,), begin = _LENGTH.unpack_from(self._came), _LENGTH.size
        if length == -1:
            if len(self._came) < begin + _LONG.size:
                return None
            (length,), begin = _LONG.unpack_from(self._came, begin), begin + _LONG.size
        if len(self._came) < begin + length:
            return None
        found = bytes(self._came[begin : begin + length])
        del self._came[: begin + length]
        return found


SLOTS = 6
"""Number of images of each camera that may wait for the reader; additional images are dropped."""
BYTES = 5
"""Bytes per pixel, for depth and colours."""


@dataclass(frozen=True)
class Room:
    """Description of shared memory for images. The description can be sent to another process.

    Attributes:
        cameras: cameras whose images the memory contains.
        name: name of the shared memory.
    """

    cameras: tuple[Camera, ...]
    name: str


@dataclass(frozen=True)
class SharedPicture:
    """Image in shared memory, which is valid until its slot is returned. The fields are as in :class:`CameraFrame`."""

    camera: str
    slot: int
    number: int
    captured: float
    serial: str


class PictureSlots:
    """Gives a process access to images in shared memory. The memory is divided into slots, each for one image.

    A slot first belongs to the writer, which fills it and sends a message. Then it belongs to the reader until it
    returns the slot.

    The creator sends the name of the memory. The other process opens the memory and deletes the name. The memory is
    thus freed together with its last process, even if this process is killed.
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
        """Create shared memory.

        Return the access of this process, and a description with which another process can open the memory.

        Raises:
            GenSim2Error: the machine has too little shared memory.
        """
        size = max(1, SLOTS * sum(map(_bytes, cameras)))
        try:
            memory = SharedMemory(create=True, size=size)
            try:
                # Allocate the memory now. Otherwise, if /dev/shm is full, a later write would kill the loop with
                # SIGBUS.
                os.posix_fallocate(memory._fd, 0, size)  # type: ignore[attr-defined]
            except OSError:
                memory.close()
                memory.unlink()
                raise
        except OSError as error:
            needed = f"{size / 1e6:.1f} MB of shared memory for camera images cannot be allocated"
            raise GenSim2Error(f"{needed}: {error.strerror} (delete files in /dev/shm)") from error
        return cls(cameras, memory), Room(tuple(cameras), memory.name)

    @classmethod
    def enter(cls, room: Room) -> PictureSlots:
        """Open memory that another process has created."""
        memory = SharedMemory(room.name)
        memory.unlink()
        return cls(room.cameras, memory)

    def put(self, frame: CameraFrame) -> SharedPicture | None:
        """Copy an image into a free slot; return None if no slot is free.

        Raises:
            GenSim2Error: the image does not have the size of its camera.
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

    def take(self, picture: SharedPicture) -> CameraFrame:
        """Return a copy of an image; afterwards the caller must return the slot."""
        depth, colors = self._slots[picture.camera][picture.slot]
        return CameraFrame(
            picture.camera, picture.number, picture.captured, depth.copy(), colors.copy(), picture.serial
        )

    def free(self, picture: SharedPicture) -> None:
        self._free[picture.camera].append(picture.slot)

    def close(self) -> None:
        self._slots.clear()
        self._memory.close()


def _bytes(camera: Camera) -> int:
    """Return the size of a slot in bytes, which is even so that 2-byte depth values stay aligned."""
    pixels = camera.height * camera.width
    return BYTES * pixels + pixels % 2
