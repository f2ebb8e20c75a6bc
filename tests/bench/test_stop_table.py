"""The table of policies that stop by themselves is made from two evaluations on the same scenes."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import stop_table

    yield stop_table
    del sys.modules["stop_table"]


def evaluation(stop: str, held: float, strict: float, causes: dict[str, int], checkpoint: str) -> dict[str, Any]:
    scene = {"seed": 3, "engine": "sapien", "instances": "new", "randomization": "paper"}
    tasks = [
        {"name": name, "episodes": 10, "held_mean": held, "strict_mean": strict, "causes": causes}
        for name in ("OpenBox", "CloseBox")
    ]
    told = {"checkpoint": checkpoint}
    return {"arguments": {"stop": stop, **scene}, "controller": {"arguments": told}, "tasks": tasks}


def test_both_ends_of_an_episode_stand_beside_each_other(module: ModuleType) -> None:
    goal = module.rows_of(evaluation("goal", 1.0, 0.0, {}, "/home/somebody/builtin"), "0123abcd")
    own = module.rows_of(evaluation("controller", 0.6, 0.5, {"time over": 4}, "/home/somebody/builtin"), "0123abcd")
    assert "somebody" not in str([goal, own])
    table = module.table([*goal, *own])
    cells = "1.00 (0.84 to 1.00) of 20 | 0.00 | 0.60 (0.39 to 0.78) of 20 | 0.50 | 8 time over"
    assert f"| all | {cells} |" in table
    assert table.count("| OpenBox |") == 1
    said = module.short([*goal, *own])
    assert "On 2 of these tasks, the packaged policy succeeds in 20 of 20 episodes" in said
    assert "it succeeds in 12 of 20" in said


def test_a_task_without_one_of_the_ends_is_left_out(module: ModuleType) -> None:
    goal = module.rows_of(evaluation("goal", 1.0, 0.0, {}, "builtin"), "0123abcd")
    own = module.rows_of(evaluation("controller", 0.6, 0.5, {}, "builtin"), "0123abcd")
    assert "CloseBox" not in module.table([*goal, *(row for row in own if row["name"] == "OpenBox")])


def test_another_policy_is_refused(module: ModuleType) -> None:
    with pytest.raises(ValueError, match="evaluate with --checkpoint builtin"):
        module.rows_of(evaluation("goal", 1.0, 0.0, {}, "mine/policy"), "0123abcd")


def test_the_pages_have_the_stored_figures(module: ModuleType) -> None:
    rows = json.loads(module.FIGURES.read_text())["rows"]
    page, readme = (file.read_text() for file in module.PAGES)
    assert module.table(rows) in page
    assert module.short(rows) in readme
