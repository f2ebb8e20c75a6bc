"""``gensim2 bench motion``: what it reads, refuses and writes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gensim2.bench import motion_summary, read_motion_problems, solve_motions
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


def test_an_unknown_obstacle_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("mani_skill")
    cone = {"type": "cone", "position": [0, 0, 1]}
    problems = read_motion_problems(written(tmp_path / "p.jsonl", problem(obstacles=[cone])))
    with pytest.raises(InputError, match="box, cylinder or sphere"):
        solve_motions(problems)
