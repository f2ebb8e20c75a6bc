"""Log all observations, requests, answers, commands and watchdog states to MCAP files.

When a file has a given size, it is closed and a new file is started. When the folder reaches its limit, the oldest
files are removed.

A full disk ends the log without damage, because space for closing a file is reserved in a file without a name. The
operating system removes this file even if the run is killed.
"""

from __future__ import annotations

import contextlib
import errno
import os
import queue
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np

from gensim2.core.errors import InputError, WriteError
from gensim2.core.foreign.limits import MAX_MESSAGE
from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.limits import Sent
from gensim2_robot.log_messages import About, pack
from gensim2_robot.mind import ControllerAnswer, Question


class Journal(Protocol):
    """Interface of a log of a run, whose methods never block."""

    @property
    def trouble(self) -> str | None:
        """Reason why logging has failed; None while it works."""
        ...

    def state(self, state: ArmState) -> None: ...
    def frame(self, frame: CameraFrame) -> None: ...
    def sent(self, time: float, sent: Sent, gripper: float) -> None: ...
    def question(self, time: float, question: Question) -> None: ...
    def answer(self, time: float, answer: ControllerAnswer) -> None: ...
    def change(self, time: float, state: str, reason: str) -> None: ...
    def clocks(self, time: float, late: float, ages: dict[str, float]) -> None: ...


class Journals:
    """Object that passes data on to several logs and raises their errors.

    Args:
        several: logs, which get the data in this order.
    """

    def __init__(self, several: Sequence[Journal] = ()) -> None:
        self._several = tuple(several)

    @property
    def trouble(self) -> str | None:
        """The first failure of one of the logs; None while all logs work."""
        return next((each.trouble for each in self._several if each.trouble is not None), None)

    def state(self, state: ArmState) -> None:
        for each in self._several:
            each.state(state)

    def frame(self, frame: CameraFrame) -> None:
        for each in self._several:
            each.frame(frame)

    def sent(self, time: float, sent: Sent, gripper: float) -> None:
        for each in self._several:
            each.sent(time, sent, gripper)

    def question(self, time: float, question: Question) -> None:
        for each in self._several:
            each.question(time, question)

    def answer(self, time: float, answer: ControllerAnswer) -> None:
        for each in self._several:
            each.answer(time, answer)

    def change(self, time: float, state: str, reason: str) -> None:
        for each in self._several:
            each.change(time, state, reason)

    def clocks(self, time: float, late: float, ages: dict[str, float]) -> None:
        for each in self._several:
            each.clocks(time, late, ages)


ENCODING = "gensim2-pack"
SEGMENT = 256 << 20
"""Size at which a log file is closed and a new file is started, bytes."""
MAX_BYTES = 4 << 30
"""Maximum total size of a run's files, bytes."""
DAYS = 30.0
"""Age (days) at which files of earlier runs in the same folder are removed."""
RESERVE = 8 << 20
"""Space reserved for closing a file on a full disk, bytes; it fits a chunk and all indices."""
CHUNK = 1 << 20
MAX_SECONDS = 1e9
"""MCAP cannot store negative times, or times (s) from this value on; messages with such times get the log time 0."""
BEHIND = 2000
"""Maximum number of messages that wait to be written."""

Opener = Callable[[Path], BinaryIO]


def _open(path: Path) -> BinaryIO:
    return path.open("xb", buffering=0)


class _Whole:
    """File that writes each block completely or not at all, and uses the reserved space when the disk is full.

    Args:
        path: path of the file.
        opener: function that opens the file.
        give_way: function that frees the reserved space.
    """

    def __init__(self, path: Path, opener: Opener, give_way: Callable[[], None]) -> None:
        self._file, self._give_way, self._length = opener(path), give_way, 0
        self.trouble: str | None = None

    def write(self, data: Any) -> int:
        """Write a whole block.

        On a full disk, write it into the reserve. Raise OSError if the reserve is full or the file was removed.

        Raise OSError if that is full or the file was removed.
        """
        block = bytes(data)
        try:
            self._put(block)
        except OSError as error:
            self.trouble = error.strerror or str(error)
            self._give_way()
            self._file.truncate(self._length)
            self._file.seek(self._length)
            self._put(block)
        self._length += len(block)
        # A log file without a name was deleted while it was open, so its content will be lost.
        if os.fstat(self._file.fileno()).st_nlink == 0:
            raise FileNotFoundError(errno.ENOENT, "the log file was removed")
        return len(block)

    def _put(self, block: bytes) -> None:
        view = memoryview(block)
        while view:
            view = view[self._file.write(view) :]

    def flush(self) -> None:
        """Do nothing, because writes are not buffered."""

    def tell(self) -> int:
        return self._length

    @property
    def closed(self) -> bool:
        return self._file.closed

    def close(self) -> None:
        """Flush the file to disk and close it."""
        if not self.closed:
            with contextlib.suppress(OSError):
                os.fsync(self._file.fileno())
            self._file.close()


class Log:
    """Writes the log in its own thread, so that logging never waits for the disk.

    Args:
        folder: folder of the run, which must be empty or missing.
        about: first message of each file.
        max_bytes: maximum total size of all files, bytes.
        segment: size at which a file is closed, bytes.
        opener: function that opens files.

    Attributes:
        trouble: reason why logging has failed; None while it works.

    Raises:
        InputError: the folder is not empty.
        WriteError: the folder cannot be written to, or the disk is full.
    """

    def __init__(
        self, folder: Path, about: About, *, max_bytes: int = MAX_BYTES, segment: int = SEGMENT, opener: Opener = _open
    ) -> None:
        from mcap.writer import CompressionType, Writer

        how: dict[str, Any] = {"chunk_size": CHUNK, "compression": CompressionType.LZ4, "enable_data_crcs": True}
        self._new_writer: Callable[[Any], Any] = partial(Writer, **how)
        self.folder, self._about, self._opener = folder, about.model_dump(mode="json"), opener
        self._max_bytes, self._segment = max_bytes, segment
        self.trouble: str | None = None
        self._begun = 0
        taken = InputError("already contains a log", file=folder, remedy="choose another folder with --out")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.glob("*.mcap")):
                raise taken
            self._reserve = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115 - closed at the end
            os.posix_fallocate(self._reserve.fileno(), 0, RESERVE)
            self._open_next()
        except FileExistsError as error:  # the path is a file, or another run has just begun a log here
            raise taken if folder.is_dir() else WriteError("is not a folder", file=folder) from error
        except OSError as error:
            remedy = "free disk space, or choose another folder with --out"
            raise WriteError(f"cannot write: {error.strerror or error}", file=folder, remedy=remedy) from error
        self._queue: queue.Queue[tuple[str, float, bytes] | None] = queue.Queue(BEHIND)
        self._thread = threading.Thread(target=self._write_all, name="log", daemon=True)
        self._thread.start()

    def state(self, state: ArmState) -> None:
        plain = {"time": state.time, "force": state.force, "mode": state.mode}
        self._put("/arm", state.time, plain, {"q": state.q, "v": state.v})

    def frame(self, frame: CameraFrame) -> None:
        plain = {"camera": frame.camera, "number": frame.number, "captured": frame.captured, "serial": frame.serial}
        self._put(f"/camera/{frame.camera}", frame.captured, plain, {"depth": frame.depth, "colors": frame.colors})

    def sent(self, time: float, sent: Sent, gripper: float) -> None:
        self._put("/sent", time, {"time": time, "gripper": gripper, "clips": list(sent.clips)}, {"q": sent.q})

    def question(self, time: float, question: Question) -> None:
        """Log a request to the controller; the request refers to images by their numbers."""
        sight = question.sight
        plain = {
            "time": time,
            "number": question.number,
            "count": question.count,
            "step": sight.step,
            "gripper": sight.gripper,
            "frames": {frame.camera: frame.number for frame in sight.frames},
        }
        posed = {f"posed/{name}": q for name, q in sight.posed.items()}
        self._put("/question", time, plain, {"q": sight.q, "v": sight.v, **posed})

    def answer(self, time: float, answer: ControllerAnswer) -> None:
        """Log an answer of the controller, with all of the controller's inputs."""
        plain = {
            "time": time,
            "number": answer.number,
            "done": answer.done,
            "error": answer.error,
            "refusal": answer.refusal,
            "cloud_ms": answer.cloud_ms,
            "acting_ms": answer.acting_ms,
        }
        seen = {f"seen/{name}": array for name, array in answer.seen.items()}
        self._put("/answer", time, plain, {"actions": answer.actions, **seen})

    def change(self, time: float, state: str, reason: str) -> None:
        self._put("/watch", time, {"time": time, "state": str(state), "reason": reason}, {})

    def clocks(self, time: float, late: float, ages: dict[str, float]) -> None:
        """Log the delay of a period, and the age of each camera's newest image."""
        wall = _time_of_day()
        self._put("/clocks", time, {"time": time, "late": late, "ages": ages, "wall": wall}, {})

    def _put(self, topic: str, time: float, plain: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        if self.trouble is not None:
            return
        data = pack(plain, arrays)
        if len(data) > MAX_MESSAGE:
            self.trouble = f"a message of {topic} has {len(data) >> 20} MiB, more than {MAX_MESSAGE >> 20}"
            return
        try:
            self._queue.put_nowait((topic, time, data))
        except queue.Full:
            self.trouble = f"{BEHIND} messages wait: the disk is too slow"

    def close(self) -> None:
        """Write all waiting messages and close the log."""
        while self._thread.is_alive():
            try:
                self._queue.put(None, timeout=0.1)
                break
            except queue.Full:  # The writing thread is too slow or has ended.
                continue
        self._thread.join()
        self._reserve.close()

    def _write_all(self) -> None:
        try:
            while (item := self._queue.get()) is not None:
                if self.trouble is None or not self._file.trouble:
                    self._write(*item)
        except OSError as error:  # the disk is full, including the space reserved for the log
            self.trouble = self._file.trouble or error.strerror or str(error)
        try:
            self._close_file()
        except OSError as error:
            self.trouble = self.trouble or error.strerror or str(error)

    def _write(self, topic: str, time: float, data: bytes) -> None:
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, ENCODING, 0)
        # A faulty clock may give any value; MCAP cannot store negative or huge times.
        stamp = int(1e9 * time) if 0.0 <= time < MAX_SECONDS else 0
        self._writer.add_message(self._channels[topic], stamp, data, stamp)
        if self._file.trouble is not None:
            self.trouble = self._file.trouble
        elif self._file.tell() > self._segment:
            self._close_file()
            self._open_next()
            self._prune()

    def _open_next(self) -> None:
        self._path = self.folder / f"log_{self._begun:06d}.mcap"
        self._begun += 1
        self._file = _Whole(self._path, self._opener, self._reserve.close)
        self._writer: Any = self._new_writer(self._file)
        self._writer.start(profile="gensim2", library="gensim2")
        self._channels: dict[str, int] = {}
        channel = self._writer.register_channel("/about", ENCODING, 0)
        self._writer.add_message(channel, 0, pack(self._about, {}), 0)

    def _close_file(self) -> None:
        if self._file.closed:  # The next file could not be opened, so there is nothing to close.
            return
        self._writer.finish()
        self._file.close()
        if self._file.trouble is not None:
            self.trouble = self._file.trouble

    def _prune(self) -> None:
        """Remove the oldest files of this run until the size limit is met."""
        files = sorted(self.folder.glob("log_*.mcap"))
        total = sum(path.stat().st_size for path in files)
        for path in files[:-2]:
            if total <= self._max_bytes:
                return
            total -= path.stat().st_size
            path.unlink()


def prune_runs(folder: Path, days: float = DAYS) -> list[Path]:
    """Remove log files older than ``days`` from the folders ``robot-*`` of earlier runs, and return their paths."""
    removed = []
    oldest = _time_of_day() - 86400.0 * days
    for path in sorted(folder.glob("robot-*/log_*.mcap")):
        if path.stat().st_mtime < oldest:
            path.unlink()
            removed.append(path)
    return removed


def _time_of_day() -> float:
    return time.time()
