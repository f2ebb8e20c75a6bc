"""Read logs, which may be untrusted. Sizes are checked before allocations, and checksums before parsing.

The log of a killed run has no end record. Such a log is read up to the last complete record.
"""

from __future__ import annotations

import contextlib
import io
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error, InputError, one_line
from gensim2.core.foreign.library import read_by_library
from gensim2.core.foreign.limits import MAX_CHANNELS, MAX_CHUNK
from gensim2.core.foreign.tree import open_regular, why
from gensim2.robots import robot
from gensim2_robot.devices import CameraFrame
from gensim2_robot.eyes import Eyes, SensorSnapshot, inputs
from gensim2_robot.log_messages import (
    About,
    AnswerMessage,
    AnyMessage,
    PictureMessage,
    QuestionMessage,
    message_of,
    unpack,
)

if TYPE_CHECKING:
    from mcap.records import Chunk


_MAGIC = b"\x89MCAP0\r\n"
_REMEDY = "restore the file, or leave it out"


def log_files(folder: Path) -> list[Path]:
    """Return the files of a log, in the order in which they were written.

    Args:
        folder: folder of the log. If this is the path of a file, only this file is returned.

    Raises:
        InputError: the folder has no log file.
    """
    files = sorted(folder.glob("log_*.mcap")) if folder.is_dir() else [folder]
    if not files:
        raise InputError("contains no log", file=folder, remedy="give a run's folder with log_000000.mcap")
    return files


def messages(folder: Path) -> Iterator[tuple[str, AnyMessage]]:
    """Yield topic and content of all messages in a log, or in one file of a log, in the order of writing.

    Every file must start with the same :class:`About`. Images must match the cameras in this message.

    Raises:
        InputError: the log is missing, a file is damaged, or a message is invalid.
    """
    about: About | None = None
    for path in log_files(folder):
        is_first = True
        for topic, data in _packed(path):
            try:
                message = message_of(topic, *unpack(data))
            except InputError as error:
                raise InputError(error.message, file=path, field=error.field, remedy=_REMEDY) from error
            wrong = None
            if is_first != isinstance(message, About):
                wrong = "this message must be the first message of the file, and must occur only once"
            elif isinstance(message, About):
                if about is not None and message != about:
                    wrong = "this message differs from the first message of the previous file"
                about, is_first = message, False
            if wrong is not None:
                raise InputError(wrong, file=path, field="/about", remedy=_REMEDY)
            if isinstance(message, PictureMessage) and about is not None:
                _require_camera(message, about, path)
            yield topic, message
    if about is None:
        raise InputError("has no message: the run ended before it wrote one", file=folder)


def about_of(folder: Path) -> About:
    """Return the first message of a log.

    Raises:
        InputError: the log has no message, or the message is damaged.
    """
    _, message = next(messages(folder))
    assert isinstance(message, About), "messages() begins with it"
    return message


def unclosed(folder: Path) -> list[str]:
    """Return the names of the files of a log that have no end record; a killed run leaves such a file.

    Raises:
        InputError: the log is missing, or a file cannot be read.
    """
    found = []
    for path in log_files(folder):
        with _opened(path) as (stream, size):
            if not _is_closed(stream, size):
                found.append(path.name)
    return found


def _require_camera(picture: PictureMessage, about: About, path: Path) -> None:
    field = f"/camera/{picture.camera}"
    camera = next((each for each in about.cameras if each.name == picture.camera), None)
    if camera is None:
        raise InputError("the log has no camera with this name", file=path, field=field, remedy=_REMEDY)
    shape = (camera.height, camera.width)
    if picture.depth.shape != shape or picture.colors.shape != (*shape, 3):
        said = f"depth is {picture.depth.shape}, colours are {picture.colors.shape}, the camera has {shape}"
        raise InputError(said, file=path, field=field, remedy=_REMEDY)


def _packed(path: Path) -> Iterator[tuple[str, bytes]]:
    """Yield topic and bytes of each message of a file."""
    from mcap.data_stream import ReadDataStream
    from mcap.opcode import Opcode
    from mcap.records import Channel, Chunk, DataEnd, Message

    topics: dict[int, str] = {}

    def read(opcode: int, content: bytes) -> Iterator[tuple[str, bytes]]:
        with read_by_library(path, _REMEDY, "is damaged"):
            record: Channel | Message | Chunk | None = None
            stream = ReadDataStream(io.BytesIO(content))
            if opcode == Opcode.CHANNEL:
                record = Channel.read(stream)
            elif opcode == Opcode.MESSAGE:
                record = Message.read(stream, len(content))
            elif opcode == Opcode.CHUNK:
                record = Chunk.read(stream)
        if isinstance(record, Channel):
            topics[record.id] = record.topic
            if len(topics) > MAX_CHANNELS:
                raise _damaged(path, f"it has over {MAX_CHANNELS} channels")
        elif isinstance(record, Message):
            if record.channel_id not in topics:
                raise _damaged(path, "a message is of no channel")
            yield topics[record.channel_id], record.data
        elif isinstance(record, Chunk):
            expanded = _expanded(record, path)
            for each in _records(io.BytesIO(expanded), 0, len(expanded), path, whole=True):
                if each[0] == Opcode.CHUNK:
                    raise _damaged(path, "a chunk is in a chunk")
                yield from read(*each)

    with _opened(path) as (stream, size):
        closed = _is_closed(stream, size)
        head = stream.read(len(_MAGIC))
        if head != _MAGIC[: len(head)]:
            raise InputError("is not an MCAP file", file=path, remedy="give a log_*.mcap of a run, or its folder")
        checksum, ended = zlib.crc32(head), False
        for opcode, content in _records(stream, len(head), size - closed * len(_MAGIC), path, whole=closed):
            if opcode == Opcode.DATA_END:
                with read_by_library(path, _REMEDY, "is damaged"):
                    end = DataEnd.read(ReadDataStream(io.BytesIO(content)))
                if end.data_section_crc not in (0, checksum):  # Older logs have no checksum and store 0.
                    raise _damaged(path, "its checksum is another")
                ended = True
            checksum = zlib.crc32(content, zlib.crc32(struct.pack("<BQ", opcode, len(content)), checksum))
            # After its data, an MCAP file has a summary, which only repeats data.
            if not ended:
                yield from read(opcode, content)
        if closed and not ended:
            raise _damaged(path, "it has no end of data")


def _records(stream: BinaryIO, at: int, end: int, path: Path, *, whole: bool) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and content of each record of a file.

    Args:
        stream: file, at the position ``at``.
        at: start of the first record, bytes.
        end: end of the last record, bytes.
        path: path of the file, for error messages.
        whole: whether a truncated last record is an error. If False, the record is left out.

    Raises:
        InputError: a record is too large, or is truncated although ``whole`` is set.
    """
    while at < end:
        head = stream.read(min(9, end - at))
        opcode, length = struct.unpack("<BQ", head) if len(head) == 9 else (0, end)
        at += 9 + length
        if at > end:
            if whole:
                raise _damaged(path, "a record is incomplete")
            return
        if length > MAX_CHUNK:
            raise _damaged(path, f"a record has {length / 2**20:.0f} MiB")
        yield opcode, stream.read(length)


def _expanded(chunk: Chunk, path: Path) -> bytes:
    """Decompress a chunk. The result never exceeds the stated size, even if the compressed data are malicious."""
    import lz4.frame
    import zstandard

    size = chunk.uncompressed_size
    if size > MAX_CHUNK:
        raise _damaged(path, f"a chunk expands to {size / 2**20:.0f} MiB, more than {MAX_CHUNK / 2**20:.0f}")
    found: bytes
    with read_by_library(path, _REMEDY, "is damaged"):
        if chunk.compression == "lz4":
            found = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        elif chunk.compression == "zstd":
            found = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size + 1)
        elif chunk.compression == "":
            found = chunk.data
        else:
            raise _damaged(path, f"a chunk is compressed as {chunk.compression!r}")
    if len(found) != size:
        raise _damaged(path, "a chunk does not expand to the size that it states")
    if chunk.uncompressed_crc not in (0, zlib.crc32(found)):
        raise _damaged(path, "the checksum of a chunk is another")
    return found


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[tuple[BinaryIO, int]]:
    """Open a file, and yield the file and its size; error messages name the file."""
    try:
        with open_regular(path) as stream:
            yield stream, os.fstat(stream.fileno()).st_size
    except OSError as error:
        raise InputError(why(error), file=path, remedy=_REMEDY) from error


def _is_closed(stream: BinaryIO, size: int) -> bool:
    """Return whether a file has an end record, and move the stream back to the start of the file."""
    if size < 2 * len(_MAGIC):
        return False
    stream.seek(size - len(_MAGIC))
    found = stream.read(len(_MAGIC)) == _MAGIC
    stream.seek(0)
    return found


def _damaged(path: Path, said: str) -> InputError:
    return InputError(f"is damaged: {said}", file=path, remedy=_REMEDY)


KEPT = 50
"""Number of newest images of each camera that stay in memory, more than a request can refer to."""
KEPT_BYTES = 1 << 28
"""Maximum total size of images in memory, bytes."""
MAX_DIFFERENT = 1000
"""Maximum number of differing arrays whose names are reported."""


@dataclass(frozen=True)
class LogReplay:
    """Result of comparing logged observations with recomputed observations.

    Attributes:
        questions: number of answered requests.
        compared: number of compared arrays.
        clouds: number of compared arrays that are point clouds.
        different: names of the arrays that differ, each with the number of its request. At most 1000 arrays are listed.
        missing: number of requests that were not compared, because their images were removed or are no longer in
            memory.
        unclosed: number of files without an end record, from a run that was killed. These files are compared as well.
    """

    questions: int
    compared: int
    clouds: int
    different: tuple[str, ...]
    missing: int
    unclosed: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        return {**vars(self), "different": list(self.different), "unclosed": list(self.unclosed)}


def replay(folder: Path) -> LogReplay:
    """Recompute every observation of a log and compare it with the logged observation.

    Raises:
        InputError: the log is missing or damaged, or an observation cannot be computed.
    """
    found = _Replayed()
    for _, message in messages(folder):
        try:
            found.take(message)
        except GenSim2Error as error:
            raise InputError(f"cannot be replayed: {error}", file=folder) from error
    return found.result(unclosed(folder))


class _Replayed:
    def __init__(self) -> None:
        # An Eyes object without cameras is made first, and replaced once the log's cameras are known.
        self._eyes: list[Eyes] = []
        self._joints = 0
        self._frames: dict[str, dict[int, CameraFrame]] = {}
        self._asked: dict[int, QuestionMessage] = {}
        self._questions = self._compared = self._clouds = self._missing = 0
        self._different: list[str] = []

    def take(self, message: AnyMessage) -> None:
        """Process the next message. Raise GenSim2Error if an observation cannot be computed."""
        if isinstance(message, About):
            if not self._eyes:
                self._open_eyes(message)
        elif isinstance(message, PictureMessage):
            self._keep(message.frame())
        elif isinstance(message, QuestionMessage):
            self._asked[message.number] = message
            if len(self._asked) > KEPT:
                del self._asked[next(iter(self._asked))]
        elif isinstance(message, AnswerMessage) and message.seen:
            question = self._asked.pop(message.number, None)
            if question is not None:
                self._compare(question, message.seen)

    def result(self, cut: list[str]) -> LogReplay:
        """Return the result of the replay; ``cut`` lists the files without an end record."""
        different = tuple(self._different)
        return LogReplay(self._questions, self._compared, self._clouds, different, self._missing, tuple(cut))

    def _open_eyes(self, about: About) -> None:
        cameras, spec = tuple(each.camera() for each in about.cameras), about.spec()
        pixels = np.inf if about.pixels is None else about.pixels
        profile = robot(about.robot)
        self._joints = len(profile.reset_qpos)
        for each in (replace(spec, modalities=()), spec):
            self._eyes.append(Eyes(each, profile, cameras, about.language, pixels))

    def _keep(self, frame: CameraFrame) -> None:
        """Store an image, and discard the oldest images. Image numbers may have gaps and may restart."""
        kept = self._frames.setdefault(frame.camera, {})
        most = min(KEPT, max(1, KEPT_BYTES // (len(self._frames) * (frame.depth.nbytes + frame.colors.nbytes))))
        kept.pop(frame.number, None)
        kept[frame.number] = frame
        while len(kept) > most:
            del kept[next(iter(kept))]

    def _compare(self, question: QuestionMessage, seen: dict[str, npt.NDArray[Any]]) -> None:
        names = list(question.frames.items())
        if any(number not in self._frames.get(name, {}) for name, number in names):
            self._missing += 1
            return
        if any(len(q) != self._joints for q in (question.q, question.v, *question.posed.values())):
            raise InputError(f"the request {question.number} must contain values for {self._joints} joints")
        shown = tuple(self._frames[name][number] for name, number in names)
        sight = SensorSnapshot(question.step, question.q, question.v, question.gripper, shown, question.posed)
        found: dict[str, npt.NDArray[Any]] = {}
        # the second Eyes object computes a point cloud; use it only if the logged arrays of this request need it
        for eyes in self._eyes:
            if not found.keys() >= seen.keys():
                found = inputs(eyes.observe(sight))
        self._questions += 1
        for name, then in seen.items():
            now = found.get(name)
            self._compared += 1
            self._clouds += name == "point_cloud"
            differs = now is None or then.dtype != now.dtype or then.tobytes() != now.tobytes()
            if differs and len(self._different) < MAX_DIFFERENT:
                self._different.append(one_line(f"{name} of question {question.number}"))
