"""Each example runs as a user would run it, and says what it promises."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"

#: Words that the output of each example must hold, and whether it takes an output folder.
EXPECTED = {
    "01_solve_a_config.py": (("status: solved", "point2point_constraint(tool_head, button)", "actuation"), False),
    "02_make_an_env.py": (("seed 0: drawer/", "seed 1: drawer/", "success False"), False),
    "03_design_a_task.py": (("PushDrawerClose:", "report.html"), True),
    "04_read_a_demo.py": (
        ("environment: gensim2.sim:GenSim2-CloseBox-v1", ", 8)", "replay_trajectory"),
        True,
    ),
    "05_look_at_an_object.py": (("drawer/4711", "prismatic", "articulated_object_head"), False),
    "06_grasp_an_object.py": (("100 grasps", "friction_margin", "picks in"), False),
}


def test_every_example_is_tested() -> None:
    assert {path.name for path in EXAMPLES.glob("*.py")} == set(EXPECTED)


def test_examples_are_short() -> None:
    for path in EXAMPLES.glob("*.py"):
        assert len(path.read_text().splitlines()) <= 60, path.name


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_example(name: str, tmp_path: Path) -> None:
    words, takes_folder = EXPECTED[name]
    arguments = [str(tmp_path / "run")] if takes_folder else []
    result = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
        cwd=tmp_path,
        env={**os.environ, "GENSIM2_ASSETS": ""},
    )
    assert result.returncode == 0, result.stderr
    for word in words:
        assert word in result.stdout
