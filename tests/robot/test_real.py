"""Real devices by command-line options, with a fake arm and software cameras; and the live page."""

from __future__ import annotations

import contextlib
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import fake_makers
import numpy as np
import pytest
from fake_cameras import LEFT, Filmed
from fake_makers import FakeBody

from gensim2.core.errors import GenSim2Error, InputError
from gensim2.perception import ObservationSpec
from gensim2.perception.camera_record import CameraRecord
from gensim2.perception.observation import CLOUD
from gensim2.robots import robot
from gensim2.rollout.controller_spec import CHAIN, ControllerSpec
from gensim2.rollout.inputs import read_task_input
from gensim2_robot import real
from gensim2_robot.cli.robot import _show
from gensim2_robot.clocks import SimulatedClock
from gensim2_robot.config import CameraSource, Delays, LineConfig
from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.drivers.logged import LoggedCameras
from gensim2_robot.line import LoopFigures
from gensim2_robot.log import Log
from gensim2_robot.log_messages import About, PictureMessage
from gensim2_robot.log_reader import about_of, messages, replay
from gensim2_robot.mind import ControllerAnswer
from gensim2_robot.opening import prepare
from gensim2_robot.pipes import SLOTS
from gensim2_robot.real import open_cameras
from gensim2_robot.run import run
from gensim2_robot.session import PATIENCE, result
from gensim2_robot.simulated import simulated_cameras
from gensim2_robot.watch import State, Watch, WatchRules

PROFILE = robot("panda")
HOME = np.array(PROFILE.reset_qpos[:7])
PATIENT = WatchRules(
    frame_age=60.0,
    apart=60.0,
    no_action=60.0,
    thinking=60.0,
    late_answers=10**6,
    state_age=60.0,
    behind=10.0,
    overrun=60.0,
)


class SeesKeypoints:
    """A fake controller that needs keypoints, which only a simulator knows."""

    observation_spec: ClassVar = {"points": 64, "source": "keypoints"}

    def reset(self, observation: Any, seed: int) -> None:
        """Do nothing."""

    def act(self, observation: Any) -> None:
        """Return None: the episode is done."""


STILL = ControllerSpec("gensim2.policy.no_op:NoOpPolicy", {"arm": 7})
REAL: dict[str, Any] = {
    "arm": "franka:here",
    "cameras": "realsense:left=827112070000",
    "pixels": (32, 24),
    "rate": 20.0,
    "rules": PATIENT,
}


@pytest.fixture
def body(monkeypatch: pytest.MonkeyPatch) -> FakeBody:
    """A fake arm, and a software device of the real library instead of a connected camera."""
    pytest.importorskip("pyrealsense2", exc_type=ImportError, reason="RealSense's library wants libusb")
    found = FakeBody(7)
    found.q = HOME.copy()
    for name, module in fake_makers.franka(found).items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(real, "realsense_cameras", Filmed)
    return found


def test_a_dry_run_reaches_the_drivers_and_moves_nothing_and_a_run_does(body: FakeBody, tmp_path: Path) -> None:
    from gensim2_robot.calibration.file import Calibration

    given: dict[str, Any] = {"policy": STILL, "assets": "builtin", "speed": 1.0, "minutes": 1.0, **REAL}
    found = run("CloseBox", dry=True, log=tmp_path / "log", **given)
    assert found["state"] == "idle", found["reason"]
    assert (found["episodes"], found["success"], found["limits_passed"]) == (1, None, 0)
    assert body.sent == []
    kinds = list(messages(tmp_path / "log"))
    assert {each.serial for _, each in kinds if isinstance(each, PictureMessage)} == {"827112070000"}
    assert {topic for topic, _ in kinds} >= {"/arm", "/answer", "/sent", "/watch"}
    with pytest.raises(InputError, match="--calibration"):
        run("CloseBox", **given)
    assert body.sent == []
    pose, intrinsic = LEFT.T_base_camera, LEFT.intrinsic.tolist()
    camera = {"serial": "827112070000", "method": "mesh", "link": None, "pose": pose.tolist(), "width": 320}
    camera |= {"height": 24, "intrinsic": intrinsic, "residual_mm": 0.5, "held_out_mm": 0.5}
    made = {"made": time.strftime("%Y-%m-%dT%H:%M:%S+00:00", time.gmtime()), "robot": "panda"}
    path = tmp_path / "calibration.json"
    Calibration.model_validate({**made, "cameras": {"left": camera}}).write(path)
    with pytest.raises(InputError, match="320x24 pixels, the camera gives 32x24"):
        run("CloseBox", calibration=path, **given)
    Calibration.model_validate({**made, "cameras": {"left": {**camera, "width": 32}}}).write(path)
    found = run("CloseBox", calibration=path, **given)
    assert found["state"] == "idle", found["reason"]
    assert len(body.sent) > 10
    np.testing.assert_allclose(body.sent, np.broadcast_to(HOME, (len(body.sent), 7)), atol=0.02)
    assert body.halts > 0, "it is left standing by its own means"


def test_cameras_that_are_to_be_calibrated_are_logged_without_clouds(body: FakeBody, tmp_path: Path) -> None:
    from gensim2_robot.live import looking

    decides = looking("panda", ["left"], clouds=False)
    given: dict[str, Any] = {**REAL, "policy": decides, "assets": "builtin", "dry": True}
    assert not prepare(read_task_input("CloseBox", assets="builtin"), LineConfig.split(given)[0]).seen.modalities
    found = run("CloseBox", minutes=0.01, log=tmp_path, **given)
    assert found["state"] == "idle", found["reason"]
    assert [camera.name for camera in about_of(tmp_path).cameras] == ["left"]
    assert about_of(tmp_path).observation["cameras"] == ["left"]


def test_words_that_cannot_be_used_are_told() -> None:
    assert CameraSource.parse("realsense:left=1,right=2") == CameraSource("realsense", {"left": "1", "right": "2"})
    assert CameraSource.parse("recording:left=a/b.db3").devices == {"left": "a/b.db3"}
    for word in (
        "realsense",
        "realsense:1",
        "kinect:left=1",
        "realsense:left=1,left=2",
        "simulated:left=1",
        "recording:",
    ):
        with pytest.raises(InputError, match="--cameras"):
            CameraSource.parse(word)
    with pytest.raises(InputError, match="unknown arm 'franka'"):
        LineConfig(arm="franka", cameras="realsense:left=1", policy=STILL)
    for arm, cameras in (("simulated", "realsense:left=1"), ("ur:1", "software"), ("ur:1", "recording:left=a.db3")):
        with pytest.raises(InputError, match="both are real, or both are simulated"):
            LineConfig(arm=arm, cameras=cameras, policy=STILL)
    with pytest.raises(InputError, match=r"only in a dry run.*dry-run"):
        LineConfig(cameras="recording:left=a.db3", policy=STILL)
    for cameras in ("software", "recording:left=a.db3"):
        with pytest.raises(InputError, match="clock"):
            LineConfig(cameras=cameras, policy=STILL, simulated_clock=True, dry=True)
    for given, said in (
        ({"rate": 0.0}, "rate"),
        ({"rate": float("nan")}, "rate"),
        ({"pixels": (0, 48)}, "pixels"),
        ({"pixels": (64, 48, 3)}, "pixels"),
        ({"delays": Delays(camera=(0.0, 0.1))}, r"delays.*simulated_clock"),
    ):
        with pytest.raises(InputError, match=said):
            LineConfig(policy=STILL, **given)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="'top'"):
        open_cameras(CameraSource.parse("realsense:top=1"), simulated_cameras(PROFILE, 64, 48), 30)


def test_a_run_without_episodes_or_with_several_of_a_real_arm_is_refused() -> None:
    with pytest.raises(InputError, match=r"episodes: must be at least 1, not 0"):
        run("CloseBox", episodes=0, assets="builtin", policy=STILL)
    with pytest.raises(InputError, match=r"episodes: .*gensim2 robot trial"):
        run("CloseBox", episodes=2, assets="builtin", policy=STILL, **REAL)
    with pytest.raises(InputError, match="minutes: must be positive and less than 100000, but is 200000"):
        run("CloseBox", minutes=2e5, assets="builtin", policy=STILL)


def test_what_was_opened_is_closed_where_a_later_step_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    from gensim2_robot import local, opening, processes

    closed: list[str] = []

    def refuse(*_: Any) -> None:
        raise GenSim2Error("the controller cannot be made")

    class Opened:
        def close(self) -> None:
            closed.append("real")

    given = read_task_input("CloseBox", assets="builtin")
    monkeypatch.setattr(local, "LocalMind", refuse)
    monkeypatch.setattr(local.LocalArm, "close", lambda self: closed.append("simulated"))
    prepared = prepare(given, LineConfig(policy=STILL, simulated_clock=True, pixels=(64, 48)))
    with pytest.raises(GenSim2Error, match="cannot be made"), opening.opened(prepared):
        pass
    monkeypatch.setattr(processes, "ProcessMind", refuse)
    monkeypatch.setattr(opening, "open_arm", lambda *_: Opened())
    real_one = prepare(given, LineConfig(policy=STILL, dry=True, **REAL))
    with pytest.raises(GenSim2Error, match="cannot be made"):
        opening._real(real_one, None, None, None)  # type: ignore[arg-type]
    assert closed == ["simulated", "real"]


class FailsLater:
    """A control loop that cannot start, by an error that is no GenSim2Error, or runs."""

    def __init__(self, fails: bool) -> None:
        self.fails, self.begun, self.released = fails, False, 0
        self.arm = SimpleNamespace(sent=None, release=self._release, state=lambda: "where it stands")
        self.watch = SimpleNamespace(state=State.RUNNING, reason="", hold=lambda *_: None)
        self.frames: dict[str, Any] = {}
        self.stopped_ms = 0.0

    def _release(self) -> None:
        self.released += 1

    def begin(self, seed: int) -> None:
        if self.fails:
            raise KeyError("joint 9")
        self.begun = True

    def cycle(self) -> None:
        time.sleep(0.001)


def test_what_fails_in_the_loops_thread_is_told_all_is_closed_and_a_second_try_connects(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from gensim2_robot import puppet as puppets

    lines = [FailsLater(True), FailsLater(False)]
    closed: list[int] = []

    @contextlib.contextmanager
    def opened(*_: Any, **__: Any) -> Iterator[Any]:
        number = len(closed)
        try:
            yield SimpleNamespace(line=lines[number], devices=SimpleNamespace(clock=SimulatedClock()))
        finally:
            closed.append(number)

    monkeypatch.setattr(puppets, "opened", opened)
    monkeypatch.setattr(puppets.Session, "__init__", lambda *_: None)
    monkeypatch.setattr(puppets.Session, "prepare", lambda *_: True)
    assert puppets.READY > PATIENCE, "the session says what is lacking"
    puppet = puppets.Puppet(assets="builtin")
    with pytest.raises(puppets.HaltedError, match="KeyError: 'joint 9'"):
        puppet.connect()
    assert closed == [0]
    assert not puppet.is_connected
    puppet.connect()
    assert puppet.is_connected
    assert lines[1].begun
    assert puppet.state() == "where it stands"
    puppet.close()
    assert closed == [0, 1]
    assert [line.released for line in lines] == [1, 1]


def test_what_is_shown_the_truth_and_simulated_faults_need_a_simulation() -> None:
    from gensim2_robot.faults import Fault

    given = read_task_input("CloseBox", assets="builtin")
    with pytest.raises(InputError, match="true state of the scene"):
        prepare(given, LineConfig(policy=ControllerSpec(CHAIN, {"strategies": given.strategies}), **REAL))
    with pytest.raises(InputError, match="keypoints of the objects, which no camera provides"):
        prepare(given, LineConfig(policy=ControllerSpec(f"{__file__}:SeesKeypoints")))
    with pytest.raises(InputError, match="can only be injected into simulated devices"):
        prepare(given, LineConfig(policy=STILL, dry=True, **REAL), [Fault("camera-frozen", 1.0)])


def test_times_of_the_table_name_their_clock(capsys: pytest.CaptureFixture[str]) -> None:
    about = About(robot="panda", language="close it", observation=ObservationSpec().to_dict(), cameras=[])
    figures = LoopFigures(periods=[0.1], picture_age_ms=[60.0], encoding_ms=[482.0])
    found = result(about, None, Watch(), figures, [])
    for scheduling, is_said in (("simulated", True), ("other", False)):
        _show({**found, "scheduling": scheduling})
        printed = capsys.readouterr().out
        assert "age of the pictures in the point cloud" in printed
        assert ("computing times are in real time; the other rows are in simulated time" in printed) == is_said


def test_the_page_shows_robot_cloud_next_actions_and_clocks() -> None:
    pytest.importorskip("viser")
    from gensim2_robot.live import LivePage

    q = np.array(PROFILE.reset_qpos)
    cloud = np.random.default_rng(0).random((50, 6), dtype=np.float32)
    actions = np.tile(np.append(q[:7], 1.0), (3, 1)).astype(np.float32)
    actions[1:, 0] += 0.1
    actions[2, 3] = np.nan
    with LivePage("panda", "CloseBox", port=18260) as page:
        with urllib.request.urlopen(page.url, timeout=10) as answer:
            assert answer.status == 200
        page.state(ArmState(1.0, q, np.zeros(9), 3.0))
        page.answer(1.0, ControllerAnswer(0, actions, seen={CLOUD: cloud}, cloud_ms=31.0, acting_ms=7.0))
        page.change(1.0, "running", "episode started")
        page.clocks(1.0, 0.002, {"left": 0.04})
        page.draw()
        np.testing.assert_allclose(page._cloud.points, cloud[:, :3], atol=1e-3)
        tool = PROFILE.model.forward_kinematics(q, PROFILE.tool_link)[:3, 3]
        assert page._next.points.shape == (2, 3), "the target that is no number is not drawn"
        np.testing.assert_allclose(page._next.points[0], tool, atol=1e-3)
        for word in ("running: episode started", "2.0 ms late", "left 40 ms", "ready 31 ms", "force 3 N"):
            assert word in page._said.content
        names = {name: handle for (_, handle), name in zip(page._links, page.shown, strict=True)}
        hand = PROFILE.model.forward_kinematics(q, "panda_hand")[:3, 3]
        np.testing.assert_allclose(names["panda_hand"].position, hand, atol=1e-6)


def watched(puppet: Any, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        puppet.state()


def test_a_loop_elsewhere_moves_the_arm_behind_limits_and_watch(body: FakeBody, tmp_path: Path) -> None:
    from gensim2_robot.puppet import HaltedError, Puppet

    arguments: dict[str, Any] = {**REAL, "assets": "builtin", "speed": 0.5}
    puppet = Puppet(move=False, **arguments)
    with pytest.raises(HaltedError, match="not connected"):
        puppet.state()
    puppet.connect()
    try:
        assert puppet.cameras == {"left": (24, 32)}
        np.testing.assert_allclose(puppet.state().q[:7], HOME)
        assert puppet.frames()["left"].depth.shape == (24, 32)
        goal, sent = HOME + 0.03, HOME  # within the leash of an arm that stands still
        end = time.monotonic() + 120.0  # long for a busy machine: commands wait for the watch
        while np.abs(sent - goal).max() >= 1e-3 and time.monotonic() < end:
            sent = puppet.send(goal, 1.0)
            time.sleep(0.05)
        np.testing.assert_allclose(sent, goal, atol=1e-3)
        assert body.sent == [], "a dry one sends nothing"
        puppet.send(np.full(7, np.nan), 1.0)
        with pytest.raises(HaltedError, match="holding: refused"):
            watched(puppet, 10.0)
    finally:
        puppet.close()
    assert not puppet.is_connected


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of two simulated cameras."""
    folder = tmp_path_factory.mktemp("run") / "log"
    found = run(
        "CloseBox",
        policy=STILL,
        assets="builtin",
        pixels=(48, 36),
        speed=1.0,
        minutes=0.01,
        simulated_clock=True,
        log=folder,
    )
    assert found["state"] == "idle", found["reason"]
    return folder


def pictures(folder: Path, name: str) -> list[tuple[float, bytes]]:
    return [
        (message.captured, message.depth.tobytes() + message.colors.tobytes())
        for _, message in messages(folder)
        if isinstance(message, PictureMessage) and message.camera == name
    ]


def test_a_log_is_played_as_cameras_again_and_again(log: Path, tmp_path: Path) -> None:
    file = log / "log_000000.mcap"
    given: dict[str, Any] = {"policy": STILL, "assets": "builtin", "speed": 1.0, "dry": True, "rules": PATIENT}
    found = run("CloseBox", cameras=f"recording:left={log},front={file}", minutes=0.05, log=tmp_path / "again", **given)
    assert found["state"] == "idle", found["reason"]
    about = {name: about_of(folder).cameras for name, folder in (("then", log), ("now", tmp_path / "again"))}
    assert about["now"] == [each for name in ("left", "front") for each in about["then"] if each.name == name]
    for name in ("left", "front"):
        then, now = pictures(log, name), pictures(tmp_path / "again", name)
        assert len(now) > len(then) > 3, "it has begun again"
        assert {shown for _, shown in now} <= {shown for _, shown in then}
    assert replay(tmp_path / "again").different == ()


def test_pictures_of_a_log_keep_their_times_and_those_of_other_cameras(log: Path) -> None:
    there = simulated_cameras(PROFILE, 48, 36)
    played = LoggedCameras([camera for camera in there if camera.name != "right"], {"left": log, "front": log})
    then = {name: pictures(log, name) for name in ("left", "front")}
    now: dict[str, list[Any]] = {"left": [], "front": []}
    while len(now["left"]) < len(then["left"]) + 2:
        for frame in played.poll():
            assert frame.captured <= time.monotonic()
            now[frame.camera].append(frame)
    begun = now["left"][0].captured - then["left"][0][0]
    over = begun + min(film[-1][0] for film in then.values()) + 1e-6
    for name, frames in now.items():
        assert [frame.number for frame in frames] == list(range(len(frames)))
        first = [frame for frame in frames if frame.captured <= over]
        assert len(first) >= len(then[name]) - 1, "pictures behind the end of the other camera may be left out"
        for frame, (taken, shown) in zip(first, then[name], strict=False):
            assert frame.captured == pytest.approx(taken + begun, abs=1e-6)
            assert frame.depth.tobytes() + frame.colors.tobytes() == shown
    assert now["left"][len(then["left"])].captured > now["left"][len(then["left"]) - 1].captured, (
        "it begins again later"
    )
    played.close()


def test_pictures_of_one_instant_are_not_kept_in_memory(tmp_path: Path) -> None:
    camera = simulated_cameras(PROFILE, 48, 36)[0]
    spec = ObservationSpec(cameras=(camera.name,), modalities=())
    written = Log(
        tmp_path, About(robot="panda", language="", observation=spec.to_dict(), cameras=[CameraRecord.of(camera)])
    )
    depth, colors = np.zeros((36, 48), np.uint16), np.zeros((36, 48, 3), np.uint8)
    for number in range(50):
        written.frame(CameraFrame(camera.name, number, 1.0, depth, colors))
    written.close()
    played = LoggedCameras([camera], {camera.name: tmp_path})
    assert [frame.number for frame in played.poll()] == list(range(50 - SLOTS, 50))
    played.close()


def test_logs_that_cannot_be_played_are_told(log: Path, tmp_path: Path) -> None:
    there = simulated_cameras(PROFILE, 48, 36)
    (tmp_path / "none").mkdir()
    (tmp_path / "cut.mcap").write_bytes((log / "log_000000.mcap").read_bytes()[:5000])
    for word, said in (
        ("recording:left=nowhere.mcap", "the recording does not exist"),
        (f"recording:left={tmp_path / 'none'}", "contains no log"),
        (f"recording:left={tmp_path / 'cut.mcap'}", "cut.mcap.*has no message"),
        (f"recording:left={log},right=right.db3", "some are logs.*of one kind"),
    ):
        with pytest.raises(InputError, match=said):
            open_cameras(CameraSource.parse(word), there, 10)
