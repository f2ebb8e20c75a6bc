"""The report agrees with the run folder and needs no file outside it."""

from __future__ import annotations

import json
import os
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
import run_folders

from gensim2.core.errors import InputError
from gensim2.data.runfolder import TaskFolder
from gensim2.design.report import PLAN_PICTURE, write_report
from gensim2.rollout.episode_log import EpisodeLog
from gensim2.rollout.tally import interval
from gensim2.tasks.criteria import ArticulatedClosed, ArticulatedOpen
from gensim2.tasks.spec import ObjectSpec, Step, TaskSpec

VOID = {"meta", "link", "img", "line", "circle"}


class Balanced(HTMLParser):
    """Collects the references of a page and checks that each element is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value for name, value in attrs if name in ("src", "href", "poster") and value]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in VOID

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag


def _parse(path: Path) -> Balanced:
    page = Balanced()
    page.feed(path.read_text())
    assert page.open == []
    return page


def test_page_shows_tasks_rejections_and_candidates(run_dir: Path) -> None:
    path = write_report(run_dir)
    text = path.read_text()
    _parse(path)
    assert "18 of 20 fresh random episodes hold" in text
    assert "3 of 20 fresh episodes succeeded; 70% are needed" in text
    assert "no candidate could be planned" in text
    assert "gensim2 run-pipeline --num-tasks 3" in text
    assert "and 8 more in design.json" in text
    assert "Apache-2.0" in text
    assert "contact slipped" in text


def test_page_tells_the_three_verdicts_with_intervals_and_the_number_of_objects(run_dir: Path) -> None:
    text = write_report(run_dir).read_text()
    bar = r"\s*<span.*?</span></span><span class=\"num\">{}/20</span></span>\s*"
    row = rf"<td>{{}}</td><td>{bar}</td><td class=\"num\">{{}}</td>"
    # 18 of 20 succeeded; nine of them have an even seed and meet the strict criterion.
    assert re.search(row.format("held", 18, "0.70 to 0.97"), text, re.S)
    assert re.search(row.format("strict", 9, "0.26 to 0.66"), text, re.S)
    assert "box_rotate (4)" in text
    assert "The search used none of these objects." in text
    assert "the hand has not let go" in text


def test_of_one_object_the_page_does_not_say_that_the_search_used_none(run_dir: Path) -> None:
    for path in (run_dir / "tasks").iterdir():
        folder = TaskFolder(path)
        found = folder.verification()
        assert found is not None
        alike = tuple(episode for episode in found.episodes if episode.objects["box"].id == "0")
        folder.write_verification(replace(found, episodes=alike))
    for path in (run_dir / "rejected").iterdir():
        (path / "verification.json").unlink()
    assert "The search used none" not in write_report(run_dir).read_text()


def test_a_run_of_demonstrations_alone_shows_its_episodes_and_steps(run_dir: Path) -> None:
    folder = run_dir / "tasks" / "LongDemo"
    opened = ArticulatedOpen(object="box")
    task = TaskSpec(
        name="LongDemo",
        description="open the box and close it again",
        objects={"box": ObjectSpec(asset_class="box_rotate")},
        steps=(
            Step(name="open", object="box", strategies=("lift",), done=(opened,)),
            Step(name="shut_it", object="box", strategies=("push",), done=(ArticulatedClosed(object="box"),)),
        ),
    )
    TaskFolder(folder).write_task(task)
    seeds = (2, 3, 4)
    log = EpisodeLog(folder / "attempts.jsonl", seeds)
    for index, seed in enumerate(seeds):
        log.add(index, run_folders.fake_world.episode_of(task, seed, held=seed != 3))
    text = write_report(run_dir).read_text()
    assert "2 of 3 episodes hold" in text
    assert "openness of the box below 0.2" in text
    assert "shut it" in text
    assert "object did not move" in text


def test_every_reference_is_a_file_of_the_run_folder(run_dir: Path) -> None:
    (run_dir / "tasks" / "OpenDemo" / "video.mp4").write_bytes(b"film")
    (run_dir / "tasks" / "OpenDemo" / "still.png").write_bytes(b"picture")
    references = [r for r in _parse(write_report(run_dir)).references if not r.startswith(("#", "data:"))]
    assert "tasks/OpenDemo/video.mp4" in references
    assert "tasks/OpenDemo/still.png" in references
    for reference in references:
        assert (run_dir / reference).is_file()


def test_the_advice_links_to_films_and_to_candidates_of_the_page(run_dir: Path) -> None:
    shutil.rmtree(run_dir / "tasks")
    film = run_dir / "rejected" / "LiftDemo" / "failed_000004.mp4"
    film.touch()
    path = write_report(run_dir)
    assert {"rejected/LiftDemo/failed_000004.mp4", "#LiftDemo"} <= set(_parse(path).references)
    advice = path.read_text().partition("No task was kept")[2].partition("</section>")[0]
    assert '<a href="rejected/LiftDemo/failed_000004.mp4">LiftDemo, failed_000004.mp4</a>' in advice
    assert '<a href="#LiftDemo">LiftDemo</a>' in advice
    assert str(run_dir) not in advice


def test_films_and_plan_of_a_failed_search_name_the_candidate(run_dir: Path) -> None:
    folder = run_dir / "rejected" / "LiftDemo"
    (folder / "verification.json").unlink()
    for name in ("failed_000000.mp4", PLAN_PICTURE):
        (folder / name).touch()
    card = write_report(run_dir).read_text().partition('id="LiftDemo"')[2]
    assert "the best candidate: hook candidate 0: tip" in card
    assert "Candidate: hook candidate 0: tip" in card


def test_the_verdicts_are_explained(run_dir: Path) -> None:
    text = write_report(run_dir).read_text()
    assert text.count("Success has three definitions, called verdicts.") == 1
    assert all(f"<b>{name}</b>: " in text for name in ("paper", "held", "strict"))


def test_text_from_files_is_escaped(run_dir: Path) -> None:
    text = write_report(run_dir).read_text()
    assert "<lid>" not in text
    assert "raise the &lt;lid&gt; until it stands open" in text


def test_a_run_that_has_just_begun_has_a_report(run_dir: Path) -> None:
    record = json.loads((run_dir / "run.json").read_text())
    (run_dir / "run.json").write_text(json.dumps({**record, "finished": None, "result": None}))
    for name in ("verification.json", "design.json", "trajectory.json", "strategies/designed.yaml"):
        (run_dir / "tasks" / "OpenDemo" / name).unlink()
    text = write_report(run_dir).read_text()
    assert "not finished" in text
    assert "not verified" in text


def test_same_files_same_bytes(run_dir: Path) -> None:
    assert write_report(run_dir).read_bytes() == write_report(run_dir).read_bytes()


def test_folder_without_a_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"run\.json"):
        write_report(tmp_path)


def test_broken_yaml_is_named(run_dir: Path) -> None:
    (run_dir / "tasks" / "OpenDemo" / "task.yaml").write_text("a: [")
    with pytest.raises(InputError, match=r"OpenDemo/task\.yaml"):
        write_report(run_dir)


def test_interval_of_a_known_case() -> None:
    # Wilson score interval for 18 of 20, from R's binom.confint.
    low, high = interval(18, 20)
    assert low == pytest.approx(0.6990, abs=5e-4)
    assert high == pytest.approx(0.9721, abs=5e-4)
    assert interval(0, 0) == (0.0, 1.0)


def test_page_loads_nothing_from_elsewhere(run_dir: Path) -> None:
    text = write_report(run_dir).read_text()
    assert not re.search(r"""(src|href)=["'](https?:)?//""", text)
    assert "@import" not in text
    assert "<script" not in text


@pytest.mark.parametrize("name", ["report.html", "strategies/extra.yaml"])
def test_a_link_out_of_the_folder_is_neither_read_nor_written_to(run_dir: Path, tmp_path: Path, name: str) -> None:
    secret = tmp_path / "secret"
    secret.write_text("of somebody else")
    place = run_dir if name == "report.html" else next((run_dir / "tasks").iterdir())
    (place / name).parent.mkdir(exist_ok=True)
    (place / name).symlink_to(secret)
    with pytest.raises(InputError, match="is a link out of the folder"):
        write_report(run_dir)
    assert secret.read_text() == "of somebody else"


def test_a_pipe_among_the_strategies_is_not_waited_for(run_dir: Path) -> None:
    strategies = next((run_dir / "tasks").iterdir()) / "strategies"
    strategies.mkdir(exist_ok=True)
    os.mkfifo(strategies / "pipe.yaml")
    with pytest.raises(InputError, match="is a pipe"):
        write_report(run_dir)


def test_a_count_of_one_is_singular(run_dir: Path) -> None:
    shutil.rmtree(run_dir / "tasks" / "CloseDemo")
    shutil.rmtree(run_dir / "rejected" / "LiftDemo")
    folder = TaskFolder(run_dir / "tasks" / "OpenDemo")
    found = folder.verification()
    assert found is not None
    (step,) = found.episodes[0].steps
    (plan,) = step.plans
    partial = replace(plan, status="partial", trigger="the object has moved")
    again = replace(found.episodes[0], steps=[replace(step, plans=[plan, partial])])
    folder.write_verification(replace(found, episodes=(again, *found.episodes[1:])))
    text = write_report(run_dir).read_text()
    assert "<b>1</b>task kept" in text
    assert "<b>1</b>object used" in text
    assert "In 1 episode only part of the motion was executed" in text
    assert "In 1 episode a step was planned again." in text


def test_a_run_that_python_started_has_no_command(run_dir: Path) -> None:
    assert '<pre class="command">' in write_report(run_dir).read_text()
    record = json.loads((run_dir / "run.json").read_text())
    (run_dir / "run.json").write_text(json.dumps({**record, "command_line": []}))
    assert '<pre class="command">' not in write_report(run_dir).read_text()


def test_the_columns_of_the_search_are_explained(run_dir: Path) -> None:
    text = write_report(run_dir).read_text()
    for column in ("plans", "physics, by stage", "holds, 95 %"):
        assert f"<th>{column}</th>" in text
        assert f"<b>{column}</b>: " in text
