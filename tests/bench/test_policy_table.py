"""Tables of policies agree with the JSON output of ``gensim2 learn``."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def made() -> Iterator[Any]:
    sys.path.insert(0, str(BENCHMARKS))
    import policy_table

    yield policy_table
    sys.path.remove(str(BENCHMARKS))


def _learned(*names: str, held: float, together: bool = False, blind: float | None = 0.0) -> dict[str, Any]:
    """Return the JSON output of ``gensim2 learn`` for these tasks."""
    row = {
        "policy": "keypose",
        "checkpoint": "/somewhere/else",
        "held_mean": held,
        "interval": [0.0, 1.0],
        "strict_mean": 0.5,
        "blind_mean": blind,
        "shuffled_mean": None,
        "no_op_mean": None,
        "expert_mean": 1.0,
        "episodes": 100,
        "control_episodes": 30,
        "different_objects": 60,
        "demonstrations": 400,
        "steps": 300,
        "causes": {"contact slipped": round(100 - 100 * held)} if held < 1 else {},
        "data_cpu_s": 20.4,
        "training_cpu_s": 30.2,
        "cpu_s": 50.6,
        "evaluation_cpu_s": 25.0,
    }
    scene = {
        "assets": "builtin",
        "physics": "default",
        "robot": "panda",
        "randomization": "paper",
        "instances": "train",
    }
    beside = {"seed": 7, "objects": 200, "multi_task": together, "test_instances": "new", "scene": scene}
    return {**beside, "tasks": [{"name": name, **row} for name in names]}


def test_a_table_has_counts_and_intervals_and_the_mean(made: Any) -> None:
    rows = made.rows_of(_learned("CloseBox", held=0.97), "abc") + made.rows_of(_learned("OpenBox", held=1.0), "abc")
    table = made.every(rows)
    box = next(line for line in table.splitlines() if line.startswith("| CloseBox"))
    assert "0.97 (0.92 to 0.99) of 100" in box
    assert "0 of 30" in box
    assert "30 of 30" in box
    assert "3 contact slipped" in box
    assert "mean of 2 | 0.985" in table
    assert "somewhere" not in json.dumps(rows)
    assert "one policy for each of 2 single-step tasks" in made.short(rows)
    assert "197 of 200 episodes" in made.short(rows)


def test_policies_of_several_tasks_have_a_table_of_their_own(made: Any) -> None:
    alone = made.rows_of(_learned("CloseBox", held=1.0), "abc")
    rows = alone + made.rows_of(_learned("CloseBox", "OpenBox", held=0.5, together=True, blind=None), "abc")
    first, title, second = made.every(rows).split("\n\n")
    assert title.startswith("**Other policies.** ")
    assert "one of 2 tasks" in second
    assert "one of 2 tasks" not in first
    assert "0.50 (0.40 to 0.60) of 100" in second
    assert made.short(rows) == made.short(alone)


def test_several_seeds_have_a_table_and_the_first_stands_in_the_others(made: Any) -> None:
    first, second = _learned("CloseBox", held=1.0), _learned("CloseBox", held=0.9, blind=0.1)
    second["seed"] = 8
    alone = made.rows_of(first, "abc") + made.rows_of(_learned("OpenBox", held=1.0), "abc")
    rows = made.rows_of(second, "abc") + alone
    assert made.every(rows) == made.every(alone)
    assert made.short(rows) == made.short(alone)
    table = made.seeds(rows)
    assert "OpenBox" not in table
    assert "| 100 of 100 | 90 of 100 | 0.950 (0.910 to 0.973) |" in table
    assert "| 3 of 60 | 60 of 60 |" in table
    assert made.seeds(alone) == ""


def test_wide_scenes_and_chunks_of_actions_have_their_own_tables(made: Any) -> None:
    wide = _learned("CloseBox", "OpenBox", held=0.9)
    wide["scene"]["randomization"] = "wide"
    chunk = _learned("CloseBox", held=0.8)
    chunk["tasks"][0]["policy"] = "chunk"
    rows = made.rows_of(wide, "abc") + made.rows_of(chunk, "abc")
    title, table = made.every(rows).split("\n\n")
    assert "wide" in title
    assert "mean of 2 | 0.900" in table
    assert "0.80" not in table
    assert "0.80 (0.71 to 0.87) of 100" in made.chunks(rows)
    assert made.short(rows) == ""


def test_what_was_set_otherwise_has_a_table_of_its_own(made: Any) -> None:
    usual, other = _learned("CloseBox", held=1.0), _learned("CloseBox", held=0.5)
    for each in (usual, other):
        each["tasks"][0]["policy"] = "chunk"
    other["settings"] = {"encoder": "state", "keyframes": 0}
    rows = made.rows_of(usual, "abc") + made.rows_of(other, "abc")
    assert made.chunks(rows) == made.chunks(rows[:1])
    (row,) = made.baselines(rows).splitlines()[2:]
    assert row.startswith("| CloseBox | chunk, `state.yaml`, generated, new | 0.50 ")
    assert made.every(rows) == ""


def test_every_head_is_compared_on_five_tasks(made: Any) -> None:
    rows = []
    for number, policy in enumerate(("chunk", "flow")):
        for name in made.FIVE if policy == "chunk" else made.FIVE[:2]:
            learned = _learned(name, held=0.5 + 0.1 * number)
            learned["tasks"][0]["policy"] = policy
            rows += made.rows_of(learned, "abc")
    table = made.heads(rows).splitlines()[2:]
    assert table[0].startswith("| `chunk` |")
    assert table[0].endswith("| 50 of 100 | 50 of 100 | 50 of 100 | 50 of 100 | 50 of 100 | 0.500 |")
    assert next(row for row in table if "flow" in row) == "| `flow` | 60 of 100 | 60 of 100 |  |  |  |  |"
