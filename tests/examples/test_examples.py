"""Each example runs as a user would run it and gives the promised result."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import warm

from gensim2.objects import open_library
from gensim2.tasks.library import load_task

EXAMPLES = Path(__file__).parents[2] / "examples"

#: Check of each example: a function of its output and its folder.
Outcome = Callable[[str, Path], None]


def _solved(said: str, _: Path) -> None:
    """The plan is complete, each constraint is within its tolerance, and the duration is plausible."""
    assert "status: solved" in said
    residuals = re.findall(r"(\S+)\(.*\): (\S+) of (\S+)", said)
    assert {name for name, _, _ in residuals} == {"point2point_constraint", "frame_axis_parallel"}
    assert all(float(residual) <= float(tolerance) for _, residual, tolerance in residuals)
    duration = re.search(r"motion of (\S+) s through \['pre_0', 'actuation', 'post_0'\]", said)
    assert duration is not None
    assert 0.5 < float(duration[1]) < 10.0


def _stepped(said: str, _: Path) -> None:
    """Two seeds give two scenes; the no-op baseline opens no drawer."""
    before = [float(value) for value in re.findall(r"kg, openness (\S+),", said)]
    after = [float(value) for value in re.findall(r"after a second: openness (\S+),", said)]
    assert len(before) == len(after) == 2
    assert before[0] != before[1]
    assert np.abs(np.subtract(before, after)).max() <= 0.02
    assert said.count("success False") == 2


def _designed(said: str, folder: Path) -> None:
    """The task is found, succeeds in new episodes, is kept, and has demonstrations."""
    line = re.search(r"PushDrawerClose: (\d+)/(\d+) new episodes succeed, (\d+) demonstrations", said)
    assert line is not None
    successes, episodes, demos = map(int, line.groups())
    assert episodes == 20
    assert successes >= 14
    assert demos == 2
    verification = json.loads((folder / "tasks" / "PushDrawerClose" / "verification.json").read_text())
    assert verification["held"] == successes
    assert verification["objects"] == {"drawer": episodes}
    assert (folder / "report.html").stat().st_size > 1000


def _recorded(said: str, folder: Path) -> None:
    """There are two demonstrations, each of which closes its box and is in the file."""
    assert "environment: gensim2.sim:GenSim2-CloseBox-v1" in said
    moved = re.findall(r"seed (\d+), box (\d+): \((\d+), 8\) openness (\S+) to (\S+)", said)
    assert len(moved) == 2
    threshold = load_task("CloseBox").success[0].threshold
    for _, _, steps, start, end in moved:
        assert int(steps) > 20
        assert float(start) > threshold > float(end)
    with h5py.File(folder / "tasks" / "CloseBox" / "trajectory.h5") as file:
        assert all(file[name]["success"][-1] for name in ("traj_0", "traj_1"))


def _looked(said: str, _: Path) -> None:
    """The printed object is the loaded one."""
    drawer = open_library("builtin").load("drawer", "4711")
    assert f"drawer/4711: {drawer.mass:.2f} kg, prismatic joint" in said
    assert all(f"  {name} on {point.link} at" in said for name, point in drawer.keypoints.items())


def _placed(said: str, _: Path) -> None:
    """Both steps are planned completely, and the cube is at its goal."""
    assert "pick: solved place: solved" in said
    place = re.search(r"the cube stands at \[\s*(\S+)\s+(\S+)\s+(\S+?)\s*\]", said)
    assert place is not None
    assert [float(value) for value in place.groups()] == pytest.approx([0.5, 0.15, 0.025], abs=0.003)


def _grasped(said: str, _: Path) -> None:
    """There are grasps with their scores, and one serves both places."""
    assert re.search(r"\b100 grasps", said)
    assert "friction_margin" in said
    assert re.search(r"grasp \d+ picks the mug in \d+\.\d s and carries it in \d+\.\d s", said)


def _evaluated(said: str, folder: Path) -> None:
    """A policy was trained and evaluated in two scenes, and one episode filmed if rendering works."""
    line = re.search(r"CloseBox: (\S+) held, trained on (\d+) frames", said)
    assert line is not None
    assert int(line[2]) > 300
    log = (folder / "evaluation" / "tasks" / "CloseBox" / "attempts.jsonl").read_text().splitlines()
    assert len(log) == 2
    assert float(line[1]) == pytest.approx(sum(json.loads(each)["held"] for each in log) / 2)


def _own_robots(said: str, _: Path) -> None:
    """Two robots of different sizes, each in its own environment."""
    assert re.findall(r"(\w+): (\d) arm joints, opens 0.080 m, 20 Hz", said) == [("ur5e", "6"), ("xarm7", "7")]
    assert re.findall(r"after a second: openness \S+, (\d) numbers", said) == ["7", "8"]


def _exported(said: str, folder: Path) -> None:
    """Two episodes in three formats, with as many zarr frames as in the data set."""
    frames = int(re.findall(r"(\d+) frames of", said)[0])
    assert frames > 40
    assert re.findall(r"2 episodes in \S+/(\w+)", said) == ["zarr", "lerobot", "maniskill"]
    shapes = dict(re.findall(r"zarr: (\w+) \((.*)\)", said))
    assert shapes == {
        "state": f"{frames}, 9",
        "tool_pose": f"{frames}, 7",
        "action": f"{frames}, 8",
        "point_cloud": f"{frames}, 128, 6",
    }
    for export in ("zarr", "lerobot", "maniskill"):
        assert (folder / export / "README.md").is_file()


def _carried(said: str, _: Path) -> None:
    """Two arms carry the box, which only friction holds, to its goal."""
    assert re.findall(r"(\w+): (\w+), \S+ s", said) == [(name, "solved") for name in ("reach", "press", "carry")]
    end = re.search(r"box: (\S+) mm and (\S+) degrees from its goal", said)
    assert end is not None
    assert float(end[1]) < 10.0
    assert float(end[2]) < 2.0


FOLDER = "run"

OUTCOMES: dict[str, tuple[Outcome, tuple[str, ...]]] = {
    "01_solve_a_config.py": (_solved, ()),
    "02_make_an_env.py": (_stepped, ()),
    "03_design_a_task.py": (_designed, (FOLDER,)),
    "04_read_a_demo.py": (_recorded, (FOLDER,)),
    "05_look_at_an_object.py": (_looked, ()),
    "06_pick_and_place.py": (_placed, ()),
    "07_grasp_an_object.py": (_grasped, ()),
    "08_evaluate_a_controller.py": (_evaluated, (FOLDER, "4")),
    "09_a_robot_of_your_own.py": (_own_robots, ()),
    "10_collect_and_export.py": (_exported, (FOLDER,)),
    "11_two_arms.py": (_carried, ()),
}
"""The examples by name, with their command-line arguments; files are relative to an empty folder."""

ALONE = ("02_make_an_env.py", "05_look_at_an_object.py")
"""Examples that need a new interpreter; the others run in processes with imported libraries, which is faster."""


@pytest.mark.fast
def test_every_example_is_tested() -> None:
    assert {path.name for path in EXAMPLES.glob("*.py")} == set(OUTCOMES)


@pytest.mark.fast
def test_examples_are_short() -> None:
    for path in EXAMPLES.glob("*.py"):
        assert len(path.read_text().splitlines()) <= 60, path.name


@pytest.mark.parametrize("name", sorted(OUTCOMES))
def test_example(name: str, tmp_path: Path) -> None:
    outcome, arguments = OUTCOMES[name]
    words, environment = [str(EXAMPLES / name), *arguments], {**os.environ, "GENSIM2_ASSETS": ""}
    result = (
        subprocess.run([sys.executable, *words], capture_output=True, text=True, cwd=tmp_path, env=environment)
        if name in ALONE
        else warm.run(*words, cwd=tmp_path, env=environment)
    )
    assert result.returncode == 0, result.stderr
    outcome(result.stdout, tmp_path / FOLDER)
