"""Device processes are stopped or killed: the run ends in time with a reason, and leaves no process."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from disks import can_mount, on_disk
from fake_cameras import announce, repeat

from gensim2.cli import main as cli
from gensim2.core.errors import MissingExtraError
from gensim2.perception import ObservationSpec
from gensim2.rollout.controller_spec import ControllerSpec
from gensim2_robot import opening, processes, real, session
from gensim2_robot.drivers.streamed import DriverError
from gensim2_robot.limits import Sent
from gensim2_robot.live import PATIENT
from gensim2_robot.log import Journals
from gensim2_robot.pipes import MAX_WAITING, DeviceGoneError, PictureSlots, Room
from gensim2_robot.processes import ENDING, KILLED, DeviceProcess
from gensim2_robot.run import run
from gensim2_robot.watch import WatchRules

SLOW = WatchRules(2.0, 2.0, 4.0, 60.0, 10**6, 2.0, 10.0, overrun=60.0)
"""Rules for a busy machine: a stopped arm or camera is noticed after two seconds. A stopped controller is noticed after
four seconds, because a planner that waits for a stopped arm gives no action either.
"""
RUN: dict[str, Any] = {"assets": "builtin", "pixels": (64, 48), "minutes": 1.0, "speed": 0.3, "rules": SLOW}
WORDS = ["robot", "run", "CloseBox", "--plan", "--assets", "builtin", "--real-time", "--no-log", "--pixels", "64x48"]
SHUTDOWN = 3 * (ENDING + KILLED)
"""Seconds within which three processes are ended, whatever they do."""
MARGIN = 60.0
"""Time limit in seconds, long for a busy machine."""
DEVICES = ("arm", "cameras", "controller")


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait less for stopped processes than a run does."""
    monkeypatch.setattr(processes, "ENDING", 0.5)


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> dict[str, DeviceProcess]:
    """Device processes by name, as they start."""
    found: dict[str, DeviceProcess] = {}
    start = DeviceProcess.__init__

    def noted(self: DeviceProcess, what: str, *arguments: Any) -> None:
        start(self, what, *arguments)
        found[what] = self

    monkeypatch.setattr(DeviceProcess, "__init__", noted)
    return found


def at_start(monkeypatch: pytest.MonkeyPatch, device: str, number: signal.Signals) -> None:
    """Send a signal to a device's process as soon as it has started."""
    start = DeviceProcess.__init__

    def hit(self: DeviceProcess, what: str, *arguments: Any) -> None:
        start(self, what, *arguments)
        if what == device:
            os.kill(self.pid or 0, number)

    monkeypatch.setattr(DeviceProcess, "__init__", hit)


class After(Journals):
    """Calls a function once, after the given number of commands that move the arm."""

    def __init__(self, count: int, what: Callable[[], None]) -> None:
        super().__init__()
        self._left, self._what = count, what

    def sent(self, time: float, sent: Sent, gripper: float) -> None:
        self._left -= np.abs(sent.v).max() > 0.01
        if self._left == 0:
            self._left -= 1
            self._what()


def none_left(started: dict[str, DeviceProcess]) -> bool:
    return len(started) == len(DEVICES) and not any(each.is_alive for each in started.values())


@pytest.mark.parametrize(
    ("device", "said"),
    [("arm", "the scene is not laid out"), ("cameras", "did not open"), ("controller", "controller is not made")],
)
def test_a_process_that_is_stopped_at_the_start_ends_the_run(
    monkeypatch: pytest.MonkeyPatch, started: dict[str, DeviceProcess], device: str, said: str
) -> None:
    monkeypatch.setattr(real, "OPENING", 60.0 if device != "cameras" else 2.0)
    monkeypatch.setattr(session, "PATIENCE", 2.0)
    at_start(monkeypatch, device, signal.SIGSTOP)
    begun = time.monotonic()
    found = run("CloseBox", **RUN)
    assert time.monotonic() - begun < 2.0 + SHUTDOWN + MARGIN
    assert found["state"] == "stopped"
    assert said in found["reason"]
    assert none_left(started)


@pytest.mark.parametrize(
    ("device", "said"), [("arm", "lags|picture is"), ("cameras", "picture is"), ("controller", "no action")]
)
def test_a_process_that_is_stopped_in_motion_ends_the_run(
    started: dict[str, DeviceProcess], device: str, said: str
) -> None:
    begun = 0.0

    def stop() -> None:
        nonlocal begun
        os.kill(started[device].pid or 0, signal.SIGSTOP)
        begun = time.monotonic()

    found = run("CloseBox", **RUN, watching=[After(20, stop)])
    assert begun, f"nothing was sent: {found['reason']}"
    assert time.monotonic() - begun < SLOW.no_action + session.COMING_TO_REST + SHUTDOWN + MARGIN
    assert found["state"] == "holding"
    assert re.search(said, found["reason"])
    assert none_left(started)


@pytest.mark.parametrize("device", DEVICES)
def test_a_process_that_is_stopped_at_the_end_does_not_hold_it_up(
    monkeypatch: pytest.MonkeyPatch, started: dict[str, DeviceProcess], device: str
) -> None:
    close = DeviceProcess.close
    begun = 0.0

    def stopped(self: DeviceProcess) -> list[Any]:
        nonlocal begun
        begun = begun or time.monotonic()
        if self is started.get(device):
            os.kill(self.pid or 0, signal.SIGSTOP)
        return close(self)

    monkeypatch.setattr(DeviceProcess, "close", stopped)
    found = run("CloseBox", **{**RUN, "minutes": 0.01})
    assert time.monotonic() - begun < SHUTDOWN + MARGIN
    assert found["state"] in ("idle", "holding"), found["reason"]
    assert none_left(started)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_a_run_whose_arm_is_stopped(started: dict[str, DeviceProcess], number: signal.Signals) -> None:
    """These rules tolerate everything, so only the signal ends the run."""

    def stop() -> None:
        os.kill(started["arm"].pid or 0, signal.SIGSTOP)
        threading.Timer(2.0, os.kill, (os.getpid(), number)).start()

    begun = time.monotonic()
    found = run("CloseBox", **{**RUN, "rules": PATIENT}, watching=[After(20, stop)])
    assert time.monotonic() - begun < 60.0 + SHUTDOWN + MARGIN
    assert found["interrupted"] == [number.name]
    assert (found["state"], number.name in found["reason"]) == ("stopped", True)
    assert none_left(started)


def test_an_arm_that_reads_nothing_is_gone(started: dict[str, DeviceProcess]) -> None:
    def stop() -> None:
        os.kill(started["arm"].pid or 0, signal.SIGSTOP)

    found = run("CloseBox", **{**RUN, "rules": PATIENT}, watching=[After(20, stop)])
    assert (found["state"], found["reason"]) == ("stopped", "the process of the arm does not answer")
    assert none_left(started)


@pytest.mark.parametrize("device", DEVICES)
def test_a_process_that_is_killed_while_devices_start_ends_the_run_with_json(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, device: str
) -> None:
    at_start(monkeypatch, device, signal.SIGKILL)
    out = tmp_path / "out.json"
    assert cli.run([*WORDS, "--json", str(out)]) == 1
    found = json.loads(out.read_text())
    assert (found["state"], "has ended" in found["reason"]) == ("stopped", True), found["reason"]
    assert (found["task"], found["episodes"], found["periods_ms"]["p50"]) == ("CloseBox", 0, None)


@pytest.mark.parametrize(
    "error", [DriverError("the arm refuses"), MissingExtraError("rtde_control", "ur", "gensim2-robot")]
)
def test_a_device_that_cannot_be_opened_ends_the_run_with_json(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, error: Exception
) -> None:
    def refuse(*_: object) -> None:
        raise error

    monkeypatch.setattr(opening, "_in_processes", refuse)
    out = tmp_path / "out.json"
    assert cli.run([*WORDS, "--json", str(out)]) == 1
    found = json.loads(out.read_text())
    assert (found["state"], found["reason"], found["episodes"]) == ("stopped", str(error), 0)


@pytest.mark.skipif(not can_mount(), reason="mounts a file system of its own")
@pytest.mark.parametrize(
    ("mounted", "said"),
    [
        ("ro", "Read-only file system"),
        ("size=100k", "cameras is lost: 0.3 MB of shared memory for camera images cannot be allocated: No space left"),
        (
            "size=400k",
            "0.3 MB of shared memory for camera images cannot be allocated: No space left",
        ),  # for the controller
    ],
)
def test_a_run_without_shared_memory_ends_with_json(tmp_path: Path, mounted: str, said: str) -> None:
    out = tmp_path / "out.json"
    command = [*on_disk(mounted, Path("/dev/shm")), sys.executable, "-m", "gensim2", *WORDS, "--json", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False, timeout=300)
    assert (done.returncode, "Traceback" in done.stderr) == (1, False), done.stderr
    found = json.loads(out.read_text())
    assert (found["state"], said in found["reason"]) == ("stopped", True), found["reason"]


def test_a_signal_ends_a_run_whose_cameras_do_not_open(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    number = signal.SIGTERM
    at_start(monkeypatch, "cameras", signal.SIGSTOP)
    out = tmp_path / "out.json"
    threading.Timer(8.0, os.kill, (os.getpid(), number)).start()
    begun = time.monotonic()
    assert cli.run([*WORDS, "--json", str(out)]) == 128 + number
    assert time.monotonic() - begun < 8.0 + SHUTDOWN + MARGIN
    assert json.loads(out.read_text())["interrupted"] == [number.name]


class Hanging:
    """A controller that never answers."""

    observation_spec = ObservationSpec(modalities=())

    def reset(self, observation: Any, seed: int) -> None:
        pass

    def act(self, observation: Any) -> None:
        threading.Event().wait()


def test_a_signal_ends_a_run_by_the_simulated_clock_whose_controller_hangs() -> None:
    threading.Timer(8.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    begun = time.monotonic()
    hanging = ControllerSpec(f"{__file__}:Hanging")
    found = run("CloseBox", policy=hanging, assets="builtin", pixels=(64, 48), simulated_clock=True)
    assert time.monotonic() - begun < 8.0 + MARGIN
    assert (found["state"], found["interrupted"]) == ("stopped", ["SIGINT"])
    assert "asked the program to stop (signal SIGINT)" in found["reason"]


# --- the pipe


def until_drained(process: DeviceProcess, count: int) -> list[Any]:
    found: list[Any] = []
    end = time.monotonic() + 30.0
    while len(found) < count:
        assert time.monotonic() < end
        found += process.drain()
        time.sleep(0.001)
    return found


def test_messages_of_any_size_come_whole_and_in_order() -> None:
    process = DeviceProcess("echo", repeat, 3, 10 << 20)
    assert [len(each) for each in until_drained(process, 3)] == [10 << 20] * 3
    sent = [bytes(size) for size in (0, 1, 70_000, 1, 3 << 20, 5)]
    for each in sent:
        process.tell(each)
    assert until_drained(process, len(sent)) == sent
    process.close()


def test_neither_sending_nor_looking_waits_for_a_stopped_process() -> None:
    process = DeviceProcess("echo", repeat, 1, 50 << 20)
    time.sleep(1.0)  # in the middle of a message
    os.kill(process.pid or 0, signal.SIGSTOP)
    begun = time.monotonic()
    for _ in range(100):
        assert process.drain() == []
    for _ in range(MAX_WAITING + 400):
        process.tell(bytes(1000))
    with pytest.raises(DeviceGoneError, match="the process of the echo does not answer"):
        process.drain()
    assert time.monotonic() - begun < 5.0
    process.close()
    assert time.monotonic() - begun < 5.0 + ENDING + KILLED
    assert not process.is_alive


def test_shared_memory_of_a_controller_that_was_never_polled_is_removed(monkeypatch: pytest.MonkeyPatch) -> None:
    entered = []
    enter = PictureSlots.enter

    def noted(room: Room) -> PictureSlots:
        entered.append(room.name)
        return enter(room)

    monkeypatch.setattr(PictureSlots, "enter", noted)
    monkeypatch.setattr(processes, "_serve_mind", announce)
    monkeypatch.setattr(processes, "ENDING", MARGIN)
    processes.ProcessMind(None, None).close()  # type: ignore[arg-type]
    (name,) = entered
    assert not (Path("/dev/shm") / name).exists()
