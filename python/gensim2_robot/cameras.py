"""Cameras in a process of their own, whose pictures come through shared memory.

Nothing of a maker's library runs beside the loop: what it computes, and how long it holds the interpreter, keeps no
cycle waiting. A process that ends, or is ended, is a device that is gone.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from typing import Any

from gensim2.core.errors import GenSim2Error
from gensim2.perception import Camera
from gensim2_robot.devices import Frame
from gensim2_robot.picture_slots import PictureSlots
from gensim2_robot.pipes import DeviceGoneError
from gensim2_robot.processes import DeviceProcess

OPENING = 60.0
"""Seconds within which cameras must be open."""
POLL = 0.002
"""Seconds between two looks for pictures."""


class ProcessCameras:
    """Cameras in a process of their own.

    Args:
        make: makes their driver there: ``cameras``, ``serials``, ``poll()``, ``close()``, and ``fail(fault)`` where it
            can be told to.
        arguments: of ``make``; all of it must travel to another process.

        interrupted: numbers of signals that have asked to stop; once there is one, opening ends.

    Attributes:
        cameras: that there are, as their driver says.
        serials: numbers of their devices, by name.

    Raises:
        GenSim2Error: as ``make`` raises it.
        DeviceGoneError: ``make`` raises anything else, the process has ended, the cameras are not open within 60 s, or
            a signal asked to stop.
    """

    def __init__(self, make: Callable[..., Any], *arguments: Any, interrupted: Sequence[int] = ()) -> None:
        self._process = DeviceProcess("cameras", _serve, make, *arguments)
        try:
            (room, serials), *self._early = self._opened(interrupted)
        except GenSim2Error:
            self._process.kill()
            self._process.close()
            raise
        self.cameras: tuple[Camera, ...] = room.cameras
        self.serials: Mapping[str, str] = serials
        self._slots = PictureSlots.enter(room)

    def _opened(self, interrupted: Sequence[int]) -> list[Any]:
        """Wait for the first messages."""
        until = time.monotonic() + OPENING
        while not (found := self._process.drain()):
            if interrupted:
                name = signal.Signals(interrupted[0]).name
                raise DeviceGoneError(f"a person or the system asked to stop while the cameras were opened: {name}")
            if time.monotonic() > until:
                raise DeviceGoneError(f"the cameras did not open within {OPENING:g} s")
            time.sleep(POLL)
        return found

    def poll(self) -> Sequence[Frame]:
        """Return the pictures that came.

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
        """Let them fail from now on."""
        self._process.tell(fault)

    def close(self) -> None:
        """End the process."""
        self._process.close()
        self._slots.close()


def _serve(pipe: Connection, make: Callable[..., Any], *arguments: Any) -> None:
    try:
        driver = make(*arguments)
    except GenSim2Error:
        raise
    except Exception as error:  # libraries raise what they like
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
    except Exception as error:  # libraries raise what they like
        raise DeviceGoneError(f"the cameras are gone: {error}") from error
    finally:
        driver.close()
