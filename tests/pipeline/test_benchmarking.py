"""``gensim2 benchmark``: one table whatever the number of workers, gone on with, and computed from its episodes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from gensim2.cli.main import BAD_INPUT, run

QUICK = ["benchmark", "TurnOnFaucet", "--assets", "builtin", "--runs", "2", "--episodes", "2", "--seed", "5"]


def table(out: Path, *more: str) -> dict[str, Any]:
    file = out.with_suffix(".json")
    assert run([*QUICK, "--out", str(out), "--json", str(file), *more]) == 0
    found: dict[str, Any] = json.loads(file.read_text())
    return found


def test_a_table_follows_from_its_episodes_and_not_from_the_workers(tmp_path: Path) -> None:
    one, two = table(tmp_path / "one", "--workers", "1"), table(tmp_path / "two", "--workers", "2")
    assert one["tasks"] == two["tasks"]
    (row,) = one["tasks"]
    assert (row["type"], row["episodes"], len(row["records"])) == ("single-step", 4, 4)
    runs = [[record["paper"] for record in row["records"][start : start + 2]] for start in (0, 2)]
    assert row["success_mean"] == sum(map(sum, runs)) / 4
    assert row["held_mean"] == sum(record["held"] for record in row["records"]) / 4
    assert len({record["seed"] for record in row["records"]}) == 4


def test_what_is_done_is_not_run_again(tmp_path: Path) -> None:
    whole = table(tmp_path / "run", "--workers", "1")
    log = tmp_path / "run" / "tasks" / "TurnOnFaucet" / "attempts.jsonl"
    lines = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(b"".join(lines[:3]))
    assert table(tmp_path / "run", "--workers", "1", "--resume")["tasks"] == whole["tasks"]
    assert log.read_bytes() == b"".join(lines)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["Nope"], "unknown task 'Nope'"),
        (["TurnOnFaucet", "TurnOnFaucet"], "a task is named twice"),
        (["--assets", "/nowhere"], "no such folder"),
        (["--runs", "0"], "--runs"),
    ],
)
def test_wrong_input_is_one_line(
    words: list[str], said: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run(["benchmark", *words, "--out", str(tmp_path / "out")]) == BAD_INPUT
    shown = capfd.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1
