"""Cameras that are a log: its pictures, again and again, at the times at which they were taken."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from gensim2.core.errors import InputError, near
from gensim2.perception import Camera
from gensim2_robot.devices import CameraFrame
from gensim2_robot.log_messages import PictureMessage
from gensim2_robot.log_reader import about_of, messages
from gensim2_robot.pipes import SLOTS

PAUSE = 0.1
"""Seconds from the last picture of a log to its first one again."""


def is_log(path: Path) -> bool:
    """Whether it is a log of the line, or a file of one, by its name."""
    return path.is_dir() or path.suffix == ".mcap"


class LoggedCameras:
    """Cameras of which a log has the pictures.

    Cameras of one log keep the times between their pictures. When one of them is over, all begin again.

    Args:
        cameras: that are wanted, of whom the names count.
        logs: folder of a run, or an MCAP file of one, by camera.

    Attributes:
        cameras: as the log has them: pixels, intrinsics, poses.
        serials: numbers of the devices that took the pictures.

    Raises:
        InputError: there is no such log, it is damaged, or has no pictures of a camera.
        MissingExtraError: mcap is not installed.
    """

    def __init__(self, cameras: Sequence[Camera], logs: Mapping[str, Path]) -> None:
        self._logs = {camera.name: logs[camera.name] for camera in cameras}
        found = []
        for name, path in self._logs.items():
            field = f"cameras.{name}"
            if not path.exists():
                raise InputError("there is no such recording", file=path, field=field)
            known = {each.name: each for each in about_of(path).cameras}
            if name not in known:
                raise InputError(f"there is no camera {name!r}", file=path, field=field, remedy=near(name, known))
            found.append(known[name].camera())
        self.cameras = tuple(found)
        self._number = dict.fromkeys(self._logs, 0)
        self._begin(time.monotonic())
        self.serials = {name: frame.serial for name, frame in self._next.items()}

    def _begin(self, at: float) -> None:
        self._films = {name: _pictures(path, name) for name, path in self._logs.items()}
        self._next = {name: next(film) for name, film in self._films.items()}
        first: dict[Path, float] = {}
        for name, path in self._logs.items():
            taken = self._next[name].captured
            first[path] = min(taken, first.get(path, taken))
        self._later = {name: at - first[path] for name, path in self._logs.items()}

    def poll(self) -> Sequence[CameraFrame]:
        """Pictures whose time has come, oldest first; of each camera the newest that there is room for.

        Raises:
            InputError: the log is damaged.
        """
        now, over = time.monotonic(), False
        found: list[CameraFrame] = []
        for name in self._logs:
            newest = deque[CameraFrame](maxlen=SLOTS)
            while (frame := self._next[name]).captured + self._later[name] <= now:
                captured = frame.captured + self._later[name]
                newest.append(CameraFrame(name, self._number[name], captured, frame.depth, frame.colors, frame.serial))
                self._number[name] += 1
                after = next(self._films[name], None)
                if after is None:
                    over = True
                    break
                self._next[name] = after
            found += newest
        if over:
            self._begin(now + PAUSE)
        return sorted(found, key=lambda each: each.captured)

    def close(self) -> None:
        """Leave the files."""
        self._films.clear()


def _pictures(path: Path, name: str) -> Iterator[CameraFrame]:
    """Pictures of a camera, one at least.

    Raises:
        InputError: there is none, or the log is damaged.
    """
    empty = True
    for _, message in messages(path):
        if isinstance(message, PictureMessage) and message.camera == name:
            empty = False
            yield message.frame()
    if empty:
        raise InputError("has no picture of it", file=path, field=f"cameras.{name}")
