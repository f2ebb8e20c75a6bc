"""Logs and trials on disks that are full, small or read-only, or in folders of other users."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from disks import can_mount, on_disk

from gensim2.core.errors import WriteError
from gensim2.rollout.controller_spec import ControllerSpec
from gensim2_robot.log_reader import messages, unclosed
from gensim2_robot.trial.record import read_protocol, read_trials
from gensim2_robot.trial.run import trial

RUN = ["robot", "run", "CloseBox", "--plan", "--simulated-clock", "--minutes", "0.1", "--assets", "builtin"]


@pytest.mark.skipif(not can_mount(), reason="mounts a file system of its own")
@pytest.mark.parametrize(
    ("mounted", "code", "said"),
    [
        ("ro", 2, "cannot write: Read-only file system"),
        ("size=4m", 2, "cannot write: No space left on device"),
        ("size=9m", 1, "the log cannot be written: No space left on device"),
    ],
)
def test_a_run_on_a_small_disk_ends_in_one_line_and_its_log_is_whole(
    tmp_path: Path, mounted: str, code: int, said: str
) -> None:
    disk, kept, out = tmp_path / "disk", tmp_path / "kept", tmp_path / "out.json"
    disk.mkdir()
    script = "from gensim2.cli.main import run; import shutil, sys; code = run(sys.argv[1:]); "
    script += f"shutil.copytree({str(disk)!r}, {str(kept)!r}); sys.exit(code)"
    words = [*RUN, "--pixels", "320x240", "--speed", "1.0", "--out", str(disk / "log"), "--json", str(out)]
    command = [*on_disk(mounted, disk), sys.executable, "-c", script, *words]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False, cwd=tmp_path)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    if code == 2:
        assert said in done.stderr.splitlines()[-1]
        assert not list(kept.rglob("*.mcap"))
        return
    found = json.loads(out.read_text())
    assert (found["state"], found["limits_passed"]) == ("holding", 0)
    assert said in found["reason"]
    assert unclosed(kept / "log") == []
    assert sum(1 for _ in messages(kept / "log")) > 20


class Filling:
    """A fake person who answers no; before the second answer the disk becomes full."""

    def __init__(self) -> None:
        self.asked = 0

    def lay_out(self, lines: Any) -> None:
        raise AssertionError("the simulator lays out")

    def judge(self, question: str, offered: bool | None) -> bool:
        self.asked += 1
        if self.asked == 2:
            resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
        return False

    def cause(self, causes: Any) -> str:
        return str(causes[0])


def test_a_trial_that_cannot_be_kept_ends_the_trials_and_the_others_stay(tmp_path: Path) -> None:
    before, person = resource.getrlimit(resource.RLIMIT_FSIZE), Filling()
    still = ControllerSpec("gensim2.policy.no_op:NoOpPolicy", {"arm": 7})
    line: dict[str, Any] = {"assets": "builtin", "simulated_clock": True, "pixels": (64, 48), "speed": 1.0}
    try:
        with pytest.raises(WriteError, match=r"trials.jsonl: cannot write"):
            trial(read_protocol("CloseBox"), out=tmp_path, trials=3, person=person, policy=still, **line)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert person.asked == 2, "the trials go on"
    assert [each.number for each in read_trials(tmp_path / "CloseBox")] == [0]
    found = trial(
        read_protocol("CloseBox"), out=tmp_path, trials=2, verdict="simulator", resume=True, policy=still, **line
    )
    assert found["rows"][0]["trials"] == 2
