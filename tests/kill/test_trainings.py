"""``learn``, ``experiment`` and ``train`` give the same result after kills and read-only disks; one of two runs wins.

The simulator and the training are the real ones; networks and numbers of steps are small.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from disks import OWN_MOUNTS, can_mount, make_read_only, on_disk

SCRIPT = Path(__file__).with_name("trainings.py")
STEPS = 40
EXPERIMENT = """
title: Toy
about: One arm.
minutes_a_task: 0.001
scenes: 2
episodes: 1
control_episodes: 1
unseen: new
arms:
  - {name: counted, objects: generated, count: 2, tasks: [CloseBox]}
"""
SETTINGS = {"steps": STEPS, "batch": 4, "save_every": 2, "log_every": 1, "threads": 1, "width": 16, "layers": 1}
LEARN = ["learn", "CloseBox", "--assets", "builtin", "--minutes", "0.001", "--workers", "1", "--episodes", "1"]
WORDS = ["experiment", "generalization", "--assets", "builtin", "--workers", "1"]
LEARN += ["--controls", "none", "--videos", "0", "--objects", "2"]


def start(words: list[str], out: Path, log: Path, prefix: Sequence[str] = ()) -> subprocess.Popen[bytes]:
    with log.open("ab") as stream:
        command = [*prefix, sys.executable, str(SCRIPT), *words, "--out", str(out)]
        return subprocess.Popen(command, stdout=stream, stderr=stream, start_new_session=True)


def finished(words: list[str], out: Path, log: Path, prefix: Sequence[str] = ()) -> None:
    assert start(words, out, log, prefix).wait(timeout=900) == 0, log.read_text()


def contents(out: Path, policy: Path) -> dict[str, object]:
    """Return weights, settings, curves and episodes of a policy, without the CPU time."""
    found: dict[str, object] = {path.name: path.read_bytes() for path in policy.glob("weights-*")}
    found["config.json"] = (policy / "config.json").read_bytes()
    points = [json.loads(line) for line in (policy / "training/curves.jsonl").read_text().splitlines()]
    found["curves"] = [{**point, "cpu_s": 0} for point in points]
    return found | {str(path.relative_to(out)): path.read_bytes() for path in out.rglob("attempts.jsonl")}


def reached(state: Path, step: int, process: subprocess.Popen[bytes], log: Path) -> None:
    until = time.monotonic() + 600
    while not state.exists() or json.loads(state.read_text())["step"] < step:
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < until
        time.sleep(0.02)


def killed_and_resumed(words: list[str], policy: str, folder: Path, more: bool = True) -> None:
    """Kill and resume a run, and compare it with an undisturbed one; ``more``: also a second run, a read-only disk."""
    whole, parts, log = folder / "whole", folder / "parts", folder / "log"
    # The undisturbed run has no shared memory, which changes nothing.
    finished(words, whole, log, on_disk("ro", Path("/dev/shm")) if can_mount() else ())
    process = start(words, parts, log)
    state = parts / policy / "training" / "state.json"
    reached(state, 6, process, log)
    if more:
        os.killpg(process.pid, signal.SIGSTOP)  # so that it does not end before the other one starts
        second = start([*words, "--resume"], parts, folder / "second")
        assert second.wait(timeout=300) == 2
        (said,) = (line for line in (folder / "second").read_text().splitlines() if line.startswith("gensim2:"))
        assert "another run is using this folder" in said
        os.killpg(process.pid, signal.SIGCONT)
    reached(state, 10, process, log)
    os.killpg(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert 10 <= json.loads(state.read_text())["step"] < STEPS, "it was over before it was killed"
    for left in (parts / policy, parts / policy / "training"):
        (left / ".config.json.0123456789abcdef.tmp.json").touch()  # as a kill in the middle of writing leaves it
    if more and can_mount():
        ends_on_a_read_only_disk([*words, "--resume"], parts, state, folder / "read-only")
    finished([*words, "--resume"], parts, log)
    assert contents(parts, parts / policy) == contents(whole, whole / policy)
    assert not list(parts.rglob(".*.tmp*"))


def ends_on_a_read_only_disk(words: list[str], out: Path, state: Path, log: Path) -> None:
    """Make the disk of a run read-only while it trains; the run ends with one line and loses nothing."""
    begun = json.loads(state.read_text())["step"]
    process = start(words, out, log, OWN_MOUNTS)
    reached(state, begun + 2, process, log)
    os.killpg(process.pid, signal.SIGSTOP)  # so that the training does not end before the disk is read-only
    make_read_only(out, process.pid)
    os.killpg(process.pid, signal.SIGCONT)
    assert process.wait(timeout=300) == 2, log.read_text()
    (said,) = (line for line in log.read_text().splitlines() if line.startswith("gensim2"))
    assert said.startswith(f"gensim2: {out}/")
    assert said.endswith("cannot write: Read-only file system (choose another folder with --out)")
    assert "Traceback" not in log.read_text()
    assert begun + 2 <= json.loads(state.read_text())["step"] < STEPS


def test_learn_by_plans(tmp_path: Path) -> None:
    killed_and_resumed([*LEARN, "--scenes", "2"], ".", tmp_path)


def test_train(tmp_path: Path) -> None:
    finished([*LEARN, "--policy", "chunk"], tmp_path / "learned", tmp_path / "log")
    settings = tmp_path / "settings.yaml"
    settings.write_text(json.dumps(SETTINGS))
    data = str(tmp_path / "learned" / "data")
    killed_and_resumed(["train", "--data", data, "--config", str(settings)], ".", tmp_path, more=False)


def test_experiment(tmp_path: Path) -> None:
    config = tmp_path / "toy.yaml"
    config.write_text(EXPERIMENT)
    words = [*WORDS, "--config", str(config)]
    killed_and_resumed(words, "counted/seed-0", tmp_path, more=False)


def shards(out: Path) -> int:
    return len(list(out.glob("data/CloseBox/shard_*.npz")))


def test_learn_is_killed_while_it_plans(tmp_path: Path) -> None:
    words = [*LEARN, "--scenes", "8", "--minutes", "1"]  # enough time for all scenes
    whole, parts, log = tmp_path / "whole", tmp_path / "parts", tmp_path / "log"
    finished(words, whole, log)
    assert shards(whole) == 4
    for count in (0, 3):
        process = start([*words, *(["--resume"] if parts.exists() else [])], parts, log)
        until = time.monotonic() + 600
        while shards(parts) < count or not (parts / "data/CloseBox/data.json").exists():
            assert process.poll() is None, log.read_text()
            assert time.monotonic() < until
            time.sleep(0.005)
        os.killpg(process.pid, signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        assert not (parts / "training").exists(), "it had planned everything"
    (parts / "data/CloseBox/.shard_00003.npz.0123456789abcdef.tmp.npz").touch()
    finished([*words, "--resume"], parts, log)
    assert contents(parts, parts) == contents(whole, whole)
    assert not list(parts.rglob(".*.tmp*"))


@pytest.mark.parametrize("command", ["learn", "experiment"])
def test_of_two_runs_that_start_together_one_goes_on(tmp_path: Path, command: str) -> None:
    (tmp_path / "toy.yaml").write_text(EXPERIMENT)
    words = {
        "learn": [*LEARN, "--scenes", "2"],
        "experiment": [*WORDS, "--config", str(tmp_path / "toy.yaml")],
    }[command]
    (tmp_path / "started").mkdir()
    logs = [tmp_path / "log-0", tmp_path / "log-1"]
    prefix = ("env", f"START_TOGETHER={tmp_path / 'started'}")
    both = [start(words, tmp_path / "out", log, prefix) for log in logs]
    codes = [process.wait(timeout=900) for process in both]
    assert sorted(codes) == [0, 2], [log.read_text() for log in logs]
    (said,) = (line for line in logs[codes.index(2)].read_text().splitlines() if line.strip())
    assert said.startswith(f"gensim2: {tmp_path / 'out'}: another run is using this folder")
    assert not list((tmp_path / "out").rglob(".*.tmp*"))
