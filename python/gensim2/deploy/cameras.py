"""Cameras in a process of their own, whose pictures come through shared memory.

Nothing of a maker's library runs beside the loop: what it computes, and how long it holds the interpreter, keeps no
cycle waiting. A process that ends, or is ended, is a device that is gone.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from typing import Any

from gensim2.deploy.devices import Frame
from gensim2.deploy.line import DeviceGoneError
from gensim2.deploy.picture_slots import PictureSlots
from gensim2.deploy.processes import DeviceProcess
from gensim2.errors import GenSim2Error
from gensim2.observations import Camera

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

    Attributes:
        cameras: that there are, as their driver says.
        serials: numbers of their devices, by name.

    Raises:
        GenSim2Error: as ``make`` raises it.
        DeviceGoneError: ``make`` raises anything else, or the cameras are not open within 60 s.
    """

    def __init__(self, make: Callable[..., Any], *arguments: Any) -> None:
        self._process = DeviceProcess("cameras", _serve, make, *arguments)
        try:
            if not self._process.pipe.poll(OPENING):
                raise DeviceGoneError(f"the cameras did not open within {OPENING:g} s")
            ((room, serials),) = self._process.drain(1)
        except GenSim2Error:
            self._process.kill()
            self._process.close()
            raise
        self.cameras: tuple[Camera, ...] = room.cameras
        self.serials: Mapping[str, str] = serials
        self._slots = PictureSlots.enter(room)

    def poll(self) -> Sequence[Frame]:
        """Pictures that came.

        Raises:
            DeviceGoneError: the driver has failed, or the process has ended.
        """
        found = []
        for picture in self._process.drain():
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
