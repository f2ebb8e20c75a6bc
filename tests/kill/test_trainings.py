"""``learn``, ``experiment`` and ``train`` are killed while they train; resumed, they give the same result."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from disks import can_mount, on_disk

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


def killed_and_resumed(words: list[str], policy: str, folder: Path) -> None:
    whole, parts, log = folder / "whole", folder / "parts", folder / "log"
    # The undisturbed run has no shared memory, which changes nothing.
    finished(words, whole, log, on_disk("ro", Path("/dev/shm")) if can_mount() else ())
    process = start(words, parts, log)
    state = parts / policy / "training" / "state.json"
    reached(state, 6, process, log)
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
    finished([*words, "--resume"], parts, log)
    assert contents(parts, parts / policy) == contents(whole, whole / policy)


def test_learn_by_plans(tmp_path: Path) -> None:
    killed_and_resumed([*LEARN, "--scenes", "2"], ".", tmp_path)


def test_learn_by_episodes_and_train_by_the_same(tmp_path: Path) -> None:
    for name in ("learn", "train"):
        (tmp_path / name).mkdir()
    killed_and_resumed([*LEARN, "--policy", "chunk"], ".", tmp_path / "learn")
    settings = tmp_path / "settings.yaml"
    settings.write_text(json.dumps(SETTINGS))
    data = str(tmp_path / "learn" / "whole" / "data")
    killed_and_resumed(["train", "--data", data, "--config", str(settings)], ".", tmp_path / "train")


def test_experiment(tmp_path: Path) -> None:
    config = tmp_path / "toy.yaml"
    config.write_text(EXPERIMENT)
    words = ["experiment", "generalization", "--config", str(config), "--assets", "builtin", "--workers", "1"]
    killed_and_resumed(words, "counted/seed-0", tmp_path)
