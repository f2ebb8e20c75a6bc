"""Ten kills in a fake world: the result equals that of an undisturbed run, byte for byte.

``python tests/kill/kill_runs.py --kills 100`` does the same with the simulator.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("kill_runs.py")

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds workers in /proc")

spec = importlib.util.spec_from_file_location("kill_runs", SCRIPT)
assert spec is not None
assert spec.loader is not None
kill_runs = importlib.util.module_from_spec(spec)
sys.modules["kill_runs"] = kill_runs
spec.loader.exec_module(kill_runs)

RUNS = [command for command in kill_runs.COMMANDS if command.name != "collect"]
COLLECTIONS = [command for command in kill_runs.COMMANDS if command.name == "collect"]


def test_ten_kills_change_nothing(tmp_path: Path) -> None:
    tally, wrong = kill_runs.kill_runs(10, "fake", seed=1, folder=tmp_path, commands=RUNS)
    assert wrong == []
    assert sum(tally.kills.values()) == 10
    assert {"driver SIGKILL", "worker SIGKILL"} <= set(tally.kills)
    assert tally.mid_collection >= 5


def test_ten_kills_change_no_byte_of_a_data_set(tmp_path: Path) -> None:
    tally, wrong = kill_runs.kill_runs(10, "fake", seed=2, folder=tmp_path, commands=COLLECTIONS)
    assert wrong == []
    assert sum(tally.kills.values()) == 10
    assert {"driver SIGKILL", "worker SIGKILL"} <= set(tally.kills)
    assert tally.mid_collection >= 5


def test_five_kills_change_no_byte_of_what_mujoco_simulates(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    command = dataclasses.replace(COLLECTIONS[0], words=(*COLLECTIONS[0].words, "--engine", "mujoco"))
    tally, wrong = kill_runs.kill_runs(5, "simulator", seed=4, folder=tmp_path, commands=[command])
    assert wrong == []
    assert sum(tally.kills.values()) == 5


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_stopped_run_says_one_line_and_leaves_no_process_and_no_half_file(
    tmp_path: Path, number: signal.Signals, code: int
) -> None:
    out = tmp_path / "run"
    # Long enough that it is stopped before its end.
    command = dataclasses.replace(kill_runs.COMMANDS[0], episodes=500).line(out, "fake", resume=False)
    # Under nohup, SIGHUP is ignored, and child processes inherit this.
    before = signal.signal(number, signal.SIG_DFL)
    try:
        process = kill_runs.start(command, tmp_path / "log")
    finally:
        signal.signal(number, before)
    episodes = out / "tasks/PushDrawerClose/episodes"
    deadline = time.monotonic() + 120
    while not list(episodes.glob("[0-9]*.h5")) and time.monotonic() < deadline:
        time.sleep(0.01)
    servers = kill_runs.children(process.pid)
    workers = [pid for server in servers for pid in kill_runs.children(server)]
    assert workers
    os.kill(process.pid, number)
    assert process.wait(timeout=60) == code
    words = [line for line in (tmp_path / "log").read_text().splitlines() if line.strip()]
    kept = "gensim2: interrupted; what was finished is kept"
    assert words[-1] == f"{kept}; to continue, repeat the command with --resume"
    assert not any("Traceback" in line for line in words)
    while any(kill_runs.command_line(pid) for pid in workers) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(kill_runs.command_line(pid) for pid in workers)
    assert list(episodes.glob("[0-9]*.h5"))
    assert [path.name for path in out.rglob(".*")] == [".lock"]


@pytest.mark.fast
def test_a_signal_that_is_to_be_ignored_is_ignored() -> None:
    script = (
        "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "import os; from gensim2.cli.main import stopping_signals\n"
        "with stopping_signals(): os.kill(os.getpid(), signal.SIGHUP)\n"
        "print('went on')"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout == "went on\n"
