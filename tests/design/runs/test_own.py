"""An own task is designed, resumed and reported, in a made-up world."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import fake_world
import pytest

from gensim2.cli import main as cli
from gensim2.design import design_task, own
from gensim2.design.checking import CHANGE_GOAL
from gensim2.design.next_steps import next_steps
from gensim2.design.report import write_report
from gensim2.design.search import Budget
from gensim2.rollout import worker
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.checker_result import Mutation, WorldCount
from gensim2.rollout.record import Episode
from gensim2.scenes.goal import GoalError
from gensim2.tasks.library import load_strategies_beside, load_task_file

TASK = """# as its author wrote it
schema_version: 2
name: ShutMyBox
description: shut my box
objects:
  box: {class: box_rotate}
steps:
  - name: shut
    object: box
    done: [{type: articulated_closed, object: box}]
"""
BUDGET = Budget(rounds=((4, 2),), refined=(2, 2), comparison=(2, 4), max_physics_episodes=30)
GIVEN: dict[str, Any] = {"assets": "builtin", "workers": 0, "videos": 0, "verify": 5, "seed": 1, "budget": BUDGET}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A task without strategies."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "task.yaml").write_text(TASK)
    return tmp_path / "mine"


@pytest.fixture
def verdict(monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], list[int]]:
    """Let every episode hold, or none; return the seeds of those that run."""

    def set_to(held: bool) -> list[int]:
        seeds: list[int] = []

        def run(config: EpisodeConfig, ways: Any, seed: int) -> Episode:
            seeds.append(seed)
            found = fake_world.demonstrate(config, {}, seed)[0]
            if held:
                return replace(found, paper=True, held=True, strict=True, strict_misses=[], still=False, cause=None)
            return replace(found, held=False, strict=False, cause=fake_world.Cause.NO_CONTACT)

        monkeypatch.setattr(worker, "trial", run)
        monkeypatch.setattr(worker, "episode", run)
        return seeds

    return set_to


def test_strategies_that_hold_are_written_beside_the_task(folder: Path, verdict: Callable[[bool], list[int]]) -> None:
    verdict(True)
    found = design_task(folder, **GIVEN)
    task = load_task_file(folder)
    assert found.folder == folder
    assert found.strategies == task.steps[0].strategies
    assert set(load_strategies_beside(folder, task)) == set(found.strategies)
    assert task.provenance is not None
    assert (task.provenance.origin, task.provenance.strategies[found.strategies[0]].by) == ("hand", "search")
    assert task.provenance.verification is not None
    assert task.provenance.verification.held == 5
    assert (folder / "design" / "before.yaml").read_text() == TASK
    assert design_task(folder, **GIVEN, resume=True).strategies == found.strategies
    assert (folder / "design" / "before.yaml").read_text() == TASK


def test_with_a_run_folder_of_its_own_the_task_stays_as_it_is(
    folder: Path, tmp_path: Path, verdict: Callable[[bool], list[int]]
) -> None:
    verdict(True)
    found = design_task(folder, out=tmp_path / "run", **GIVEN)
    assert found.folder == tmp_path / "run" / "tasks" / "ShutMyBox"
    assert [path.name for path in folder.iterdir()] == ["task.yaml"]
    assert (folder / "task.yaml").read_text() == TASK


def test_an_interrupted_search_repeats_nothing(
    folder: Path, tmp_path: Path, verdict: Callable[[bool], list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    undisturbed = verdict(True)
    design_task(folder, out=tmp_path / "undisturbed", **GIVEN)
    episodes = len(undisturbed)
    seeds = verdict(True)
    screened: list[int] = []
    trial, screen = worker.trial, worker.screen_scene

    def interrupted(config: EpisodeConfig, ways: Any, seed: int) -> Episode:
        if len(seeds) == 5:
            raise KeyboardInterrupt
        return trial(config, ways, seed)

    def screen_scene(config: EpisodeConfig, seed: int, candidates: Any) -> Any:
        screened.append(seed)
        return screen(config, seed, candidates)

    monkeypatch.setattr(worker, "trial", interrupted)
    monkeypatch.setattr(worker, "screen_scene", screen_scene)
    with pytest.raises(KeyboardInterrupt):
        design_task(folder, **GIVEN)
    assert len(seeds) == 5
    planned = len(screened)
    monkeypatch.setattr(worker, "trial", trial)
    design_task(folder, **GIVEN, resume=True)
    assert len(seeds) == episodes
    assert len(screened) == planned
    names = ("design.json", "verification.json", "task.yaml")
    resumed, whole = (where / "tasks" / "ShutMyBox" for where in (folder / "design", tmp_path / "undisturbed"))
    assert [(resumed / name).read_bytes() for name in names] == [(whole / name).read_bytes() for name in names]
    assert not (resumed / "search").exists()


def test_a_task_whose_criteria_lie_is_refused_before_the_search(
    folder: Path,
    verdict: Callable[[bool], list[int]],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In two of three worlds of each scene the goal holds although the box was hardly moved."""
    seeds = verdict(True)

    def judge_scene(config: EpisodeConfig, seed: int) -> list[WorldCount]:
        about = ("articulated_closed",)
        return [
            WorldCount(None, str(Mutation.AT_START), "box", about, 1, 0),
            WorldCount(None, str(Mutation.A_LITTLE), "box", about, 2, 2),
        ]

    monkeypatch.setattr(worker, "judge_scene", judge_scene)
    reason = (
        "the success criteria hold in 20 of 30 worlds in which the task is not done (at most 1% may): "
        "box: it was moved only a little (20 of 20; articulated_closed)"
    )
    found = design_task(folder, **GIVEN)
    assert seeds == [], "nothing was searched"
    assert found.folder is None
    assert [each["reason"] for each in found.run.rejected] == [f"{reason} ({CHANGE_GOAL})"]
    rejected = folder / "design" / "rejected" / "ShutMyBox"
    assert json.loads((rejected / "checker.json").read_text())["error"] == 0.6667
    page = (folder / "design" / "report.html").read_text()
    assert "it was moved only a little" in page
    assert "<li>correct task.yaml as the reason of the rejection says</li>" in page
    assert f"<li>then delete {folder / 'design'} or choose another --out, and run the command again</li>" in page
    assert "videos of failed episodes" not in page, "no episode was run"
    monkeypatch.setattr(worker, "judge_scene", None)
    assert design_task(folder, **GIVEN, resume=True).run.rejected == found.run.rejected, "it is not judged again"


def test_a_goal_that_is_true_at_the_start_is_rejected_with_its_remedy(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def judge_scene(config: EpisodeConfig, seed: int) -> list[WorldCount]:
        raise GoalError("the goal is already reached", remedy="change openness_mean")

    monkeypatch.setattr(worker, "judge_scene", judge_scene)
    (rejected,) = design_task(folder, **GIVEN).run.rejected
    assert rejected["reason"] == "the goal is already reached (change openness_mean)"


def test_what_never_holds_is_reported_with_what_to_do_next(
    folder: Path,
    verdict: Callable[[bool], list[int]],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    verdict(False)
    run_here = own.run_pipeline
    monkeypatch.setattr(own, "run_pipeline", lambda **given: run_here(**{**given, "workers": 0, "budget": BUDGET}))
    assert cli.run(["design", str(folder), "--assets", "builtin", "--videos", "0", "--library", "none"]) == 1
    said = capsys.readouterr()
    assert "at most 30 episodes of search, then 20 of verification" in said.err
    assert re.search(r"no candidate held in physics; the best candidate, '.+ openness \S+': object did not move\n", said.out)
    advice = said.out.partition("no task was kept; next:\n")[2]
    assert advice.startswith(f"- read the causes and the residuals of the plans in {folder / 'design' / 'report.html'}\n")
    assert "- most failures have the cause 'object did not move': give the hand something to grip" in advice
    assert "relax the task" not in advice
    film = folder / "design" / "rejected" / "ShutMyBox" / "failed_000000.mp4"
    film.write_bytes(b"")
    assert str(next_steps(folder / "design")[0]) == f"watch the videos of failed episodes: {film}"
    assert (folder / "task.yaml").read_text() == TASK
    page = (folder / "design" / "report.html").read_text()
    assert "No task was kept" in page
    assert "no candidate held in physics; the best candidate, " in page
    assert '<a href="#ShutMyBox">' in page
    assert "videos were disabled (--videos 0)" in page
    assert "Vulkan" not in page


def test_films_and_the_plan_are_on_the_page(folder: Path, verdict: Callable[[bool], list[int]]) -> None:
    verdict(False)
    design_task(folder, **GIVEN)
    rejected = folder / "design" / "rejected" / "ShutMyBox"
    for name in ("plan.png", "failed_000000.mp4"):
        (rejected / name).write_bytes(b"")
    page = write_report(folder / "design").read_text()
    assert 'src="rejected/ShutMyBox/failed_000000.mp4"' in page
    assert 'src="rejected/ShutMyBox/plan.png"' in page
    assert "no pictures" not in page


def test_a_folder_without_a_task_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["design", str(tmp_path), "--assets", "builtin", "--json", "-"]) == 2
    assert "task.yaml: is not there" in capsys.readouterr().err
    (tmp_path / "task.yaml").write_text(TASK.replace("box_rotate", "no_such_class"))
    assert cli.run(["design", str(tmp_path), "--assets", "builtin"]) == 2
    assert "no_such_class" in capsys.readouterr().err
    assert not (tmp_path / "design").exists()
