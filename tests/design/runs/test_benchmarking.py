"""``gensim2 benchmark``: the same table for any number of workers and after a resume, computed from its episodes."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from gensim2.cli.main import BAD_INPUT, run
from gensim2.core.errors import InputError
from gensim2.objects import open_library
from gensim2.rollout.inputs import of_these_objects
from gensim2.core.seeding import scene_seeds

QUICK = [
    "benchmark",
    "TurnOnFaucet",
    "CloseBox",
    "--assets",
    "builtin",
    "--runs",
    "2",
    "--episodes",
    "6",
    "--seed",
    "5",
]


def table(out: Path, *more: str, words: list[str] = QUICK) -> dict[str, Any]:
    file = out.with_suffix(".json")
    assert run([*words, "--out", str(out), "--json", str(file), *more]) == 0
    found: dict[str, Any] = json.loads(file.read_text())
    return found


def _wilson(count: int, of: int) -> tuple[float, float]:
    """Return the Wilson interval."""
    z, rate = 1.959963984540054, count / of
    middle, width = rate + z * z / (2 * of), z * math.sqrt(rate * (1 - rate) / of + z * z / (4 * of * of))
    return (middle - width) / (1 + z * z / of), (middle + width) / (1 + z * z / of)


def _figures(tasks: list[dict[str, Any]], runs: int) -> dict[str, Any]:
    """Return every rate of a table, computed from the episodes in the JSON."""
    found: dict[str, Any] = {"episodes": sum(len(task["records"]) for task in tasks)}
    for name, verdict in (("success", "paper"), ("held", "held"), ("strict", "strict")):
        by_run = []
        for run_ in range(runs):
            rates = []
            for task in tasks:
                size = len(task["records"]) // runs
                flags = [record[verdict] for record in task["records"][run_ * size : (run_ + 1) * size]]
                rates.append(flags.count(True) / size)
            by_run.append(sum(rates) / len(rates))
        middle = sum(by_run) / runs
        found[f"{name}_mean"] = middle
        found[f"{name}_std"] = math.sqrt(sum((rate - middle) ** 2 for rate in by_run) / runs)
        count = sum(record[verdict] for task in tasks for record in task["records"])
        found[f"{name}_interval"] = list(_wilson(count, found["episodes"]))
    return found


def _counted(words: list[str]) -> dict[str, int]:
    return {word: words.count(word) for word in words}


def test_a_table_follows_from_its_json_alone_and_not_from_the_workers(tmp_path: Path) -> None:
    one, two = table(tmp_path / "one", "--workers", "1"), table(tmp_path / "two", "--workers", "2")
    for told in (one, two):
        for field in ("run_dir", "cpu_s", "episodes_per_second"):
            del told[field]
    assert one == two
    assert [(row["name"], row["type"], row["runs"], row["seen"]) for row in one["tasks"]] == [
        ("TurnOnFaucet", "single-step", 2, "all"),
        ("CloseBox", "single-step", 2, "all"),
    ]
    for row in one["tasks"]:
        records = row["records"]
        for name, value in _figures([row], 2).items():
            assert row[name] == pytest.approx(value), name
        assert row["causes"] == _counted([record["cause"] for record in records if record["cause"] is not None])
        assert row["strict_misses"] == _counted([miss for record in records for miss in record["strict_misses"]])
        partial = sum(any(plan["status"] == "partial" for s in r["steps"] for plan in s["plans"]) for r in records)
        assert (row["partial"], row["partial_share"]) == (partial, partial / 12)
        things = {(thing["asset_class"], thing["id"]) for record in records for thing in record["objects"].values()}
        assert row["different_objects"] == len(things) > 1
        assert len({record["seed"] for record in records}) == 12
        assert row["attempts"] == 12
        assert {record["randomization"] for record in records} == {"paper"}
    (group,) = one["groups"]
    assert (group["type"], group["tasks"]) == ("single-step", 2)
    for name, value in _figures(one["tasks"], 2).items():
        assert group[name] == pytest.approx(value), name
    assert (group["paper_figure"], group["original_figure"]) == pytest.approx(((0.67 + 0.94) / 2, (0.6 + 1.0) / 2))
    assert {"seed": 5, "runs": 2, "episodes": 6, "attempts": 1, "randomization": "paper"}.items() <= one[
        "arguments"
    ].items()


def test_what_is_done_is_not_run_again(tmp_path: Path) -> None:
    whole = table(tmp_path / "run", "--workers", "1")
    log = tmp_path / "run" / "tasks" / "TurnOnFaucet" / "attempts.jsonl"
    lines = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(b"".join(lines[:3]))
    again = table(tmp_path / "run", "--workers", "1", "--resume")
    assert (again["tasks"], again["groups"]) == (whole["tasks"], whole["groups"])
    assert again["episodes_per_second"]["CloseBox"] is None
    assert log.read_bytes() == b"".join(lines)


def test_a_table_is_gone_on_with_as_it_was_begun(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    table(tmp_path / "run", "--workers", "1")
    for words, field in (
        (["--randomization", "wide"], "randomization"),
        (["--attempts", "3"], "attempts"),
        (["--disturb", "push"], "disturbance"),
        (["--instances", "train"], "instances"),
    ):
        assert run([*QUICK, "--out", str(tmp_path / "run"), "--resume", *words]) == BAD_INPUT
        assert f"arguments.{field}" in capfd.readouterr().err
    # A new folder has nothing to resume.
    assert run([*QUICK, "--out", str(tmp_path / "other"), "--resume", "--disturb", "push"]) == BAD_INPUT
    assert "grasps no rigid object" in capfd.readouterr().err
    assert not (tmp_path / "other").exists()


def test_tasks_that_objects_do_not_do_for_are_named_and_left_out(tmp_path: Path) -> None:
    words = ["benchmark", "CloseBox", "PlaceGolfBallIntoDrawer", "OpenSafe", "--assets", "builtin"]
    # Generated classes have any number of instances, but a class with fewer than ten has no test split.
    found = of_these_objects("builtin", ["CloseBox", "OpenSafe"], "test")
    assert found == (("CloseBox", "OpenSafe"), {})
    urdf = tmp_path / "assets" / "box_rotate" / "7" / "mobility.urdf"
    urdf.parent.mkdir(parents=True)
    urdf.write_text("<robot/>")
    names, skipped = of_these_objects(tmp_path / "assets", words[1:4])
    assert names == ("CloseBox",)
    assert skipped == {
        "PlaceGolfBallIntoDrawer": f"{tmp_path / 'assets'} has no drawer",
        "OpenSafe": f"{tmp_path / 'assets'} has no safe_rotate",
    }
    with pytest.raises(
        InputError, match=r"no task can be run on these objects; for example, CloseBox: box_rotate has only 1 instances"
    ):
        of_these_objects(tmp_path / "assets", instances="test", tasks=["CloseBox"])
    with pytest.raises(
        InputError, match=r"box_rotate has no new instances, because its objects are real .*--assets builtin"
    ):
        of_these_objects(tmp_path / "assets", instances="new", tasks=["CloseBox"])


def test_the_words_for_instances_reach_the_episodes(tmp_path: Path) -> None:
    library = open_library("builtin")
    for word in ("train", "test", "new"):
        (row, _) = table(tmp_path / word, "--workers", "1", "--instances", word)["tasks"]
        drawn = {thing["id"] for record in row["records"] for thing in record["objects"].values()}
        assert drawn <= set(library.choose("faucet", word))


def test_seeds_of_a_table_are_used_by_no_search_and_no_other_run() -> None:
    for task in ("OpenDrawer", "PlaceGolfBallIntoDrawer"):
        purposes = [f"benchmark/{run_}" for run_ in range(5)] + ["screen", "design", "verify", "demos"]
        seeds = [each for seed in range(10) for name in purposes for each in scene_seeds(seed, task, name, 200)]
        assert len(set(seeds)) == len(seeds)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["Nope"], "unknown task 'Nope'"),
        (["TurnOnFaucet", "TurnOnFaucet"], "a task is named twice"),
        (["--assets", "/nowhere"], "no such folder"),
        (["--runs", "0"], "--runs"),
        (["--attempts", "0"], "--attempts"),
        (["--randomization", "narrow"], "--randomization"),
        (["TurnOnFaucet", "--instances", "x"], "no instance 'x' of faucet"),
    ],
)
def test_wrong_input_is_one_line(
    words: list[str], said: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run(["benchmark", *words, "--out", str(tmp_path / "out")]) == BAD_INPUT
    shown = capfd.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1
