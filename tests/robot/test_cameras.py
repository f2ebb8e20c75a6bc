"""Cameras in their own process: images, and errors when they fail."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from multiprocessing.shared_memory import SharedMemory

import numpy as np
import pytest
from fake_cameras import LEFT, SERIAL, Fake, picture, refused

from gensim2.core.errors import InputError
from gensim2_robot.devices import CameraFrame
from gensim2_robot.pipes import SLOTS, DeviceGoneError, PictureSlots
from gensim2_robot.real import ProcessCameras

ODD = replace(LEFT, name="odd", width=7, height=5)


@pytest.fixture
def cameras() -> Iterator[ProcessCameras]:
    found = ProcessCameras(Fake, ODD, LEFT)
    yield found
    found.close()


def until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + 30.0
    while not done():
        assert time.monotonic() < end
        time.sleep(0.002)


def until_gone(cameras: ProcessCameras, said: str) -> None:
    def poll() -> bool:
        cameras.poll()
        return False

    with pytest.raises(DeviceGoneError, match=said):
        until(poll)


def test_pictures_come_whole_and_in_order_with_time_and_device(cameras: ProcessCameras) -> None:
    assert [camera.name for camera in cameras.cameras] == ["odd", "left"]
    assert cameras.serials == {"odd": SERIAL, "left": SERIAL}
    found: list[CameraFrame] = []
    until(lambda: bool(found.extend(cameras.poll())) or len(found) > 100)
    for camera in (ODD, LEFT):
        own = [frame for frame in found if frame.camera == camera.name]
        numbers = [frame.number for frame in own]
        assert numbers == sorted(set(numbers)), "each comes once"
        assert len(own) > 4 * SLOTS, "slots are given back"
        for frame in own:
            depth, colors = picture(frame.number, camera)
            np.testing.assert_array_equal(frame.depth, depth)
            np.testing.assert_array_equal(frame.colors, colors)
            assert (frame.captured, frame.serial) == (10.0 + frame.number, SERIAL)


def test_what_nobody_takes_is_dropped_and_what_was_taken_stays(cameras: ProcessCameras) -> None:
    kept: list[CameraFrame] = []
    until(lambda: bool(kept.extend(cameras.poll())) or len(kept) > 1)
    time.sleep(0.2)  # about a hundred images
    waiting: Sequence[CameraFrame] = cameras.poll()
    assert len(waiting) <= 2 * SLOTS
    later: list[CameraFrame] = []
    until(lambda: bool(later.extend(cameras.poll())) or any(frame.number > waiting[-1].number + 3 for frame in later))
    for frame in (*kept, *waiting):
        np.testing.assert_array_equal(frame.depth, picture(frame.number, {"odd": ODD, "left": LEFT}[frame.camera])[0])


@pytest.mark.parametrize(
    ("fault", "said"),
    [("broken", r"connection to the cameras is lost: xioctl\(VIDIOC"), ("large", "camera odd: depth is")],
)
def test_cameras_whose_library_fails_are_gone(cameras: ProcessCameras, fault: str, said: str) -> None:
    cameras.fail(fault)
    until_gone(cameras, said)


def test_a_process_that_is_killed_is_a_device_that_is_gone(cameras: ProcessCameras) -> None:
    name = cameras._slots._memory.name
    cameras._process.kill()
    until_gone(cameras, "the process of the cameras has ended")
    with pytest.raises(FileNotFoundError):
        SharedMemory(name)  # the shared memory is removed


def test_cameras_end_with_the_loop_they_were_opened_for(cameras: ProcessCameras) -> None:
    cameras._process.pipe.close()  # as when the process ends
    until(lambda: not cameras._process.is_alive)


def test_pictures_wait_until_there_is_room_and_no_longer() -> None:
    writer, room = PictureSlots.make([ODD, LEFT])
    reader = PictureSlots.enter(room)
    given = [CameraFrame("odd", number, float(number), *picture(number, ODD), SERIAL) for number in range(SLOTS + 1)]
    waiting = [put for frame in given if (put := writer.put(frame)) is not None]
    assert [put.number for put in waiting] == list(range(SLOTS))
    taken = reader.take(waiting[3])
    writer.free(waiting[3])
    again = writer.put(given[SLOTS])
    assert again is not None
    np.testing.assert_array_equal(taken.depth, given[3].depth, "a copy")
    for put in (*waiting[:3], again, *waiting[4:]):
        np.testing.assert_array_equal(reader.take(put).colors, given[put.number].colors)
    reader.close()
    writer.close()


def test_cameras_that_cannot_be_opened_say_why() -> None:
    with pytest.raises(InputError, match=r"left\.db3: cameras\.left: is no recording"):
        ProcessCameras(refused)


def test_a_library_that_fails_as_it_opens_cameras_is_told_with_its_words() -> None:
    with pytest.raises(DeviceGoneError, match=r"cannot be opened: FileNotFoundError: .*'/no/such/device'"):
        ProcessCameras(os.listdir, "/no/such/device")  # libraries raise any exception
