"""Frames, states and the interfaces of drivers; the keyboard of the person who stands by."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Literal, Protocol, Self

import numpy as np
import numpy.typing as npt

from gensim2.perception import Camera
from gensim2.robots import RobotProfile

Array = npt.NDArray[np.float64]

ArmMode = Literal["ready", "reflex", "refusing", "at-limit"]


@dataclass(frozen=True, eq=False)
class ArmState:
    """An arm at one instant.

    Attributes:
        time: at which it was measured, s.
        q: (n,) positions of all active joints, rad (m).
        v: (n,) their velocities, rad/s (m/s).
        force: that presses on the arm from outside, N.
        mode: ``"reflex"``: it has stopped by itself; ``"refusing"``: it takes no commands; ``"at-limit"``: a limit of
            its own keeps it from where it was sent.
        reason: why, where its library says something.
    """

    time: float
    q: Array
    v: Array
    force: float
    mode: ArmMode = "ready"
    reason: str = ""


@dataclass(frozen=True, eq=False)
class CameraFrame:
    """One picture of one camera.

    Attributes:
        camera: its name.
        number: counts its pictures.
        captured: at which it was taken, s.
        depth: (H, W) uint16, mm; 0 where nothing was measured.
        colors: (H, W, 3) uint8, RGB, brought onto the depth picture.
        serial: number of the device that took it, as the device itself says; empty: it says none.
    """

    camera: str
    number: int
    captured: float
    depth: npt.NDArray[np.uint16]
    colors: npt.NDArray[np.uint8]
    serial: str = ""


class ArmDriver(Protocol):
    """The wire to an arm. Nothing here waits."""

    profile: RobotProfile

    def poll(self) -> Sequence[ArmState]:
        """States that came since the last call, oldest first."""
        ...

    def send(self, q: Array, gripper: float, t: float) -> None:
        """Take targets for one instant.

        Args:
            q: (m,) of the arm's joints, rad (m).
            gripper: -1 (closed) to 1 (open).
            t: the instant, s.
        """
        ...

    def stand(self) -> None:
        """Stop at once by the arm's own means, and take no more targets until it is begun anew."""
        ...

    def close(self) -> None:
        """Release the resources."""
        ...


class CameraDriver(Protocol):
    """Cameras. Nothing here waits.

    Attributes:
        cameras: that there are; those that a link carries with their poses in its frame, the others in the base frame.
        serials: number of the device that each camera is, by its name; one that is not among them is not compared.
    """

    cameras: tuple[Camera, ...]
    serials: Mapping[str, str]

    def poll(self) -> Sequence[CameraFrame]:
        """Pictures that came since the last call, oldest first."""
        ...

    def close(self) -> None:
        """Give up what they hold."""
        ...


class Keys:
    """Keys as they are pressed, where there is a terminal; none where there is not."""

    def __init__(self) -> None:
        self._there = sys.stdin is not None and sys.stdin.isatty()

    @property
    def is_there(self) -> bool:
        """Whether a person could press any."""
        return self._there

    def __enter__(self) -> Self:
        if self._there:
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._there:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    @contextlib.contextmanager
    def let_go(self) -> Iterator[None]:
        """Give the terminal back while a block asks for whole lines."""
        if not self._there:
            yield
            return
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)
        try:
            yield
        finally:
            tty.setcbreak(sys.stdin)

    def pressed(self) -> str | None:
        """The next key; None: none was pressed."""
        if not self._there or not select.select([sys.stdin], [], [], 0.0)[0]:
            return None
        return os.read(sys.stdin.fileno(), 1).decode(errors="replace") or None
