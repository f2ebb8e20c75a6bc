"""The file of benchmark figures, and how it is computed from the episodes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conditions import PLAIN
from figures import archive_name, command_of, made_together, page_by_instance, read_archive, read_figures, rows_of
from run_folders import fake_world

from gensim2.cli.benchmark import benchmark
from gensim2.core.errors import InputError
from gensim2.tasks.figures import Condition, Figures, figures_of
from gensim2.tasks.figures import figures as stored_figures
from gensim2.tasks.library import load_task, task_names
from gensim2.tasks.published import MEASURED, PAPER

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "figures.py"
ARCHIVE = Path(__file__).parents[2] / "benchmarks" / "episodes"


def document(**arguments: Any) -> dict[str, Any]:
    """Return the JSON output of a benchmark of OpenDrawer: 2 runs of 4 episodes, of which 4 and 2 succeeded."""
    task = load_task("OpenDrawer")
    held = [True] * 4 + [True, False, True, False]
    records = [fake_world.episode_of(task, seed, held=each).to_dict() for seed, each in enumerate(held)]
    given = {"seed": 9, "runs": 2, "episodes": 4, "assets": "builtin", **PLAIN}
    # The rates are wrong on purpose: only the episodes count.
    row = {"name": "OpenDrawer", "held_mean": 0.123, "records": records}
    return {"schema_version": 1, "arguments": {**given, **arguments}, "tasks": [row]}


def written(path: Path, value: Any) -> Path:
    path.write_text(json.dumps(value))
    return path


def test_a_row_is_counted_from_the_episodes(tmp_path: Path) -> None:
    (row,) = rows_of(written(tmp_path / "a.json", document()))
    assert (row.task, row.seed, row.runs, row.episodes) == ("OpenDrawer", 9, 2, 8)
    assert (row.paper, row.held, row.strict) == (6, 6, 4)
    assert row.deviation == 0.25  # 1.0 and 0.5
    assert row.causes == {"object did not move": 2}
    assert row.condition.is_plain
    assert row.condition.in_words == "default physics, generated objects"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"assets": "/some/folder"}, "default physics, real objects"),
        ({"physics": "original"}, "the original's physics, generated objects"),
        ({"instances": "test"}, "default physics, generated objects, instances test"),
        ({"randomization": "wide", "attempts": 8}, "default physics, generated objects, ranges wide, 8 attempts"),
        ({"open_loop": True, "disturbance": "push"}, "default physics, generated objects, open loop, disturbed: push"),
    ],
)
def test_a_condition_says_what_is_not_the_papers_protocol(
    tmp_path: Path, arguments: dict[str, Any], words: str
) -> None:
    (row,) = rows_of(written(tmp_path / "a.json", document(**arguments)))
    assert row.condition.in_words == words
    assert row.condition.is_plain == ("," not in words.split("objects")[1])


def test_episodes_that_were_left_out_are_no_figure(tmp_path: Path) -> None:
    short = document()
    del short["tasks"][0]["records"][3]
    with pytest.raises(InputError, match="OpenDrawer has 7 episodes, not 2 x 4"):
        rows_of(written(tmp_path / "a.json", short))
    with pytest.raises(InputError, match="arguments"):
        rows_of(written(tmp_path / "b.json", {"tasks": []}))


def test_the_script_replaces_rows_of_the_same_condition(tmp_path: Path) -> None:
    out = tmp_path / "figures.json.xz"

    def run(*words: str | Path) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, SCRIPT, *words, "--out", out, "--archive", tmp_path / "episodes"]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    ours = written(tmp_path / "a.json", document())
    original = written(tmp_path / "b.json", document(physics="original"))
    again = written(tmp_path / "c.json", document(seed=10))
    assert run(ours, original).returncode == 0
    assert [(row.condition.physics, row.seed) for row in read_figures(out).rows] == [("default", 9), ("original", 9)]
    assert run(again).returncode == 0
    assert [(row.condition.physics, row.seed) for row in read_figures(out).rows] == [("default", 10), ("original", 9)]
    twice = run(ours, again)
    assert twice.returncode == 1
    assert "same task with the same condition" in twice.stderr
    assert run(ours, "--only").returncode == 0
    assert [row.seed for row in read_figures(out).rows] == [9]
    names = ["default-generated.csv.xz", "original-generated.csv.xz"]
    assert sorted(path.name for path in (tmp_path / "episodes").iterdir()) == names
    lines = read_archive(tmp_path / "episodes" / names[0])
    assert [line["run_seed"] for line in lines] == ["9"] * 8
    assert [line["held"] for line in lines] == ["1", "1", "1", "1", "1", "0", "1", "0"]
    (tmp_path / "episodes" / names[0]).write_bytes(b"no archive")
    damaged = run(again)
    assert damaged.returncode == 1
    assert "default-generated.csv.xz: cannot be read" in damaged.stderr


@pytest.mark.parametrize("path", sorted(ARCHIVE.glob("*.csv.xz")), ids=lambda path: path.name)
def test_the_archive_holds_the_episodes_of_the_figures(path: Path) -> None:
    rows = {row.task: row for row in stored_figures().rows if archive_name(row.condition) == path.name}
    counts: dict[str, list[dict[str, str]]] = {}
    for line in read_archive(path):
        counts.setdefault(line["task"], []).append(line)
    assert set(counts) <= set(rows)
    for task, lines in counts.items():
        row = rows[task]
        assert {line["run_seed"] for line in lines} == {str(row.seed)}
        found = [sum(line[name] == "1" for line in lines) for name in ("paper", "held", "strict")]
        assert [len(lines), *found] == [row.episodes, row.paper, row.held, row.strict]


def test_damaged_figures_are_named(tmp_path: Path) -> None:
    (row,) = rows_of(written(tmp_path / "a.json", document()))
    whole = Figures(schema_version=1, rows=(row,)).model_dump(mode="json")
    assert read_figures(written(tmp_path / "whole.json", whole)).rows == (row,)
    for field, value in (("held", 7), ("strict", 9), ("paper", 9), ("causes", {})):
        damaged = {**whole, "rows": [{**whole["rows"][0], field: value}]}
        with pytest.raises(InputError, match=r"damaged\.json: rows\.0: "):
            read_figures(written(tmp_path / "damaged.json", damaged))
    with pytest.raises(InputError, match="two rows have the same task and condition"):
        read_figures(written(tmp_path / "twice.json", {**whole, "rows": whole["rows"] * 2}))
    with pytest.raises(InputError, match="cannot be read"):
        read_figures(tmp_path / "none.json")
    (tmp_path / "figures.json.xz").write_bytes(b"not compressed")
    with pytest.raises(InputError, match=r"figures\.json\.xz: is damaged"):
        read_figures(tmp_path / "figures.json.xz")


def test_figures_that_travel_are_of_tasks_that_there_are() -> None:
    assert {row.task for row in stored_figures().rows} <= set(task_names())
    assert figures_of("NoSuchTask") == ()
    assert set(MEASURED) <= set(PAPER)
    assert all(0 <= successes <= episodes for successes, episodes in MEASURED.values())
    assert set(Condition.model_fields) >= {"objects", "physics", "instances", "randomization", "attempts"}


def test_a_row_says_where_it_comes_from_and_how_each_instance_did(tmp_path: Path) -> None:
    made = {"commit": "abc", "date": "2026-01-02", "command": "gensim2 benchmark OpenDrawer --out /home/me/runs"}
    (row,) = rows_of(written(tmp_path / "a.json", {**document(), "provenance": made}))
    assert row.source is not None
    assert (row.source.commit, row.source.date) == ("abc", "2026-01-02")
    assert row.source.command.startswith("gensim2 benchmark OpenDrawer --runs ")
    assert "/home/me" not in row.source.command
    assert sum(each.episodes for each in row.instances.values()) == row.episodes == 8
    assert sum(each.held for each in row.instances.values()) == row.held == 6
    wrong = {name: each.model_copy(update={"held": 0}) for name, each in row.instances.items()}
    with pytest.raises(ValueError, match="the values of 'held' in 'instances' do not sum"):
        type(row).model_validate({**row.model_dump(), "instances": {k: v.model_dump() for k, v in wrong.items()}})
    page = page_by_instance([row, *figures_of("OpenBox")[:2]])
    assert "OpenDrawer: default physics, generated objects" in page
    assert all(f"<td>{name}</td>" in page for name in row.instances)


def test_the_command_of_a_row_is_the_one_that_made_it(tmp_path: Path) -> None:
    """Parsing the command gives the condition of the row again."""
    told = {"physics": "original", "randomization": "wide", "attempts": 8, "open_loop": True, "assets": "/objects"}
    (row,) = rows_of(written(tmp_path / "a.json", document(**told)))
    words = command_of([row], "/objects")
    given = benchmark.make_context("benchmark", words[1:]).params
    assert (given["tasks"], given["seed"]) == (("OpenDrawer",), 9)
    assert (given["runs"], given["episodes"], given["attempts"]) == (2, 4, 8)
    assert (given["physics"], given["randomization"], given["open_loop"]) == ("original", "wide", True)
    with pytest.raises(InputError, match="real objects"):
        command_of([row], None)


def test_rows_of_one_command_are_made_together() -> None:
    groups = made_together(stored_figures().rows)
    assert sum(map(len, groups)) == len(stored_figures().rows)
    for group in groups:
        assert len({(row.condition, row.seed, row.runs) for row in group}) == 1
        assert len({row.task for row in group}) == len(group)
