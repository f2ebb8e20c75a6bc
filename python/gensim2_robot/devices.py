"""Define arm states, camera images, the interfaces of drivers, and the operator's keyboard."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, Self

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.perception import Camera
from gensim2.robots import RobotProfile

ArmMode = Literal["ready", "reflex", "refusing", "at-limit"]


@dataclass(frozen=True, eq=False)
class ArmState:
    """State of an arm at one instant.

    Attributes:
        time: time of the measurement, s.
        q: (n,) positions of all active joints, rad or m.
        v: (n,) velocities, rad/s or m/s.
        force: contact force, N.
        mode: ``"reflex"``: the arm's own safety has stopped it; ``"refusing"``: it accepts no commands; ``"at-limit"``:
            it is at a limit of its own.
        reason: reason for the mode, as reported by the arm's library; may be empty.
    """

    time: float
    q: Array
    v: Array
    force: float
    mode: ArmMode = "ready"
    reason: str = ""


@dataclass(frozen=True, eq=False)
class CameraFrame:
    """An image of one camera.

    Attributes:
        number: number of the image.
        captured: time when the image was taken, s.
        depth: (H, W) uint16, mm; 0 for no measurement.
        colors: (H, W, 3) uint8, RGB, aligned with the depth image.
        serial: serial number that the device reported; empty if it reported no number.
    """

    camera: str
    number: int
    captured: float
    depth: npt.NDArray[np.uint16]
    colors: npt.NDArray[np.uint8]
    serial: str = ""


class ArmDriver(Protocol):
    """Interface of a connection to an arm. Its methods never block."""

    profile: RobotProfile

    def poll(self) -> Sequence[ArmState]:
        """Return the states received since the last call, oldest first."""
        ...

    def send(self, q: Array, gripper: float, t: float) -> None:
        """Send the arm and the gripper targets that they should reach at the time ``t``.

        Args:
            q: (m,) joints of the arm, rad or m.
            gripper: gripper command, -1 (closed) to 1 (open).
            t: time of the targets, s.
        """
        ...

    def stand(self) -> None:
        """Stop the arm through its own controller. Targets are refused until the next episode starts."""
        ...

    def close(self) -> None:
        """Release the resources."""
        ...


class CameraDriver(Protocol):
    """Interface of a connection to cameras. Its methods never block.

    Attributes:
        cameras: cameras with their poses, in the frame of their link or in the base frame.
        serials: expected serial number by camera name; cameras that are not listed are not checked.
    """

    cameras: tuple[Camera, ...]
    serials: Mapping[str, str]

    def poll(self) -> Sequence[CameraFrame]:
        """Return the images received since the last call, oldest first."""
        ...

    def close(self) -> None:
        """Release the devices."""
        ...


class Keys:
    """Reads single key presses, if there is a terminal."""

    def __init__(self) -> None:
        self._there = sys.stdin is not None and sys.stdin.isatty()

    @property
    def is_there(self) -> bool:
        """Whether a terminal is available."""
        return self._there

    def __enter__(self) -> Self:
        if self._there:
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(self, *_: object) -> None:
        if self._there:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    @contextlib.contextmanager
    def let_go(self) -> Iterator[None]:
        """Restore the terminal's line mode within the ``with`` block, so that a person can enter lines."""
        if not self._there:
            yield
            return
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)
        try:
            yield
        finally:
            tty.setcbreak(sys.stdin)

    def pressed(self) -> str | None:
        """Return the next key, or None."""
        if not self._there or not select.select([sys.stdin], [], [], 0.0)[0]:
            return None
        return os.read(sys.stdin.fileno(), 1).decode(errors="replace") or None
