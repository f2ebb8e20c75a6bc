"""Tables in the documentation agree with the figures."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conditions import PLAIN

from gensim2.core.errors import InputError
from gensim2.tasks.figures import Condition, Figure, Source, Verdicts
from gensim2.tasks.library import load_task
from gensim2.tasks.published import PAPER

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def made() -> Iterator[Any]:
    sys.path.insert(0, str(BENCHMARKS))
    import results_table

    yield results_table
    sys.path.remove(str(BENCHMARKS))


def _row(task: str, held: int, *, seed: int = 7, **condition: Any) -> Figure:
    return Figure(
        task=task,
        condition=Condition(**{"objects": "real", **PLAIN, **condition}),
        seed=seed,
        runs=5,
        episodes=250,
        paper=240,
        held=held,
        strict=held // 2,
        deviation=0.01,
        partial=3,
        causes={"contact slipped": 250 - held} if held < 250 else {},
        strict_misses={},
        objects={"drawer": 12},
    )


ROWS = [
    _row("TurnOnFaucet", 200),
    _row("OpenBox", 250),
    _row("OpenBox", 225, physics="original"),
    _row("PlaceGolfBallIntoDrawer", 125, objects="generated", seed=8),
    _row("OpenBox", 100, randomization="wide", attempts=8, open_loop=True),
    _row("OpenBox", 50, instances="test", disturbance="push"),
]


def test_every_condition_has_a_section_and_every_cell_its_figures(made: Any) -> None:
    text = made.everything(ROWS)
    titles = [line for line in text.splitlines() if line.startswith("##")]
    assert titles == [
        "## Means over tasks",
        "## The paper's protocol",
        "## Randomization wide, up to 8 attempts, open loop",
        "## Instances test, disturbance push",
    ]
    means, first = (section.splitlines() for section in text.split("## ")[1:3])
    assert [line for line in means if line.startswith("|")][2:] == [
        "| The paper's protocol | single-step |  | 0.96 / 0.90 / 0.45 (of 2) |  | 0.96 / 0.90 / 0.45 (of 1) |",
        "| The paper's protocol | long-horizon | 0.96 / 0.50 / 0.25 (of 1) |  |  |  |",
        "| Randomization wide, up to 8 attempts, open loop | single-step |  | 0.96 / 0.40 / 0.20 (of 1) |  |  |",
        "| Instances test, disturbance push | single-step |  | 0.96 / 0.20 / 0.10 (of 1) |  |  |",
    ]
    unknown = "The commit of all 4 rates is unknown, because earlier measurements did not record it."
    measured = "Each success rate in the following tables was measured in 5 runs of 50 episodes."
    assert f"{measured} The seeds are 7, 8. {unknown}" in first
    assert [line for line in first if line.startswith("|")] == [
        "| single-step task | default, real | original, real | paper | its release |",
        "| --- | --- | --- | --- | --- |",
        "| OpenBox | 0.96 / 1.00 (0.98–1.00) / 0.50 | 0.96 / 0.90 (0.86–0.93) / 0.45 | 0.84 | 0.80 (0.49–0.94) |",
        "| TurnOnFaucet | 0.96 / 0.80 (0.75–0.84) / 0.40 |  | 0.67 | 0.60 (0.31–0.83) |",
        "| mean | 0.96 / 0.90 / 0.45 (of 2) | 0.96 / 0.90 / 0.45 (of 1) | 0.76 |  |",
        "| long-horizon task | default, generated | paper | its release |",
        "| --- | --- | --- | --- |",
        "| PlaceGolfBallIntoDrawer | 0.96 / 0.50 (0.44–0.56) / 0.25 | 0.56 |  |",
        "| mean | 0.96 / 0.50 / 0.25 (of 1) | 0.56 |  |",
    ]


def test_rows_say_their_commit_and_the_object_on_which_they_hold_least(made: Any) -> None:
    source = Source(commit="0123456789abcdef", date="2026-01-02", command="gensim2 benchmark")
    seen = {
        "box/1": Verdicts(episodes=200, paper=200, held=200, strict=100),
        "box/2": Verdicts(episodes=46, paper=36, held=24, strict=12),
        "box/3": Verdicts(episodes=4, paper=4, held=1, strict=0),
    }
    row = _row("OpenBox", 225).model_copy(update={"source": source, "instances": seen})
    text = made.everything([row, _row("TurnOnFaucet", 200)])
    made_at = "The seed is 7. The rates were measured at these commits of gensim2: 0123456789ab (2026-01-02)."
    assert f"{made_at} The commit of 1 of 2 rates is unknown" in text
    assert "| OpenBox | 24/46 box/2 |" in text
    assert "| TurnOnFaucet |" not in text.split("## The worst object of each row")[1]


def test_the_release_over_all_its_tasks_stands_below_all_tasks(made: Any) -> None:
    single = [_row(task, 250) for task in PAPER if load_task(task).is_single_step]
    assert "| mean | 0.96 / 1.00 / 0.50 (of 24) | 0.81 | 0.77 (0.74–0.80) of 720 |" in made.everything(single)


def test_the_short_table_counts_as_the_paper_in_its_physics_and_what_holds_in_ours(made: Any) -> None:
    lines = made.short(ROWS).splitlines()
    assert "| OpenBox | 1.00 (0.98–1.00) | 0.96 (0.93–0.98) | 0.84 | 0.80 (0.49–0.94) |" in lines
    assert "| mean | 0.90 (of 2) | 0.96 (of 1) | 0.76 |  |" in lines
    assert not any("wide" in line for line in lines)


def test_the_table_of_means_has_one_row_per_type_and_the_same_columns_for_both(made: Any) -> None:
    lines = made.means(ROWS).splitlines()
    assert lines[0] == "| tasks | default, generated | default, real | original, real | paper | its release |"
    assert lines[2:] == [
        "| single-step |  | 0.90 (of 2) | 0.96 (of 1) | 0.76 |  |",
        "| long-horizon | 0.50 (of 1) |  |  | 0.56 |  |",
    ]


def test_a_document_keeps_all_but_what_stands_between_the_marks(made: Any) -> None:
    text = "# A\n\n<!-- figures: short -->\nbefore\n<!-- /figures -->\nb\n<!-- figures: all -->\n<!-- /figures -->\nc\n"
    new = made.renewed(text, ROWS)
    assert new.startswith("# A\n\n<!-- figures: short -->\n\n| single-step task |")
    assert new.endswith("\n<!-- /figures -->\nc\n")
    assert "\nbefore\n" not in new
    assert made.renewed(new, ROWS) == new
    with pytest.raises(InputError, match="figures: all"):
        made.renewed("nothing", ROWS)


def test_tables_are_made_of_the_json_of_benchmarks(
    made: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(made, "rows_of", lambda path: ROWS[:1] if path.name == "one.json" else ROWS[1:2])
    monkeypatch.setattr(sys, "argv", ["results_table", "one.json", "two.json"])
    made.main()
    assert capsys.readouterr().out == made.everything(ROWS[:2]) + "\n"


def test_a_section_is_written_by_its_title(made: Any) -> None:
    text = "<!-- figures: section The paper's protocol -->\n<!-- /figures -->"
    assert made.section("The paper's protocol", ROWS) in made.renewed(text, ROWS)
    assert made.overview(ROWS) in made.renewed("<!-- figures: overview -->\n<!-- /figures -->", ROWS)
    with pytest.raises(InputError, match="no figures 'section Nowhere'"):
        made.renewed("<!-- figures: section Nowhere -->\n<!-- /figures -->", ROWS)


def test_switches_are_compared_on_the_same_scenes(made: Any) -> None:
    """One setting gains 10 of 250 episodes and the other loses 60; rows of another seed or without a default are
    ignored.
    """
    word = "default+hulls=original"
    rows = [
        _row("TurnOnFaucet", 200),
        _row("OpenBox", 240),
        _row("TurnOnFaucet", 210, physics=word),
        _row("OpenBox", 180, physics=word),
        _row("CloseBox", 10, physics=word),
        _row("OpenBox", 250, physics="default+solver=original", seed=8),
    ]
    table = made.switches(rows).splitlines()
    assert len(table) == 3
    assert table[2].startswith(f"| `{word}` | 2 single-step | 250 | +0.0 (+0.0 to +0.0) | -10.0 (-37.4 to +17.4) |")
    with pytest.raises(InputError, match="no switch and its default"):
        made.switches(rows[:2])
    assert "hulls" not in made.everything(rows)


def test_switches_stand_in_a_file_of_their_own(made: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    rows = [_row("OpenBox", 240), _row("OpenBox", 180, physics="default+hulls=original")]
    monkeypatch.setattr(made, "SWITCHES", tmp_path / "switches.json")
    made.take_in(rows)
    text = made.renewed("<!-- figures: switches -->\n<!-- /figures -->", ROWS)
    assert made.switches(rows) in text
    made.take_in([_row("OpenBox", 120, physics="default+densities=original")])
    made.take_in([_row("OpenBox", 200, physics="default+hulls=original")])
    kept = {row.condition.physics: row.held for row in made.measured_switches()}
    assert kept == {"default": 240, "default+hulls=original": 200, "default+densities=original": 120}


def test_claims_are_counted_of_rows_that_know_their_commit(made: Any) -> None:
    import results_claims

    source = Source(commit="abc", date="2026-01-02", command="gensim2 benchmark")
    own = [
        _row("OpenBox", 250, physics="original").model_copy(update={"source": source, "paper": 250}),
        _row("PushToasterForward", 250, physics="original").model_copy(update={"source": source, "paper": 247}),
        _row("OpenBox", 200, physics="original", one_plan=True).model_copy(update={"source": source, "paper": 225}),
        _row("OpenBox", 200, physics="original", open_loop=True),
    ]
    first, second = results_claims.claims(own).splitlines()
    assert "0.994 on single-step tasks (2 tasks, 500 episodes)" in first
    assert "In 1 of 2 tasks the 95 % interval" in first
    assert "The exception is PushToasterForward (our rate is 0.99, the paper's 0.99)." in first
    assert "the paper reports 0.81 and 0.47, and the authors' release reaches 0.77 (556 of 720)" in first
    assert second == (
        "2. **Simpler planners under the same conditions.** If the planner plans each step only once, with its "
        "first strategy, the mean success rates are 0.900 on single-step tasks (1 tasks, 250 episodes)."
    )


def test_the_engines_are_compared_task_by_task(made: Any) -> None:
    rows = [
        _row("OpenBox", 250),
        _row("OpenBox", 225, engine="mujoco"),
        _row("OpenBox", 1, engine="mujoco", randomization="wide"),
        _row("OpenBox", 2, physics="original"),
        _row("PlaceGolfBallIntoDrawer", 200, engine="mujoco", objects="generated"),
    ]
    lines = made.renewed("<!-- figures: engines -->\n<!-- /figures -->", rows).splitlines()
    assert "| OpenBox |  |  |  | 250/250 | 225/250 | **0.000** |" in lines
    assert "| mean |  |  |  | 1.000 (0.985–1.000) | 0.900 (0.857–0.931) |  |" in lines
    assert "| PlaceGolfBallIntoDrawer |  | 200/250 |  |  |  |  |" in lines
    assert "| OpenBox | 24/25 |" not in made.short(rows[:2])
    assert "| Engine mujoco | single-step |" in made.overview(rows)


def test_designed_tasks_and_policies_are_taken_in_from_the_json_of_runs(
    made: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    import engines_table

    monkeypatch.setattr(engines_table, "FILE", tmp_path / "engines.json")
    for controller, engine, held in (
        ({}, "mujoco", 5),
        ({"controller": {}}, "mujoco", 18),
        ({"controller": {}}, "sapien", 20),
    ):
        records = [{"held": number < held} for number in range(20)]
        task = {"name": "OpenOven" if not controller else "OpenBox", "episodes": 20, "records": records, "causes": {}}
        file = tmp_path / "run.json"
        arguments = {"engine": engine, "instances": "all", "seed": 1}
        file.write_text(json.dumps({**controller, "arguments": arguments, "tasks": [task]}))
        monkeypatch.setattr(sys, "argv", ["engines_table", str(file), "--commit", "abc"])
        assert engines_table.main() == 0
    text = made.renewed(
        "<!-- figures: designed -->\n<!-- /figures -->\n<!-- figures: policy -->\n<!-- /figures -->", ROWS
    )
    assert "Of 1 measured tasks, 1 succeed in SAPIEN often enough to be kept" in text
    assert "and 0 succeed often enough in MuJoCo. The success rate over all episodes" in text
    assert "No task would be kept in one engine only" not in text
    assert "| OpenOven | 49/50 | 5/20 | **0.000** |" in text
    assert "| OpenBox | 20/20 | 18/20 | 0.49 |" in text
    assert "-10.0 points (± 13.1)" in text
    stored = json.loads((tmp_path / "engines.json").read_text())
    for row in stored["rows"]:
        row["held"] = row["episodes"]
    (tmp_path / "engines.json").write_text(json.dumps(stored))
    text = made.renewed("<!-- figures: designed -->\n<!-- /figures -->", ROWS)
    assert "No task would be kept in one engine only" in text
    assert "OpenOven" not in text
