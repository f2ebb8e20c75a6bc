"""The common interface of arms and cameras, tested for every driver with fakes of the makers' libraries."""

from __future__ import annotations

import sys
import time
import types
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import fake_makers
import numpy as np
import pytest
from fake_makers import FakeBody

from gensim2.core.errors import InputError, MissingExtraError
from gensim2.perception import Camera
from gensim2.robots import robot
from gensim2_robot.arm import LimitedArm
from gensim2_robot.arm_limits import CYCLE, ArmLimits
from gensim2_robot.devices import CameraFrame
from gensim2_robot.drivers import streamed
from gensim2_robot.drivers.franka import FrankaArm, PandaPyArm
from gensim2_robot.drivers.realsense import RealSenseCameras, SoftwareDevice, connected, recorded
from gensim2_robot.drivers.streamed import DriverError, StreamedArm
from gensim2_robot.drivers.ur import URArm
from gensim2_robot.drivers.xarm import XArm
from gensim2_robot.simulated import simulated_cameras, sized
from gensim2_robot.watch import State, Watch

PROFILE = robot("panda")  # any arm with seven joints
HOME = np.array(PROFILE.reset_qpos[:7])
KINDS: dict[str, tuple[Callable[..., StreamedArm], Callable[[FakeBody], dict[str, Any]], str]] = {
    "ur": (lambda host, body: URArm(host, PROFILE, body.grips.append), fake_makers.ur, "ur_rtde"),
    "xarm": (lambda host, body: XArm(host, PROFILE, sensor=True), fake_makers.xarm, "xarm-python-sdk"),
    "franka": (lambda host, body: FrankaArm(host, PROFILE), fake_makers.franka, "franky-control"),
    "panda": (lambda host, body: PandaPyArm(host, PROFILE), fake_makers.panda, "panda-python"),
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
    until(lambda: body.halts > 0)  # without targets it stops and reports it
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


def test_an_arm_that_was_let_stand_takes_targets_again(
    arm: tuple[StreamedArm, FakeBody], monkeypatch: pytest.MonkeyPatch
) -> None:
    driver, body = arm
    monkeypatch.setattr(streamed, "SILENT", 10.0)  # the machine may be busy
    for _ in range(2):
        before = len(body.sent)
        driver.send(HOME, 1.0, 0.0)
        until(lambda before=before: len(body.sent) > before)  # type: ignore[misc]
        driver.stand()
    time.sleep(0.02)
    assert driver.trouble is None
    assert said(driver).mode == "ready"


def test_the_gripper_is_told_of_the_first_command_and_of_changes(arm: tuple[StreamedArm, FakeBody]) -> None:
    driver, body = arm
    for command in (1.0, 1.0, -1.0, -1.0, -1.0):
        driver.send(HOME, command, 0.0)
    until(lambda: body.grips[-1:] == [-1.0])
    time.sleep(0.02)
    assert set(body.grips) <= {1.0, -1.0}  # outdated commands may be skipped
    body.grips.clear()
    driver.send(HOME, -1.0, 0.0)
    time.sleep(0.02)
    assert body.grips == []


def test_a_hand_that_may_hold_something_is_told_what_it_is_to_be_at_the_start(
    arm: tuple[StreamedArm, FakeBody],
) -> None:
    driver, body = arm
    driver.send(HOME, 1.0, 0.0)
    until(lambda: body.grips == [1.0])


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
    assert driver.trouble in watch.reason
    assert (watch.state, watch.stops_at_once) == (State.STOPPED, True)


def test_a_connection_that_is_lost_stops_the_watch_and_says_why(
    arm: tuple[StreamedArm, FakeBody], monkeypatch: pytest.MonkeyPatch
) -> None:
    driver, _ = arm
    last = said(driver)

    def lost() -> Any:
        raise RuntimeError("the socket is closed")

    monkeypatch.setattr(driver, "_read", lost)
    until(lambda: said(driver).mode == "refusing")
    state = said(driver)
    assert state.reason == "RuntimeError: the socket is closed"
    assert last.time <= state.time == said(driver).time, "the last place keeps its time"
    watch = Watch()
    watch.arm(0.0)
    watch.run(0.0)
    watch.saw_arm(state, 1.0)
    assert watch.state is State.STOPPED
    assert "the socket is closed" in watch.reason


def test_a_reflex_is_told(arm: tuple[StreamedArm, FakeBody]) -> None:
    driver, body = arm
    body.stopped = True
    until(lambda: said(driver).mode == "reflex")


@pytest.mark.parametrize("name", ["franka", "panda"])
def test_a_motion_that_a_reflex_ends_is_a_reflex(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Also if the library reports it between two states."""
    make, modules, _ = KINDS[name]
    body = FakeBody(7)
    for module, fake in modules(body).items():
        monkeypatch.setitem(sys.modules, module, fake)
    driver = make("here", body)
    driver.send(HOME, 1.0, 0.0)
    until(lambda: len(body.sent) > 0)
    body.falls = True
    until(lambda: said(driver).mode != "ready")
    assert (said(driver).mode, driver.trouble) == ("reflex", None)
    driver.close()


def test_a_panda_that_has_stopped_by_itself_is_recovered_by_a_person(monkeypatch: pytest.MonkeyPatch) -> None:
    """The library would recover by itself when a motion starts."""
    body = FakeBody(7)
    for module, fake in fake_makers.panda(body).items():
        monkeypatch.setitem(sys.modules, module, fake)
    body.stopped = True
    driver = PandaPyArm("here", PROFILE)
    driver.send(HOME, 1.0, 0.0)
    until(lambda: driver.trouble is not None)
    assert "a person must recover the arm" in str(driver.trouble)
    assert body.sent == []
    assert body.stopped, "nothing has recovered it"
    driver.close()


def test_a_target_that_is_about_to_be_written_when_the_arm_is_told_to_stand_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    driver = Followed()
    driver.send(HOME, 1.0, 0.0)
    play = driver._play

    def stood(now: float) -> Any:
        found = play(now)
        driver._standing = True  # by another thread
        return found

    monkeypatch.setattr(driver, "_play", stood)
    driver._cycle()
    assert driver.written == []


class Followed(StreamedArm):
    """A driver without threads that keeps its targets."""

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
    """Return a driver that got these numbers of targets of a path with 1 rad/s in cycles of 5 ms.

    Returns:
        The driver, and the written positions (k, 7), rad relative to the start, and velocities (k, 7), rad/s.
    """
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
    steady, pause = [1, 0] * 20, [0] * 16  # 80 ms without targets, then all at once
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
    behind = LimitedArm(driver, ArmLimits.of(PROFILE, speed=0.5))
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
    with pytest.raises(MissingExtraError, match=rf"{package} is not installed .*gensim2-robot\[{name}\]"):
        make("here", body)
    for module, fake in fakes.items():
        monkeypatch.setitem(sys.modules, module, fake)
    with pytest.raises(DriverError, match="nowhere"):
        make("nowhere", body)


# --- cameras

LEFT = replace(sized(simulated_cameras(PROFILE, 32, 24), 32, 24)[0], name="left")


class FakeRealSense(types.ModuleType):
    """A fake of the library with a device of two sensors with two rates each, which counts opened devices."""

    def __init__(self) -> None:
        super().__init__("pyrealsense2")
        self.opened: list[str] = []
        self.rates: list[int] = []
        self.fails = ""
        kinds = types.SimpleNamespace(depth="depth", color="color")
        self.stream, self.format = kinds, types.SimpleNamespace(z16="depth", rgb8="color")
        self.camera_info = types.SimpleNamespace(serial_number="serial")
        self.option = types.SimpleNamespace(depth_units="units", global_time_enabled="global")
        self.align, self.syncer = (lambda to: None), (lambda size: None)

    def device(self, depth: tuple[int, ...] = (90, 30), colors: tuple[int, ...] = (60, 30)) -> Any:
        def profile(kind: str, rate: int) -> Any:
            none = types.SimpleNamespace(width=32, height=24, fx=30.0, fy=30.0, ppx=15.5, ppy=11.5, coeffs=[0.0] * 5)
            found = types.SimpleNamespace(
                stream_type=lambda: kind,
                format=lambda: kind,
                fps=lambda: rate,
                width=lambda: 32,
                height=lambda: 24,
                get_intrinsics=lambda: none,
            )
            found.as_video_stream_profile = lambda: found
            return found

        def sensor(kind: str, rates: tuple[int, ...]) -> Any:
            def start(_: Any) -> None:
                if self.fails == kind:
                    raise RuntimeError("failed to set power state")

            def opening(profiles: list[Any]) -> None:
                self.opened.append(kind)
                self.rates += [each.fps() for each in profiles]

            return types.SimpleNamespace(
                supports=lambda option: option == "units" and kind == "depth",
                get_option=lambda option: 1e-3,
                get_stream_profiles=lambda: [profile(kind, rate) for rate in rates],
                open=opening,
                start=start,
                stop=lambda: None,
                close=lambda: self.opened.remove(kind),
            )

        sensors = [sensor("depth", depth), sensor("color", colors)]
        return types.SimpleNamespace(
            is_playback=lambda: False, get_info=lambda what: "827", query_sensors=lambda: sensors
        )


def test_devices_that_were_opened_are_closed_where_another_fails_and_rates_may_be_left_to_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fake = FakeRealSense()
    monkeypatch.setitem(sys.modules, "pyrealsense2", fake)
    right = replace(LEFT, name="right")
    with pytest.raises(InputError, match="right: has no device"):
        RealSenseCameras([LEFT, right], {"left": fake.device()}, 30)
    assert fake.opened == []
    fake.fails = "color"
    with pytest.raises(RuntimeError, match="power state"):
        RealSenseCameras([LEFT], {"left": fake.device()}, 30)
    assert fake.opened == [], "the sensor that had been opened is closed"
    fake.fails, fake.rates = "", []
    RealSenseCameras([LEFT], {"left": fake.device()}).close()
    assert fake.rates == [30, 30], "the highest that both have"
    with pytest.raises(DriverError, match="at one rate"):
        RealSenseCameras([LEFT], {"left": fake.device((90,), (60,))})


@pytest.fixture
def rs() -> Any:
    """The maker's library, whose software devices can be given images."""
    return pytest.importorskip("pyrealsense2", exc_type=ImportError, reason="RealSense's library wants libusb")


def shot(number: int, captured: float, depth: int = 700) -> CameraFrame:
    """Return an image whose colours encode the pixel."""
    rows, columns = np.mgrid[:24, :32].astype(np.uint8)
    return CameraFrame("left", number, captured, np.full((24, 32), depth, np.uint16), np.dstack([rows, columns, rows]))


def filmed(
    device: SoftwareDevice, cameras: RealSenseCameras, count: int
) -> tuple[list[CameraFrame], list[CameraFrame]]:
    """Return images that a device was given, and those that the driver returned."""
    given: list[CameraFrame] = []
    found: list[CameraFrame] = []
    for number in range(count):
        given.append(shot(number, time.monotonic(), 700 + number))
        device.give(given[-1])
        end = time.monotonic() + 1 / 30
        while time.monotonic() < end:
            found += cameras.poll()
            time.sleep(0.001)
    return given, found


def test_pictures_come_with_their_time_their_device_and_our_pixel_centres(rs: Any) -> None:
    device = SoftwareDevice(LEFT, "827112070000", 30)
    cameras = RealSenseCameras([replace(LEFT, intrinsic=np.eye(3))], {"left": device.device}, 30)
    np.testing.assert_allclose(cameras.cameras[0].intrinsic, LEFT.intrinsic, rtol=1e-6)
    given, found = filmed(device, cameras, 12)
    cameras.close()
    numbers = [frame.number for frame in found]
    assert numbers == sorted(set(numbers)), "each comes once"
    assert len(numbers) >= 5, "the library needs a picture or two to tell what belongs together"
    for frame in found:
        sent = given[frame.number]
        np.testing.assert_array_equal(frame.depth, sent.depth)
        off = np.abs(frame.colors.astype(int) - sent.colors.astype(int))
        assert off.max() <= 1, "colours come from the same pixel, or from the next one where it lies between two"
        assert frame.captured == pytest.approx(sent.captured, abs=1e-3)
        assert (frame.camera, frame.serial) == ("left", "827112070000")
    assert cameras.serials == {"left": "827112070000"}


def made_of(file: Path) -> list[CameraFrame]:
    """Return the images of which a recording was made."""
    device = SoftwareDevice(LEFT, "827112070000", 30)
    recorder = RealSenseCameras([LEFT], {"left": device.recorder(file)}, 30)
    given, _ = filmed(device, recorder, 12)
    recorder.close()
    return given


def test_no_picture_of_a_recording_is_of_the_future(rs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from gensim2_robot.drivers import realsense

    made_of(tmp_path / "left.db3")
    cameras = RealSenseCameras([LEFT], recorded({"left": tmp_path / "left.db3"}))
    late, found = 0.5, list[CameraFrame]()
    slow = types.SimpleNamespace(monotonic=lambda: time.monotonic() + late)
    monkeypatch.setattr(realsense, "time", slow)
    until(lambda: bool(found.extend(cameras.poll())) or bool(found))
    late, first = 0.0, len(found)
    until(lambda: bool(found.extend(cameras.poll())) or len(found) > first + 2)
    cameras.close()
    assert max(frame.captured for frame in found[first:]) <= time.monotonic()


def test_a_recording_is_played_again_and_again_at_its_own_rate(rs: Any, tmp_path: Path) -> None:
    file = tmp_path / "left.db3"
    given = made_of(file)
    # A recording has its own size and rate, so none is requested.
    there = replace(LEFT, width=320, height=240)
    cameras = RealSenseCameras([there], recorded({"left": file}))
    assert (cameras.cameras[0].width, cameras.serials) == (32, {"left": "827112070000"})
    found: list[CameraFrame] = []
    until(lambda: bool(found.extend(cameras.poll())) or len(found) > 18)
    cameras.close()
    assert [frame.number for frame in found] == list(range(len(found))), "numbers go on when it begins again"
    first = [int(frame.depth[0, 0]) for frame in found]
    again = next(place for place in range(1, len(first)) if first[place] < first[place - 1])
    assert again > 2
    # A busy machine loses images, as with a real camera.
    apart = np.diff([frame.captured for frame in found[:again]])
    known = np.diff([given[depth - 700].captured for depth in first[:again]])
    assert np.median(np.abs(apart - known)) < 1e-3, "but where a busy machine gave the first ones late"
    assert (apart < known + 1e-3).all(), "which are dated back, never ahead"


def test_cameras_that_cannot_be_used_are_told(rs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DriverError, match="the device 1 is not connected; connected devices: none"):
        connected({"left": "1"})
    with pytest.raises(InputError, match="no device"):
        RealSenseCameras([LEFT], {})
    with pytest.raises(InputError, match="the recording does not exist"):
        recorded({"left": tmp_path / "none.db3"})
    (tmp_path / "text.db3").write_text("no recording")
    with pytest.raises(InputError, match=r"text\.db3.*is no recording"):
        recorded({"left": tmp_path / "text.db3"})
    (tmp_path / "text.bag").write_text("#ROSBAG V2.0\n")
    with pytest.raises(InputError, match=r"text\.bag.*is no recording.*convert_bag_to_db3"):
        recorded({"left": tmp_path / "text.bag"})
    with pytest.raises(DriverError, match="no depth and colours of 64x24 at 30 Hz; it has: 32x24 at 30 Hz"):
        RealSenseCameras([replace(LEFT, width=64)], {"left": SoftwareDevice(LEFT, "1", 30).device}, 30)

    class Distorted(SoftwareDevice):
        def _intrinsics(self, camera: Camera) -> Any:
            found = super()._intrinsics(camera)
            found.model, found.coeffs = rs.distortion.brown_conrady, [0.1, 0, 0, 0, 0]
            return found

    with pytest.raises(DriverError, match="distortion"):
        RealSenseCameras([LEFT], {"left": Distorted(LEFT, "1", 30).device}, 30)
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(MissingExtraError, match=r"gensim2-robot\[realsense\]"):
        connected({"left": "1"})


def test_a_device_whose_times_are_its_own_clocks_is_told(rs: Any) -> None:
    class Own(SoftwareDevice):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            self.domain = rs.timestamp_domain.hardware_clock

    device = Own(LEFT, "1", 30)
    cameras = RealSenseCameras([LEFT], {"left": device.device}, 30)
    with pytest.raises(DriverError, match="the device's own clock"):
        filmed(device, cameras, 8)
    cameras.close()
