"""``gensim2 bench motion``: its input, errors and output."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.bench import motion_summary, read_motion_problems, read_problems, solve_motions
from gensim2.bench.motion import obstacle_body
from gensim2.core.errors import InputError

START = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
GOAL = [1.2, -0.3, 0.0, -2.0, 0.0, 1.9, 0.785]


def problem(**changes: object) -> dict[str, object]:
    box = {"type": "box", "position": [0.45, 0.3, 0.2], "quaternion_wxyz": [1, 0, 0, 0], "half_extents": [0.05] * 3}
    return {"id": "one", "start": START, "goals": [GOAL], "obstacles": [box], **changes}


def written(path: Path, *problems: dict[str, object]) -> Path:
    path.write_text("".join(json.dumps(entry) + "\n" for entry in problems))
    return path


def test_a_solved_problem_has_samples_from_start_to_goal(tmp_path: Path) -> None:
    pytest.importorskip("mani_skill")
    records = solve_motions(read_motion_problems(written(tmp_path / "p.jsonl", problem())))
    (record,) = records
    assert record["status"] == "solved"
    samples = np.asarray(record["samples"])
    np.testing.assert_allclose(samples[0], [*START, 0.04, 0.04], atol=1e-9)
    np.testing.assert_allclose(samples[-1], [*GOAL, 0.04, 0.04], atol=1e-9)
    assert len(samples) == int(np.ceil(record["duration"] / 0.005 - 1e-9)) + 1
    assert record["cpu_ms"] > 0
    summary = motion_summary(records)
    assert summary.statuses == {"solved": 1}


@pytest.mark.parametrize("field", ["id", "start", "goals", "obstacles"])
def test_a_line_without_a_field_is_refused_by_number(tmp_path: Path, field: str) -> None:
    broken = problem()
    del broken[field]
    with pytest.raises(InputError, match="line 2"):
        read_motion_problems(written(tmp_path / "p.jsonl", problem(), broken))


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(
    "fields",
    [
        {"type": "cone"},
        {"type": "sphere", "radius": None},
        {"type": "sphere", "radius": 10**400},
        {"type": "box", "half_extents": {}},
        {"type": "sphere", "radius": 0.1, "position": None},
        {"type": "sphere", "radius": 0.1, "quaternion_wxyz": [0, 0, 0, 0]},
        {"type": "sphere", "radius": 0.1, "quaternion_wxyz": [1e200, 0, 0, 1e200]},
    ],
)
def test_an_unknown_obstacle_is_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"is not a valid obstacle.*\(box\).*\(cylinder\) or radius \(sphere\)"):
        obstacle_body({"position": [0, 0, 1], **fields}, "obstacle 0")


@pytest.mark.parametrize(
    "line",
    [b"[" * 50_000, b'{"id": NaN}', b"\xff", b"[]", b'{"id": "a", "start": ["1"], "goals": [], "obstacles": []}'],
)
def test_a_hostile_line_is_refused_in_one_line(tmp_path: Path, line: bytes) -> None:
    (tmp_path / "p.jsonl").write_bytes(json.dumps(problem()).encode() + b"\n" + line)
    with pytest.raises(InputError, match="line 2") as refused:
        read_motion_problems(tmp_path / "p.jsonl")
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize("read", [read_problems, read_motion_problems])
def test_problems_are_read_from_regular_files_of_bounded_size(read: Callable[[Path], object], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").touch()
    os.truncate(tmp_path / "large", 2**40)
    for name, said in (("pipe", "is a pipe"), ("large", "is larger than 512 MiB"), ("gone", "No such file")):
        with pytest.raises(InputError, match=said):
            read(tmp_path / name)
