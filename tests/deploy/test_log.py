"""Logs are whole: on a full disk, over several files, within their share; and messages come back as they were."""

from __future__ import annotations

import errno
import io
import os
import threading
import weakref
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gensim2.deploy import replay as replaying
from gensim2.deploy.devices import ArmState, Frame
from gensim2.deploy.eyes import Eyes, Sight, inputs
from gensim2.deploy.faults import FAULTS, Fault, FullDisk
from gensim2.deploy.log import Log, prune_runs
from gensim2.deploy.packing import pack, unpack
from gensim2.deploy.replay import KEPT, camera_to_dict, frame_of, messages
from gensim2.deploy.simulated_cameras import simulated_cameras
from gensim2.errors import InputError
from gensim2.observations import ObservationSpec
from gensim2.robots import robot


def frame(number: int) -> Frame:
    draw = np.random.default_rng(number)
    depth = draw.integers(0, 5000, (240, 320)).astype(np.uint16)
    return Frame("left", number, 0.1 * number, depth, draw.integers(0, 255, (240, 320, 3)).astype(np.uint8))


def test_messages_come_back_as_they_were(tmp_path: Path) -> None:
    log = Log(tmp_path, {"task": "CloseBox"})
    for number in range(20):
        log.frame(frame(number))
        log.state(ArmState(0.1 * number, np.arange(9.0), np.zeros(9), 1.5))
    log.change(2.0, "holding", "a reason")
    log.close()
    assert log.trouble is None
    found = list(messages(tmp_path))
    assert found[0][:2] == ("/about", {"task": "CloseBox"})
    frames = [arrays for topic, _, arrays in found if topic == "/camera/left"]
    assert len(frames) == 20
    np.testing.assert_array_equal(frames[7]["depth"], frame(7).depth)
    np.testing.assert_array_equal(frames[7]["colors"], frame(7).colors)
    assert found[-1][1]["reason"] == "a reason"
    with pytest.raises(InputError, match="holds a log already"):
        Log(tmp_path, {})


def test_on_a_full_disk_the_log_ends_and_is_whole(tmp_path: Path) -> None:
    disk = FullDisk(tmp_path / ".reserve")
    log = Log(tmp_path, {}, opener=disk.open)
    for number in range(12):
        log.frame(frame(number))
    while log._queue.qsize():  # what came before is written
        pass
    disk.full = True
    for number in range(12, 60):
        log.frame(frame(number))
        if log.trouble is not None:
            break
    log.close()
    assert log.trouble is not None
    assert "No space left" in log.trouble
    numbers = [plain["number"] for topic, plain, _ in messages(tmp_path) if topic == "/camera/left"]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= 12


def test_a_disk_that_is_gone_ends_the_log_and_not_the_program(tmp_path: Path) -> None:
    class Gone(io.RawIOBase):
        """A file on a disk that takes a while, and then nothing, also not once more."""

        def __init__(self) -> None:
            self.room = 20_000

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
            raise OSError(errno.EIO, "Input/output error")

    log = Log(tmp_path, {}, opener=lambda path: Gone())  # type: ignore[arg-type, return-value]
    for number in range(5000):
        log.frame(frame(number))
    closing = threading.Thread(target=log.close, daemon=True)
    closing.start()
    closing.join(timeout=20.0)
    assert not closing.is_alive(), "closing waits for what writes no more"
    assert log.trouble is not None


def test_files_are_begun_anew_and_the_oldest_go(tmp_path: Path) -> None:
    log = Log(tmp_path, {"n": 1}, segment=1_000_000, max_bytes=4_000_000)
    for number in range(60):
        log.frame(frame(number))
    log.close()
    files = sorted(tmp_path.glob("log_*.mcap"))
    assert files[0].name != "log_000000.mcap"
    assert sum(path.stat().st_size for path in files) < 7_000_000
    found = [plain["number"] for topic, plain, _ in messages(tmp_path) if topic == "/camera/left"]
    assert found == list(range(found[0], 60))


def test_old_runs_are_pruned(tmp_path: Path) -> None:
    for name, days in (("robot-old", 40.0), ("robot-new", 1.0), ("mine", 40.0)):
        log = Log(tmp_path / name, {})
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
        with pytest.raises(InputError, match="damaged"):
            unpack(broken)


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
    about = {"cameras": [camera_to_dict(camera)], "observation": spec.to_dict(), "robot": "panda", "language": "shut"}
    black = {"depth": np.zeros((6, 8), np.uint16), "colors": np.zeros((6, 8, 3), np.uint8)}
    q = np.array(profile.reset_qpos)
    sight = Sight(0, q, 0.0 * q, 1.0, (), {})
    seen = inputs(Eyes(spec, profile, (camera,), "shut", np.inf).observe(sight))
    living: list[weakref.ref[Frame]] = []
    most = 0

    def kept(plain: dict[str, Any], arrays: dict[str, Any]) -> Frame:
        found = frame_of(plain, arrays)
        living.append(weakref.ref(found))
        return found

    def told(_: Path) -> Iterator[Any]:
        nonlocal most
        yield "/about", about, {}
        for number in range(0, 3 * 4 * KEPT, 3):
            yield "/camera/left", {"camera": "left", "number": number, "captured": 0.03 * number}, dict(black)
            most = max(most, sum(each() is not None for each in living))
        for asked, about_frame in enumerate((number, number - 3 * (KEPT - 1), number - 3 * KEPT)):
            plain = {"number": asked, "step": 0, "gripper": 1.0, "frames": {"left": about_frame}}
            yield "/question", plain, {"q": q, "v": 0.0 * q, "posed/left": q}
            yield "/answer", {"number": asked}, {f"seen/{name}": array for name, array in seen.items()}

    monkeypatch.setattr(replaying, "messages", told)
    monkeypatch.setattr(replaying, "frame_of", kept)
    found = replaying.replay(Path("nowhere"))
    assert (found.questions, found.missing, found.different) == (2, 1, ())
    assert most <= KEPT + 2
