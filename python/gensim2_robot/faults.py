"""Inject faults into simulated devices to test the watchdog. A fault starts at a given time and persists."""

from __future__ import annotations

import errno
import io
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal, cast, get_args

from gensim2.core.errors import InputError, near

FaultName = Literal[
    "camera-frozen",
    "camera-late",
    "camera-unplugged",
    "camera-torn",
    "camera-clock",
    "camera-swapped",
    "camera-mislabelled",
    "policy-killed",
    "policy-nan",
    "policy-slow",
    "policy-garbage",
    "policy-token",
    "arm-reflex",
    "arm-lagging",
    "arm-silent",
    "arm-refusing",
    "arm-at-limit",
    "disk-full",
]
FAULTS: tuple[FaultName, ...] = get_args(FaultName)


@dataclass(frozen=True)
class Fault:
    """An injected fault.

    Attributes:
        at: time from the first action of the run to the start of the fault, s.
    """

    name: FaultName
    at: float

    @property
    def kind(self) -> str:
        """Kind of the failing device: ``camera``, ``policy``, ``arm`` or ``disk``."""
        return self.name.partition("-")[0]

    @staticmethod
    def parse(text: str) -> Fault:
        """Parse ``NAME@SECONDS``.

        Raises:
            InputError: the fault is unknown, or the time is invalid.
        """
        name, _, at = text.partition("@")
        if name not in FAULTS:
            raise InputError(f"unknown fault {name!r}", field="--fault", remedy=near(name, FAULTS))
        try:
            seconds = float(at)
        except ValueError:
            seconds = math.nan
        if not 0.0 <= seconds < 1e6:
            raise InputError(f"{text!r} has no valid time", field="--fault", remedy="for example camera-frozen@3.5")
        return Fault(name, seconds)


class FullDisk:
    """A simulated disk.

    When it becomes full, the next write fails. Afterwards the space that the log had reserved can be used.

    Attributes:
        full: whether the disk is full.
    """

    def __init__(self) -> None:
        self.full = False
        self._room: int | None = None

    def open(self, path: Path) -> BinaryIO:
        """Open a new file on this disk."""
        return cast(BinaryIO, _FileOnFullDisk(self, path))

    def take(self, size: int) -> None:
        """Use ``size`` bytes of the simulated disk.

        Raises:
            OSError: the disk is full.
        """
        if not self.full:
            return
        if self._room is None or self._room < size:
            from gensim2_robot.log import RESERVE

            self._room = RESERVE if self._room is None else self._room
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._room -= size


class _FileOnFullDisk(io.FileIO):
    def __init__(self, disk: FullDisk, path: Path) -> None:
        super().__init__(path, "x")
        self._disk = disk

    def write(self, data: Any) -> int:
        self._disk.take(len(data))
        return super().write(data) or 0
