"""Faults of simulated devices, to see what the watch makes of them. Each begins at its time and lasts."""

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
    """One fault.

    Attributes:
        name: which.
        at: seconds from the first action of the run on; a fault lasts from then.
    """

    name: FaultName
    at: float

    @property
    def kind(self) -> str:
        """Kind of the device that fails: ``camera``, ``policy``, ``arm`` or ``disk``."""
        return self.name.partition("-")[0]

    @staticmethod
    def parse(text: str) -> Fault:
        """A fault from ``NAME@SECONDS``.

        Raises:
            InputError: there is none of that name, or no such time.
        """
        name, _, at = text.partition("@")
        if name not in FAULTS:
            raise InputError(f"no fault {name!r}", field="--fault", remedy=near(name, FAULTS))
        try:
            seconds = float(at)
        except ValueError:
            seconds = math.nan
        if not 0.0 <= seconds < 1e6:
            raise InputError(f"{text!r} says no time", field="--fault", remedy="as camera-frozen@3.5")
        return Fault(name, seconds)


class FullDisk:
    """A disk that can be full: then one write fails, and after it there is the room that the log kept aside.

    Attributes:
        full: whether it is.
    """

    def __init__(self) -> None:
        self.full = False
        self._room: int | None = None

    def open(self, path: Path) -> BinaryIO:
        """A new file on this disk."""
        return cast(BinaryIO, _FileOnFullDisk(self, path))

    def take(self, size: int) -> None:
        """Take room for ``size`` bytes.

        Raises:
            OSError: there is none.
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
