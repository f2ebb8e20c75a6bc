"""``gensim2 robot``: errors, checks, and results as JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gensim2.cli import main as cli

DOCS = Path(__file__).parents[2] / "docs"
RUN = ["robot", "run", "CloseBox", "--plan", "--assets", "builtin"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--fault", "nothing@1"], "unknown fault 'nothing'"),
        (["--fault", "camera-late"], "has no valid time"),
        (["--pixels", "big"], "not the size of a picture"),
        (["--speed", "2"], "--speed"),
        (["--policy", "somewhere"], "either --plan or --policy"),
        (["--arm", "fr3"], "franka:HOST"),
        (["--arm", "franka:1.2.3.4"], "both are real, or both are simulated"),
        (["--arm", "ur:1.2.3.4", "--cameras", "realsense:left=1"], "give --scene perceived"),
        (["--scene", "nowhere"], "nowhere"),
        (["--no-log", "--fault", "disk-full@1"], "needs a log"),
    ],
)
def test_wrong_words_are_one_line(capfd: pytest.CaptureFixture[str], words: list[str], said: str) -> None:
    assert cli.run([*RUN, *words]) == 2
    _, err = capfd.readouterr()
    assert said in err
    assert err.count("\n") == 1


def test_a_run_by_a_simulated_clock_says_what_came_of_it(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.json"
    words = ["--minutes", "0.05", "--pixels", "64x48", "--json", str(out)]  # option for simulated arms
    assert cli.run([*RUN, *words, "--out", str(tmp_path / "log"), "--fault", "camera-frozen@1.5"]) == 1
    found = json.loads(out.read_text())
    keys = "periods_ms overruns cloud_ms state reason detected_to_stopped_ms limits_passed success"
    assert set(keys.split()) <= set(found)
    assert set(found["periods_ms"]) == {"p50", "p99", "worst"}
    assert (found["state"], found["limits_passed"]) == ("holding", 0)
    assert found["scheduling"] == "simulated"
    said = capfd.readouterr().out
    assert "frozen" in said
    assert "no command exceeded a limit" in said
    folder = tmp_path / "log"
    assert f"next: gensim2 robot export {folder} --out {folder}-film makes a film" in said
    assert f"next: gensim2 robot replay {folder} checks" in said
    assert cli.run(["robot", "replay", str(tmp_path / "log"), "--json", str(out)]) == 0
    again = json.loads(out.read_text())
    assert again["different"] == []
    assert again["clouds"] > 0
    capfd.readouterr()
    assert cli.run(["robot", "replay", str(tmp_path)]) == 2
    assert "contains no log" in capfd.readouterr().err


def test_a_dry_run_moves_nothing_and_says_why_it_finished_no_episode(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.json"
    words = ["--simulated-clock", "--minutes", "0.05", "--pixels", "64x48", "--json", str(out), "--no-log"]
    assert cli.run(["robot", "dry-run", *RUN[2:], *words]) == 0
    found = json.loads(out.read_text())
    assert found["limits_passed"] == 0
    assert found["log"] is None
    assert found["seconds"] > 2.0
    assert not found["success"]
    assert (found["state"], found["reason"]) == ("idle", "the time limit of the run ended episode 1 early")
    said = capfd.readouterr().out
    assert "no episode was finished in 3 s of simulated time: at speed 0.1 an episode may take up to 200 s" in said
    assert "give more --minutes or a higher --speed" in said


def test_the_check_names_what_it_looked_at(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    assert cli.run(["robot", "check", "--json", str(out)]) in (0, 1)  # 1 on a busy machine
    found = {each["name"]: each for each in json.loads(out.read_text())["checks"]}
    assert found["mcap"]["fine"]
    assert found["start"]["fine"]
    assert {"clock", "limits", "room for the log"} <= set(found)


def test_the_page_begins_with_safety_and_names_every_fault_and_figure() -> None:
    from gensim2_robot.faults import FAULTS

    first = (DOCS / "guides/robot.md").read_text().split("\n## ")[1]
    assert first.startswith("First: safety")
    for word in ("not safety-rated", "ISO 12100", "ISO 10218", "emergency stop"):
        assert word in first
    text = (DOCS / "reference/robot.md").read_text()
    for word in (*FAULTS, "periods_ms", "cloud_ms", "detected_to_stopped_ms", "limits_passed", "success"):
        assert f"`{word}`" in text, word
