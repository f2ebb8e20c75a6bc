"""Logs are complete on full disks, in several files and within their limits; messages are read back unchanged."""

from __future__ import annotations

import errno
import io
import os
import signal
import struct
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gensim2.core.errors import InputError, WriteError
from gensim2.perception import ObservationSpec
from gensim2.perception.camera_record import CameraRecord
from gensim2.robots import robot
from gensim2_robot import log_reader as replaying
from gensim2_robot.calibration import poses
from gensim2_robot.calibration.poses import read_standing
from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.eyes import Eyes, SensorSnapshot, inputs
from gensim2_robot.faults import FAULTS, Fault, FullDisk
from gensim2_robot.log import Log, prune_runs
from gensim2_robot.log_messages import About, AnswerMessage, PictureMessage, QuestionMessage, pack, unpack
from gensim2_robot.log_reader import KEPT, about_of, log_files, messages, unclosed
from gensim2_robot.simulated import simulated_cameras

LEFT = replace(simulated_cameras(robot("panda"), 320, 240)[0], name="left")
ABOUT = About(
    robot="panda",
    language="shut it",
    observation=ObservationSpec(cameras=("left",), modalities=()).to_dict(),
    cameras=[CameraRecord.of(LEFT)],
    task="CloseBox",
)


def frame(number: int) -> CameraFrame:
    draw = np.random.default_rng(number)
    depth = draw.integers(0, 5000, (240, 320)).astype(np.uint16)
    return CameraFrame("left", number, 0.1 * number, depth, draw.integers(0, 255, (240, 320, 3)).astype(np.uint8))


def test_messages_come_back_as_they_were(tmp_path: Path) -> None:
    log = Log(tmp_path, ABOUT)
    for number in range(20):
        log.frame(frame(number))
        log.state(ArmState(0.1 * number, np.arange(9.0), np.zeros(9), 1.5))
    log.change(2.0, "holding", "a reason")
    log.close()
    assert log.trouble is None
    found = list(messages(tmp_path))
    assert found[0] == ("/about", ABOUT)
    frames = [message for _, message in found if isinstance(message, PictureMessage)]
    assert len(frames) == 20
    np.testing.assert_array_equal(frames[7].depth, frame(7).depth)
    np.testing.assert_array_equal(frames[7].colors, frame(7).colors)
    assert found[-1][1].reason == "a reason"  # type: ignore[union-attr]
    assert [path.name for path in tmp_path.iterdir()] == ["log_000000.mcap"]
    assert unclosed(tmp_path) == []
    with pytest.raises(InputError, match="already contains a log"):
        Log(tmp_path, ABOUT)


def test_on_a_full_disk_the_log_ends_and_is_whole(tmp_path: Path) -> None:
    disk = FullDisk()
    log = Log(tmp_path, ABOUT, opener=disk.open)
    for number in range(12):
        log.frame(frame(number))
    while log._queue.qsize():  # wait until earlier messages are written
        pass
    disk.full = True
    for number in range(12, 60):
        log.frame(frame(number))
        if log.trouble is not None:
            break
    log.close()
    assert log.trouble is not None
    assert "No space left" in log.trouble
    numbers = [message.number for _, message in messages(tmp_path) if isinstance(message, PictureMessage)]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= 12


def test_a_disk_that_is_gone_ends_the_log_and_not_the_program(tmp_path: Path) -> None:
    class Gone(io.RawIOBase):
        """A file on a disk that accepts some data and then nothing, even after a retry."""

        def __init__(self) -> None:
            self.room, self._kept = 20_000, (tmp_path / "there").open("wb")

        def write(self, data: Any) -> int:
            self.room -= len(data)
            if self.room < 0:
                raise OSError(errno.EIO, "Input/output error")
            return len(data)

        def truncate(self, size: int | None = None) -> int:
            return 0

        def seek(self, offset: int, whence: int = 0) -> int:
            return 0

        def fileno(self) -> int:
            return self._kept.fileno()

    log = Log(tmp_path, ABOUT, opener=lambda path: Gone())  # type: ignore[arg-type, return-value]
    for number in range(5000):
        log.frame(frame(number))
    closing = threading.Thread(target=log.close, daemon=True)
    closing.start()
    closing.join(timeout=20.0)
    assert not closing.is_alive(), "closing waits for what writes no more"
    assert log.trouble is not None


def test_files_are_begun_anew_and_the_oldest_go(tmp_path: Path) -> None:
    log = Log(tmp_path, ABOUT, segment=1_000_000, max_bytes=4_000_000)
    for number in range(60):
        log.frame(frame(number))
    log.close()
    files = sorted(tmp_path.glob("log_*.mcap"))
    assert files[0].name != "log_000000.mcap"
    assert sum(path.stat().st_size for path in files) < 7_000_000
    found = [message.number for _, message in messages(tmp_path) if isinstance(message, PictureMessage)]
    assert found == list(range(found[0], 60))


def test_old_runs_are_pruned(tmp_path: Path) -> None:
    for name, days in (("robot-old", 40.0), ("robot-new", 1.0), ("mine", 40.0)):
        log = Log(tmp_path / name, ABOUT)
        log.close()
        path = tmp_path / name / "log_000000.mcap"
        then = path.stat().st_mtime - 86400 * days
        os.utime(path, (then, then))
    assert [path.parent.name for path in prune_runs(tmp_path)] == ["robot-old"]
    assert (tmp_path / "robot-new/log_000000.mcap").exists()
    assert (tmp_path / "mine/log_000000.mcap").exists()


@given(st.binary(max_size=300))
def test_damaged_messages_are_refused(data: bytes) -> None:
    with pytest.raises(InputError, match="damaged"):
        unpack(data)


def test_shortened_and_lying_messages_are_refused() -> None:
    whole = pack({"a": [1, None, "x"]}, {"q": np.arange(6.0).reshape(2, 3)})
    plain, arrays = unpack(whole)
    assert plain == {"a": [1, None, "x"]}
    np.testing.assert_array_equal(arrays["q"], np.arange(6.0).reshape(2, 3))
    for broken in (
        whole[:-1],
        whole + b"x",
        whole.replace(b"float64", b"object_"),
        whole.replace(b"[2, 3]", b"[2, 9]"),
    ):
        with pytest.raises(InputError, match=r"damaged|arrays\.q\.0: input should be"):
            unpack(broken)


def test_a_message_is_not_kept_by_its_arrays_and_its_head_is_short() -> None:
    q = unpack(pack({}, {"q": np.zeros(9)}))[1]["q"]
    assert q.base is None or q.base.nbytes == q.nbytes
    head = b" " * (1 << 20) + b'{"plain": {}, "arrays": {}}'
    with pytest.raises(InputError, match="damaged: the message header has"):
        unpack(struct.pack("<I", len(head)) + head)


def test_moments_of_a_log_are_counted_before_they_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = Log(tmp_path, ABOUT)
    for number in range(10):
        log.frame(frame(number))
        log.state(ArmState(0.1 * number, np.arange(9.0), np.zeros(9), 1.5))
    log.close()
    assert len(read_standing(tmp_path)) == 1
    read = 0

    def counted(folder: Path) -> Iterator[Any]:
        nonlocal read
        for message in messages(folder):
            read += 1
            yield message

    monkeypatch.setattr(poses, "messages", counted)
    for name in ("MAX_STATES", "MAX_PICTURES"):
        read = 0
        with monkeypatch.context() as patch:
            patch.setattr(poses, name, 3)
            with pytest.raises(InputError, match=r"more than 3 .*shorter log"):
                read_standing(tmp_path)
        assert read < 12


@pytest.mark.parametrize("text", ["nothing@1", "camera-frozen", "camera-frozen@", "camera-late@-1", "arm-reflex@nan"])
def test_faults_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="--fault"):
        Fault.parse(text)
    assert Fault.parse(f"{FAULTS[0]}@2.5") == Fault(FAULTS[0], 2.5)


def test_a_replay_keeps_the_newest_pictures_of_a_camera_whatever_their_numbers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    profile = robot("panda")
    camera = replace(simulated_cameras(profile, 8, 6)[0], name="left")
    spec = ObservationSpec(cameras=("left",), modalities=())
    about = ABOUT.model_copy(update={"cameras": [CameraRecord.of(camera)]})
    q = np.array(profile.reset_qpos)
    sight = SensorSnapshot(0, q, 0.0 * q, 1.0, (), {})
    seen = inputs(Eyes(spec, profile, (camera,), about.language, np.inf).observe(sight))
    living: list[weakref.ref[Any]] = []
    most = 0

    def told(_: Path) -> Iterator[Any]:
        nonlocal most
        yield "/about", about
        for number in range(0, 3 * 4 * KEPT, 3):
            black = {"depth": np.zeros((6, 8), np.uint16), "colors": np.zeros((6, 8, 3), np.uint8)}
            living.append(weakref.ref(black["depth"]))
            message = PictureMessage(camera="left", number=number, captured=0.03 * number, **black)
            del black
            yield "/camera/left", message
            del message
            most = max(most, sum(each() is not None for each in living))
        for asked, about_frame in enumerate((number, number - 3 * (KEPT - 1), number - 3 * KEPT)):
            plain = {
                "time": 0.0,
                "number": asked,
                "count": 1,
                "step": 0,
                "gripper": 1.0,
                "frames": {"left": about_frame},
            }
            yield "/question", QuestionMessage(**plain, q=q, v=0.0 * q, posed={"left": q})
            answer = {"time": 0.0, "number": asked, "done": False, "error": None, "cloud_ms": None, "acting_ms": 0.0}
            yield "/answer", AnswerMessage(**answer, actions=np.zeros((0, 8), np.float32), seen=seen)

    monkeypatch.setattr(replaying, "messages", told)
    monkeypatch.setattr(replaying, "unclosed", lambda _: [])
    found = replaying.replay(Path("nowhere"))
    assert (found.questions, found.missing, found.different) == (2, 1, ())
    assert most <= KEPT + 2
    seen = {f"{number}{'x' * 4000}": q for number in range(3)}
    monkeypatch.setattr(replaying, "MAX_DIFFERENT", 2)
    found = replaying.replay(Path("nowhere"))
    assert (found.compared, len(found.different)) == (6, 2)
    assert all(len(each) < 1000 for each in found.different)


KILLED = """
import sys, time
sys.path.insert(0, sys.argv[2])
from test_log import ABOUT, frame
from gensim2_robot.log import Log
log = Log(__import__("pathlib").Path(sys.argv[1]), ABOUT)
for number in range(10**6):
    log.frame(frame(number))
    print(number, flush=True)
    time.sleep(0.01)
"""


def test_the_log_of_a_killed_run_holds_all_that_was_written_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED, str(tmp_path), str(Path(__file__).parent)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if int(line) > 40:
                break
        process.send_signal(signal.SIGKILL)
    assert [path.name for path in tmp_path.iterdir()] == ["log_000000.mcap"]
    numbers = [message.number for _, message in messages(tmp_path) if isinstance(message, PictureMessage)]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) > 30  # the last MiB was only in memory
    assert about_of(tmp_path) == ABOUT
    assert replaying.replay(tmp_path).unclosed == ("log_000000.mcap",)


def test_a_log_that_was_cut_anywhere_holds_what_comes_before(tmp_path: Path) -> None:
    whole = whole_log(tmp_path / "whole")
    numbers = []
    for share in np.linspace(0.0, 1.0, 23):
        path = tmp_path / "cut.mcap"
        path.write_bytes(whole[: int(share * len(whole))])
        try:
            numbers.append(sum(isinstance(message, PictureMessage) for _, message in messages(path)))
        except InputError:
            numbers.append(0)
    assert numbers == sorted(numbers)
    assert (numbers[0], numbers[-1]) == (0, 12)
    assert len(set(numbers)) > 3


def whole_log(folder: Path) -> bytes:
    log = Log(folder, ABOUT)
    for number in range(12):
        log.frame(frame(number))
        log.state(ArmState(0.1 * number, np.arange(9.0), np.zeros(9), 1.5))
    log.close()
    return (folder / "log_000000.mcap").read_bytes()


def test_each_changed_byte_of_a_log_is_seen_or_changes_nothing(tmp_path: Path) -> None:
    whole = whole_log(tmp_path / "whole")

    def content(path: Path) -> list[bytes]:
        return [
            message.depth.tobytes() + message.colors.tobytes() if isinstance(message, PictureMessage) else repr(message)
            for _, message in messages(path)
        ]  # type: ignore[misc]

    good, refused, path = content(tmp_path / "whole"), 0, tmp_path / "changed.mcap"
    draw = np.random.default_rng(0)
    for place in [*range(120), *draw.integers(0, len(whole), 60), *range(len(whole) - 120, len(whole))]:
        path.write_bytes(whole[:place] + bytes([whole[place] ^ (1 << int(draw.integers(8)))]) + whole[place + 1 :])
        try:
            assert content(path) == good
        except InputError:
            refused += 1
    assert refused > 100


def forged(path: Path, *records: bytes) -> Path:
    """Write a file of MCAP records without an end."""
    path.write_bytes(b"\x89MCAP0\r\n" + b"".join(records))
    return path


def chunk(data: bytes, size: int, compression: bytes = b"lz4") -> bytes:
    content = struct.pack("<QQQI", 0, 0, size, 0) + struct.pack("<I", len(compression)) + compression
    content += struct.pack("<Q", len(data)) + data
    return struct.pack("<BQ", 6, len(content)) + content


@pytest.mark.parametrize("stated", ["true", "small"])
def test_a_chunk_that_expands_to_gigabytes_is_refused_before_it_does(tmp_path: Path, stated: str) -> None:
    import lz4.frame

    packed = lz4.frame.LZ4FrameCompressor()
    data = packed.begin() + b"".join(packed.compress(bytes(1 << 24)) for _ in range(200)) + packed.flush()
    assert len(data) < 24 << 20
    path = forged(tmp_path / "bomb.mcap", chunk(data, 200 << 24 if stated == "true" else 1000))
    limited = f"""
import resource
from pathlib import Path
import numpy, lz4.frame, zstandard, mcap.records
from gensim2_robot.log_reader import messages
from gensim2.core.errors import InputError, WriteError
size = int(Path("/proc/self/statm").read_text().split()[0]) * 4096 + (300 << 20)
resource.setrlimit(resource.RLIMIT_AS, (size, size))
try:
    list(messages(Path({str(path)!r})))
except InputError as error:
    print(error)
"""
    found = subprocess.run([sys.executable, "-c", limited], capture_output=True, text=True, check=False)
    said = "expands to 3200 MiB" if stated == "true" else "does not expand to the size"
    assert (found.stderr, said in found.stdout) == ("", True), found.stdout


def channel(topic: str) -> bytes:
    content = struct.pack("<HH", 1, 0) + struct.pack("<I", len(topic)) + topic.encode() + struct.pack("<II", 0, 0)
    return struct.pack("<BQ", 4, len(content)) + content


def told(data: bytes) -> bytes:
    return struct.pack("<BQ", 5, 22 + len(data)) + struct.pack("<HIQQ", 1, 0, 0, 0) + data


def test_messages_that_are_not_as_their_schema_has_them_are_refused_by_field(tmp_path: Path) -> None:
    about = ABOUT.model_dump(mode="json")
    left = about["cameras"][0]
    for change, said in (
        ({"robot": 5}, "robot"),
        ({"surprise": 1}, "surprise"),
        ({"schema_version": 2}, "schema_version"),
        ({"observation": {"modalities": 5}}, "modalities: must be a list"),
        ({"observation": {"noise": {"focal": [1]}}}, "noise.focal"),
        ({"cameras": [left, left]}, "twice"),
        ({"cameras": [{**left, "intrinsic": [[1.0], [2.0, 3.0]]}]}, "cameras.0"),
        ({"cameras": [{**left, "width": 8000, "height": 8000}]}, "pixels"),
        ({"cameras": [{**left, "width": -1}]}, "width"),
        ({"cameras": [{**left, "far": 10**400}]}, "64 bits"),
    ):
        path = forged(tmp_path / "log_000000.mcap", channel("/about"), told(pack({**about, **change}, {})))
        with pytest.raises(InputError, match=f"log_000000.mcap.*{said}"):
            about_of(tmp_path)
    whole = [channel("/about"), told(pack(about, {}))]
    black = {"depth": np.zeros((240, 320), np.uint16), "colors": np.zeros((240, 320, 3), np.uint8)}
    plain = {"camera": "left", "number": 0, "captured": 0.0, "serial": ""}
    for topic, data, said in (
        ("/camera/left", pack(plain, {**black, "depth": np.zeros((2, 2), np.uint16)}), r"depth is \(2, 2\)"),
        ("/camera/left", pack(plain, {**black, "depth": np.zeros((240, 320))}), "float64"),
        ("/camera/right", pack(plain, black), "contains an image from another camera, 'left'"),
        ("/camera/right", pack({**plain, "camera": "right"}, black), "the log has no camera with this name"),
        ("/camera/left", pack(plain, {**black, "depth/x": black["depth"]}), "depth"),
        ("/arm", pack({"time": 0.0, "force": 0.0, "mode": "ready"}, {"q": np.zeros(0), "v": np.zeros(0)}), "joints"),
        ("/arm", pack({"time": 0.0, "force": 0.0, "mode": "idle"}, {"q": np.zeros(9), "v": np.zeros(9)}), "mode"),
        ("/elsewhere", pack({}, {}), "logs have no topic"),
        ("/about", pack(about, {}), "must be the first message"),
    ):
        path = forged(tmp_path / "log_000000.mcap", *whole, channel(topic), told(data))
        with pytest.raises(InputError, match=said):
            list(messages(path))
    deep = b'{"plain": ' + 5000 * b"[" + 5000 * b"]" + b', "arrays": {}}'
    path = forged(tmp_path / "log_000000.mcap", channel("/about"), told(struct.pack("<I", len(deep)) + deep))
    with pytest.raises(InputError, match="damaged"):
        about_of(path)


@pytest.mark.parametrize("kind", ["pipe", "device", "missing"])
def test_what_is_no_file_is_refused_and_never_waited_for(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "log_000000.mcap"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    begun = time.monotonic()
    for name in (path, tmp_path):
        with pytest.raises(InputError, match=r"is a pipe|is a device|No such file|contains no log"):
            about_of(name)
    assert time.monotonic() - begun < 5.0
    assert kind == "missing" or log_files(tmp_path) == [path]


def test_a_log_whose_file_was_removed_says_so(tmp_path: Path) -> None:
    log = Log(tmp_path / "log", ABOUT)
    log.frame(frame(0))
    (tmp_path / "log" / "log_000000.mcap").unlink()
    (tmp_path / "log").rmdir()
    for number in range(1, 200):
        log.frame(frame(number))
        if log.trouble is not None:
            break
        time.sleep(0.01)
    log.close()
    assert log.trouble == "the log file was removed"


def test_of_several_logs_that_begin_together_in_a_folder_one_goes_on(tmp_path: Path) -> None:
    for number in range(20):
        found = begun_together(tmp_path / str(number), 3)
        logs = [each for each in found if isinstance(each, Log)]
        assert len(logs) == 1, found
        logs[0].state(ArmState(0.1, np.arange(9.0), np.zeros(9), 1.5))
        logs[0].close()
        assert logs[0].trouble is None
        assert [name for name, _ in messages(tmp_path / str(number))] == ["/about", "/arm"]
        refused = [each for each in found if isinstance(each, str)]
        assert refused == ["already contains a log"] * 2


def begun_together(folder: Path, count: int) -> list[object]:
    """Begin logs in several threads at the same moment; return the logs and the errors' messages."""
    barrier, found = threading.Barrier(count), list[object]()

    def begin() -> None:
        barrier.wait()
        try:
            found.append(Log(folder, ABOUT))
        except InputError as error:
            found.append(error.message)

    threads = [threading.Thread(target=begin) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


@pytest.mark.parametrize("number", [errno.ENOENT, errno.EROFS, errno.ENOSPC])
@pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_log_whose_next_file_cannot_be_opened_says_so_and_stays_readable(tmp_path: Path, number: int) -> None:
    def opener(path: Path) -> Any:
        if path.name != "log_000000.mcap":
            raise OSError(number, os.strerror(number))
        return path.open("xb", buffering=0)

    log = Log(tmp_path, ABOUT, segment=1_000_000, opener=opener)
    for each in range(60):
        log.frame(frame(each))
    log.close()
    assert log.trouble == os.strerror(number)
    assert unclosed(tmp_path) == []
    assert sum(isinstance(message, PictureMessage) for _, message in messages(tmp_path)) > 0


def test_a_folder_that_cannot_be_written_to_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError, match="file"):
        Log(tmp_path / "file", ABOUT)
    with pytest.raises(WriteError, match="cannot write"):
        Log(Path("/proc/gensim2"), ABOUT)


def test_times_that_no_clock_says_do_not_end_the_log(tmp_path: Path) -> None:
    log = Log(tmp_path, ABOUT)
    for moment in (np.nan, np.inf, -np.inf, -1.0, 1e300):
        log.state(ArmState(moment, np.arange(9.0), np.zeros(9), 1.5))
    log.close()
    assert log.trouble is None
    assert len(list(messages(tmp_path))) == 6
