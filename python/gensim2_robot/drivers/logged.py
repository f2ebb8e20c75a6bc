"""Replay the camera images of a log in a loop, with the recorded timing."""

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
"""Pause (s) between the last image of a log and the first image of its next repetition."""


def is_log(path: Path) -> bool:
    """Return whether a path is a log folder, or has the name of an MCAP file."""
    return path.is_dir() or path.suffix == ".mcap"


class LoggedCameras:
    """Cameras that replay the images of a log.

    Cameras of one log keep their relative timing. When one camera reaches the end of the log, all cameras start again.

    Args:
        cameras: requested cameras. Only their names are used; all other properties come from the log.
        logs: folder of a run, or an MCAP file, for each camera name.

    Attributes:
        cameras: cameras with the image sizes, intrinsics and poses that are stored in the log.
        serials: serial numbers of the recorded devices, by camera name.

    Raises:
        InputError: the log is missing or damaged, or has no images of a camera.
        MissingExtraError: mcap is not installed.
    """

    def __init__(self, cameras: Sequence[Camera], logs: Mapping[str, Path]) -> None:
        self._logs = {camera.name: logs[camera.name] for camera in cameras}
        found = []
        for name, path in self._logs.items():
            field = f"cameras.{name}"
            if not path.exists():
                raise InputError("the recording does not exist", file=path, field=field)
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
        """Return the images that are due, oldest first.

        If they are more than the buffer stores, return the newest ones.

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
        self._films.clear()


def _pictures(path: Path, name: str) -> Iterator[CameraFrame]:
    """Yield the images of a camera. Raise InputError if the log has none or is damaged."""
    empty = True
    for _, message in messages(path):
        if isinstance(message, PictureMessage) and message.camera == name:
            empty = False
            yield message.frame()
    if empty:
        raise InputError("the log has no picture of this camera", file=path, field=f"cameras.{name}")
