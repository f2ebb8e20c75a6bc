"""The one protocol of arms and cameras, kept by every driver, against fakes of the makers' libraries."""

from __future__ import annotations

import sys
import time
import types
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import fake_makers
import numpy as np
import pytest
from fake_makers import FakeBody

from gensim2.deploy.arm import Arm
from gensim2.deploy.arm_limits import CYCLE, ArmLimits
from gensim2.deploy.drivers import streamed
from gensim2.deploy.drivers.franka import FrankaArm
from gensim2.deploy.drivers.realsense import RealSenseCameras
from gensim2.deploy.drivers.streamed import DriverError, StreamedArm
from gensim2.deploy.drivers.ur import URArm
from gensim2.deploy.drivers.xarm import XArm
from gensim2.deploy.simulated_cameras import simulated_cameras
from gensim2.deploy.watch import State, Watch
from gensim2.errors import InputError, MissingExtraError
from gensim2.robots import robot

PROFILE = robot("panda")  # its seven joints stand for those of any arm here
HOME = np.array(PROFILE.reset_qpos[:7])
KINDS: dict[str, tuple[Callable[..., StreamedArm], Callable[[FakeBody], dict[str, Any]], str]] = {
    "ur": (lambda host, body: URArm(host, PROFILE, body.grips.append), fake_makers.ur, "ur_rtde"),
    "xarm": (lambda host, body: XArm(host, PROFILE, sensor=True), fake_makers.xarm, "xarm-python-sdk"),
    "franka": (lambda host, body: FrankaArm(host, PROFILE), fake_makers.franka, "franky-control"),
}


@pytest.fixture(params=KINDS)
def arm(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[StreamedArm, FakeBody]]:
    make, modules, _ = KINDS[request.param]
    body = FakeBody(7)
    body.q = HOME.copy()
    for name, module in modules(body).items():
        monkeypatch.setitem(sys.modules, name, module)
    found = make("here", body)
    yield found, body
    found.close()


def until(what: Callable[[], bool], seconds: float = 10.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end
        time.sleep(0.002)


def said(driver: StreamedArm) -> Any:
    found: list[Any] = []
    until(lambda: bool(found.extend(driver.poll()) or found))
    return found[-1]


def test_states_say_where_the_arm_is_and_when(arm: tuple[StreamedArm, FakeBody]) -> None:
    driver, _ = arm
    begun = time.monotonic()
    state = said(driver)
    np.testing.assert_allclose(state.q[:7], HOME)
    assert state.q.shape == state.v.shape == (9,)
    assert state.force == pytest.approx(5.0)
    assert state.mode == "ready"
    until(lambda: said(driver).time > begun)


def test_targets_are_gone_to_smoothly_and_nothing_goes_on_without_them(arm: tuple[StreamedArm, FakeBody]) -> None:
    driver, body = arm
    driver.send(HOME, 1.0, 0.0)
    for step in range(1, 21):
        driver.send(HOME + 0.01 * step, 1.0, 0.0)
        time.sleep(CYCLE)
    until(lambda: body.halts > 0)  # no more targets: it stops, and says so
    until(lambda: said(driver).mode == "refusing")
    assert driver.trouble == "no target for 150 ms"
    sent = np.array(body.sent)
    assert (sent >= HOME - 1e-9).all()
    assert (sent <= HOME + 0.2 + 1e-9).all(), "never beyond a target"
    assert (np.diff(sent[:, 0]) >= -1e-9).all()
    count = len(body.sent)
    time.sleep(0.05)
    assert len(body.sent) == count


def test_standing_is_at_once_and_lasts(arm: tuple[StreamedArm, FakeBody]) -> None:
    driver, body = arm
    driver.send(HOME, 1.0, 0.0)
    until(lambda: len(body.sent) > 0)
    driver.stand()
    assert body.halts == 1
    time.sleep(0.02)
    count = len(body.sent)
    time.sleep(0.03)
    assert len(body.sent) == count


def test_the_gripper_is_told_of_changes_only(arm: tuple[StreamedArm, FakeBody]) -> None:
    driver, body = arm
    for command in (1.0, 1.0, -1.0, -1.0, -1.0):
        driver.send(HOME, command, 0.0)
    until(lambda: len(body.grips) > 0)
    time.sleep(0.02)
    assert body.grips == [-1.0]


def test_the_watch_stops_what_refuses_and_what_has_stopped(arm: tuple[StreamedArm, FakeBody]) -> None:
    driver, body = arm
    watch = Watch()
    watch.arm(0.0)
    watch.run(0.0)
    body.refuses = True
    driver.send(HOME, 1.0, 0.0)
    until(lambda: said(driver).mode == "refusing")
    assert driver.trouble is not None
    watch.saw_arm(said(driver), 1.0)
    assert (watch.state, watch.stops_at_once) == (State.STOPPED, True)


def test_a_reflex_is_told(arm: tuple[StreamedArm, FakeBody]) -> None:
    driver, body = arm
    body.stopped = True
    until(lambda: said(driver).mode == "reflex")


def test_a_motion_that_a_reflex_ends_is_a_reflex(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the client says so between two states."""
    body = FakeBody(7)
    monkeypatch.setitem(sys.modules, "franky", fake_makers.franka(body)["franky"])
    driver = FrankaArm("here", PROFILE)
    driver.send(HOME, 1.0, 0.0)
    until(lambda: len(body.sent) > 0)
    body.falls = True
    until(lambda: said(driver).mode != "ready")
    assert (said(driver).mode, driver.trouble) == ("reflex", None)
    driver.close()


class Followed(StreamedArm):
    """A driver without threads that keeps what it is to write."""

    def __init__(self) -> None:
        super().__init__(PROFILE, 200.0)
        self.written: list[tuple[np.ndarray, np.ndarray]] = []
        self.halts = 0

    def _read(self) -> Any:
        return HOME, np.zeros(7), 0.0, "ready"

    def _write(self, q: np.ndarray, v: np.ndarray) -> None:
        self.written.append((q, v))

    def _halt(self) -> None:
        self.halts += 1

    def _grip(self, command: float) -> None: ...

    def _disconnect(self) -> None: ...


def stream(monkeypatch: pytest.MonkeyPatch, came: list[int], cycles: int) -> tuple[Followed, np.ndarray, np.ndarray]:
    """So many targets of a path with 1 rad/s came in each cycle of 5 ms; (k, 7) rad behind the start, and rad/s."""
    now = 100.0
    clock = types.SimpleNamespace(monotonic=lambda: now)
    monkeypatch.setattr(streamed, "time", clock)
    driver, sent = Followed(), 0
    driver._cycle()
    for cycle in range(cycles):
        for _ in range(came[cycle] if cycle < len(came) else 0):
            sent += 1
            driver.send(HOME + CYCLE * sent, 1.0, 0.0)
        now += 0.005
        driver._cycle()
    q, v = (np.array(each) for each in zip(*driver.written, strict=True))
    return driver, q - HOME, v


def test_targets_that_are_late_make_the_arm_neither_halt_nor_hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    steady, pause = [1, 0] * 20, [0] * 16  # 80 ms without a target, then all of them at once
    _, q, v = stream(monkeypatch, [*steady, *pause, 9, 0, *steady * 3], 180)
    assert (np.diff(q, axis=0) >= -1e-12).all()
    assert (np.diff(q, axis=0) <= 0.005 * streamed.FASTER + 1e-12).all(), "from one reference to the next"
    assert (v <= streamed.FASTER + 1e-12).all()
    np.testing.assert_allclose(v[2:40], 1.0, atol=1e-9)
    sent = CYCLE * (20 + 9 + 60)
    assert q[-1, 0] == pytest.approx(sent, abs=3 * CYCLE), "it has made up"


def test_the_last_target_is_reached_smoothly_and_never_passed(monkeypatch: pytest.MonkeyPatch) -> None:
    driver, q, v = stream(monkeypatch, [1, 0] * 20, 90)
    assert (q <= CYCLE * 20 + 1e-12).all()
    assert q[-1, 0] == pytest.approx(CYCLE * 20, abs=1e-3)
    assert (np.diff(v[40:, 0]) <= 1e-12).all()
    assert np.abs(np.diff(v[40:, 0])).max() < 0.5, "no halt at once"
    assert driver.halts == 1
    assert driver.trouble == "no target for 150 ms"


def test_more_targets_than_an_arm_can_follow_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    driver, _, v = stream(monkeypatch, [1] * 80, 80)
    assert (v <= streamed.FASTER + 1e-12).all()
    assert driver.halts == 1, "and stays where it is"
    assert driver.trouble == "more than 100 targets a second"


def test_an_arm_behind_its_limits_goes_where_it_is_asked_to(arm: tuple[StreamedArm, FakeBody]) -> None:
    driver, body = arm
    behind = Arm(driver, ArmLimits.of(PROFILE, speed=0.5))
    until(lambda: bool(behind.poll()))
    behind.begin(behind.joints(behind.state().q))  # type: ignore[union-attr]
    goal = HOME + 0.02
    for _ in range(150):
        behind.poll()
        behind.command(goal, 1.0, time.monotonic())
        time.sleep(0.004)
        if np.abs(body.q - goal).max() < 1e-3:
            return
    raise AssertionError(f"{np.abs(body.q - goal).max()} rad away")


@pytest.mark.parametrize("name", KINDS)
def test_an_arm_that_is_not_there_and_a_library_that_is_not_are_told(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    make, modules, package = KINDS[name]
    body = FakeBody(7)
    fakes = modules(body)
    for module in fakes:
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=rf"{package} is not installed .*gensim2\[{name}\]"):
        make("here", body)
    for module, fake in fakes.items():
        monkeypatch.setitem(sys.modules, module, fake)
    with pytest.raises(DriverError, match="nowhere"):
        make("nowhere", body)


# --------------------------------------------------------------------- cameras

CAMERA = replace(simulated_cameras(PROFILE, 8, 6)[0], name="left")


def test_pictures_come_with_their_time_their_device_and_our_pixel_centres(monkeypatch: pytest.MonkeyPatch) -> None:
    depth, colors = np.full((6, 8), 700, np.uint16), np.zeros((6, 8, 3), np.uint8)
    pictures = [(number, 1e3 * (time.time() - 0.05 + 0.01 * number), depth, colors) for number in range(3)]
    monkeypatch.setitem(sys.modules, "pyrealsense2", fake_makers.realsense(pictures, [0.0] * 5))
    cameras = RealSenseCameras([CAMERA], {"left": "827112070000"})
    np.testing.assert_allclose(cameras.cameras[0].intrinsic, [[10, 0, 4.0], [0, 11, 3.0], [0, 0, 1]])
    frames = cameras.poll()
    assert [frame.number for frame in frames] == [0, 1, 2]
    assert frames[0].serial == cameras.serials["left"] == "827112070000"
    assert time.monotonic() - frames[0].captured == pytest.approx(0.05, abs=0.5)
    assert cameras.poll() == []


def test_cameras_that_cannot_be_used_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", fake_makers.realsense([], [0.1, 0, 0, 0, 0]))
    with pytest.raises(DriverError, match="distorted"):
        RealSenseCameras([CAMERA], {"left": "1"})
    with pytest.raises(InputError, match="no serial number"):
        RealSenseCameras([CAMERA], {})
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(MissingExtraError, match=r"gensim2\[realsense\]"):
        RealSenseCameras([CAMERA], {"left": "1"})
