"""The control loop with its processes and the machine's clock; the watchdog tolerates the delays of a busy machine."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

import pytest
import warm

from gensim2_robot.faults import Fault
from gensim2_robot.log_reader import replay
from gensim2_robot.run import run
from gensim2_robot.watch import WatchRules

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


def cameras() -> str:
    """Simulated cameras, through the RealSense library if it is installed (it needs libusb)."""
    try:
        import pyrealsense2  # noqa: F401
    except ImportError:
        return "simulated"
    return "software"


def test_a_plan_runs_in_processes_until_its_controller_is_killed(tmp_path: Path) -> None:
    found = run(
        "CloseBox",
        cameras=cameras(),
        speed=0.5,
        seed=3,
        minutes=3.0,
        assets="builtin",
        pixels=(160, 120),
        rules=PATIENT,
        force=1000.0,
        log=tmp_path,
        faults=[Fault("policy-killed", 12.0)],
    )
    assert found["state"] == "stopped", found["reason"]
    assert "process has ended" in found["reason"]
    assert found["limits_passed"] == 0
    assert found["clouds_ms"]["worst"] > 0.0
    assert found["detected_to_stopped_ms"] is not None
    again = replay(tmp_path)
    assert again.different == ()
    assert again.clouds > 10


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_stop_and_the_json_is_written(tmp_path: Path, number: signal.Signals) -> None:
    out = tmp_path / "out.json"
    words = ["robot", "run", "CloseBox", "--plan", "--assets", "builtin", "--minutes", "5", "--pixels", "64x48"]
    words += ["--real-time"]
    words = ["-m", "gensim2", *words, "--json", str(out), "--out", str(tmp_path / "log")]
    said = tmp_path / "said"
    process = warm.start(*words, out=said, err=said)
    try:
        until = time.monotonic() + 400
        while not list((tmp_path / "log").glob("*.mcap")) and time.monotonic() < until and process.is_alive():
            time.sleep(0.2)
        time.sleep(1.0)
        os.kill(process.pid or 0, number)
        process.join(400)
    finally:
        process.kill()
    text = said.read_text()
    found = json.loads(out.read_text())
    assert found["state"] in ("holding", "stopped"), text
    assert found["limits_passed"] == 0
    if not found["halts"] or number.name in found["reason"]:
        assert process.exitcode == 128 + number, text
        assert found["interrupted"] == [number.name]
