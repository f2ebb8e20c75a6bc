"""A small version of ``benchmarks/night.py`` in a fake world: the result is the same when run in several parts."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "night.py"

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds workers in /proc")


def night(out: Path, *more: str) -> subprocess.CompletedProcess[str]:
    words = ["--world", "fake", "--tasks", "1", "--episodes", "120", "--kills", "1", "--out", str(out), *more]
    return subprocess.run([sys.executable, str(SCRIPT), *words], capture_output=True, text=True, check=False)


def test_a_night_is_gone_on_with_where_it_was_cut(tmp_path: Path) -> None:
    first = night(tmp_path, "--hours", "0.0014")
    assert first.returncode == 3, first.stdout + first.stderr
    assert "repeat the command" in first.stdout
    last = night(tmp_path)
    assert last.returncode == 0, last.stdout + last.stderr
    assert last.stdout.splitlines()[-1].startswith("0 of ")
    kept = json.loads((tmp_path / "night.json").read_text())
    assert kept["stretches"] == 2
    assert len(kept["kills"]) == 1
    other = night(tmp_path, "--seed", "9")
    assert other.returncode == 1
    assert "was begun with" in other.stderr
