"""States of the watchdog, and its reasons to hold and stop; without devices and clock."""

from __future__ import annotations

import numpy as np
import pytest

from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.limits import Commands, Sent
from gensim2_robot.watch import State, StateError, Watch

HOME = np.zeros(7)
CAMERAS = ("left", "right")


def frame(camera: str, captured: float, value: int = 1, number: int = 0, height: int = 4) -> CameraFrame:
    return CameraFrame(
        camera, number, captured, np.full((height, 4), value, np.uint16), np.zeros((height, 4, 3), np.uint8)
    )


def state(time: float, **other: object) -> ArmState:
    return ArmState(**{"time": time, "q": np.zeros(9), "v": np.zeros(9), "force": 0.0, **other})  # type: ignore[arg-type]


def running() -> Watch:
    watch = Watch()
    watch.arm(0.0)
    watch.run(0.0)
    return watch


def test_nothing_runs_that_is_not_armed_and_nobody_resumes_what_is_stopped() -> None:
    watch = Watch()
    with pytest.raises(StateError, match="armed"):
        watch.run(0.0)
    watch.arm(0.0)
    watch.run(0.0)
    watch.hold(1.0, "a reason")
    assert (watch.state, watch.reason) == (State.HOLDING, "a reason")
    with pytest.raises(StateError, match="person"):
        watch.resume(2.0, "")
    watch.resume(2.0, "Ada")
    assert watch.state is State.RUNNING
    assert "Ada" in watch.reason
    watch.stop(3.0, "another")
    for refused in (lambda: watch.resume(4.0, "Ada"), lambda: watch.arm(4.0), lambda: watch.run(4.0)):
        with pytest.raises(StateError, match="stopped"):
            refused()
    watch.hold(5.0, "later")
    assert watch.reason == "another"
    assert [change.state for change in watch.changes][-2:] == [State.RUNNING, State.STOPPED]


def test_a_held_arm_may_still_be_stopped() -> None:
    watch = running()
    watch.hold(1.0, "a reason")
    watch.saw_arm(state(1.0, mode="reflex"), 1.0)
    assert watch.state is State.STOPPED
    assert "reflex" in watch.reason


@pytest.mark.parametrize(
    ("times", "said"),
    [
        ((0.99, 0.84), "right: the last picture is 160 ms old"),
        ((0.99, 0.93), "right: its picture is 60 ms behind the others"),
        ((0.99,), "no picture"),
    ],
)
def test_pictures_are_there_fresh_and_of_one_time(times: tuple[float, ...], said: str) -> None:
    watch = running()
    for camera, captured in zip(CAMERAS, times, strict=False):
        watch.saw_frame(frame(camera, captured), 1.0)
    watch.check_frames(CAMERAS, 1.0)
    assert watch.state is State.HOLDING
    assert said in watch.reason


def test_good_pictures_change_nothing() -> None:
    watch = running()
    for number in range(20):
        for camera in CAMERAS:
            watch.saw_frame(frame(camera, 0.1 * number, number + 1, number), 0.1 * number + 0.03)
        watch.check_frames(CAMERAS, 0.1 * number + 0.12)
    assert watch.state is State.RUNNING


@pytest.mark.parametrize(
    ("second", "said"),
    [
        (frame("left", 1.1, value=1), "frozen"),
        (frame("left", 0.9, value=2), "clock jumped"),
        (frame("left", 9.9, value=2), "clock jumped"),
        (frame("left", 1.1, value=2, height=2), "size"),
    ],
)
def test_what_is_wrong_with_a_picture_is_told(second: CameraFrame, said: str) -> None:
    watch = running()
    watch.saw_frame(frame("left", 1.0), 1.02)
    watch.saw_frame(second, 1.12)
    assert watch.state is State.HOLDING
    assert said in watch.reason


def noisy(number: int) -> CameraFrame:
    draw = np.random.default_rng(number)
    depth = draw.normal(900.0, 2.0, (60, 80)).round().astype(np.uint16)
    return CameraFrame("left", number, 0.1 * number, depth, np.zeros((60, 80, 3), np.uint8), "a")


def test_rows_of_the_picture_before_are_torn_and_noise_repeats_none() -> None:
    watch = running()
    for number in range(50):
        watch.saw_frame(noisy(number), 0.1 * number)
    assert watch.state is State.RUNNING
    torn = noisy(50)
    torn.depth[40:] = noisy(49).depth[40:]
    watch.saw_frame(torn, 5.0)
    assert watch.state is State.HOLDING
    assert "torn, 20 rows" in watch.reason


def test_a_picture_of_another_device_is_told_by_its_number() -> None:
    watch = Watch(serials={"left": "b"})
    watch.arm(0.0)
    watch.run(0.0)
    watch.saw_frame(noisy(1), 0.1)
    assert watch.state is State.HOLDING
    assert "the device 'a', not 'b'" in watch.reason


@pytest.mark.parametrize(
    ("mode", "expected", "at_once"),
    [
        ("reflex", State.STOPPED, True),
        ("refusing", State.STOPPED, True),
        ("at-limit", State.HOLDING, False),
        ("ready", State.RUNNING, False),
    ],
)
def test_what_an_arm_says_of_itself_counts(mode: str, expected: State, at_once: bool) -> None:
    watch = running()
    watch.saw_arm(state(1.0, mode=mode), 1.0)
    assert watch.state is expected
    assert watch.stops_at_once is at_once


def test_an_arm_that_is_not_where_it_was_sent_is_held_unless_something_blocks_it() -> None:
    for force, expected in ((0.0, State.HOLDING), (50.0, State.RUNNING)):
        watch = running()
        for number in range(60):
            sent = Sent(np.full(7, 0.01 * number), HOME, HOME, Commands.none(7))
            watch.sent(sent, 0.01 * number)
        watch.check_arm(state(0.59, force=force), HOME, 0.6)
        assert watch.state is expected


def test_an_arm_that_trails_its_commands_is_where_it_was_sent() -> None:
    watch = running()
    for number in range(60):
        watch.sent(Sent(np.full(7, 0.002 * number), HOME, HOME, Commands.none(7)), 0.01 * number)
    watch.check_arm(state(0.59), np.full(7, 0.002 * 45), 0.6)
    assert watch.state is State.RUNNING
    watch.check_arm(state(0.45), np.full(7, 0.002 * 45), 0.6)
    assert "last word" in watch.reason


def test_an_answer_is_awaited_longer_where_the_arm_stands() -> None:
    watch = running()
    watch.asked(1.0)
    watch.check_answer(False, 2.0)
    assert watch.state is State.RUNNING
    watch.check_answer(True, 1.19)
    assert watch.state is State.RUNNING
    watch.check_answer(True, 1.21)
    assert "no action" in watch.reason


def test_answers_that_come_too_late_again_and_again_are_held() -> None:
    watch = running()
    for late in (True, True, False, True, True):  # slow answers before a motion are allowed
        watch.came(late, 1.0)
    assert watch.state is State.RUNNING
    watch.came(True, 2.0)
    assert (watch.state, "3 answers in a row" in watch.reason) == (State.HOLDING, True)


def test_three_overruns_in_a_row_stop() -> None:
    watch = running()
    for late in (0.03, 0.03, 0.0, 0.03, 0.03):
        watch.period(late, 1.0)
    assert watch.state is State.RUNNING
    watch.period(0.03, 1.0)
    assert watch.state is State.STOPPED
