"""Whole runs with a language model over real HTTP in a fake world: recorded, replayed, cut off, and out of budget."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("openai")

import fake_world
from llm_answers import BOX, DRAWER, LONG, WHOLE, GoodModel
from llm_server import KEY, SERVER_ERROR, Asked, ModelServer

from gensim2.core.processes import Execution
from gensim2.cli.main import run as command
from gensim2.data.records import PipelineResult
from gensim2.design import run_pipeline, views
from gensim2.design.designing import model_designer
from gensim2.design.llm import Asking
from gensim2.design.search import Budget
from gensim2.core.errors import InputError, ModelError
from gensim2.rollout import worker
from gensim2.rollout.runner import EpisodeRunner
from gensim2.rollout.record import Episode, StrictMiss
from gensim2.rollout.config import EpisodeConfig
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.strategies import Strategies, with_strategies

SMALL = Budget(screen_scenes=1, rounds=((4, 1),), refined=(4, 1), comparison=(1, 2), enough=0.1, enough_episodes=2)


PAGE = Path(__file__).parents[3] / "docs/guides/pipeline.md"

CLASSES = ("box_rotate", "drawer", "golf_ball")


def episode(config: EpisodeConfig, strategies: Strategies, seed: int) -> Episode:
    """Return a successful episode of the fake world on the first instances."""
    drawn = config.scene.instances
    word = dict(drawn)[next(iter(config.task.objects))] if isinstance(drawn, frozenset) else drawn
    found = fake_world.episode(replace(config, scene=replace(config.scene, instances=word)), strategies, seed)
    misses = [StrictMiss.NOT_LET_GO]
    return replace(found, held=True, paper=True, cause=None, still=False, strict=False, strict_misses=misses)


@pytest.fixture(autouse=True)
def world(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Use a world in which everything can be planned and succeeds, in this process."""
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.setenv("GENSIM2_LIBRARY", "none")
    monkeypatch.setattr("openai._base_client.INITIAL_RETRY_DELAY", 0.01)
    monkeypatch.setattr("gensim2.design.designing.cache_dir", lambda: tmp_path / "cache")
    monkeypatch.setattr(worker, "screen_scene", lambda config, seed, candidates: [(1.0, None, {}) for _ in candidates])

    monkeypatch.setattr(worker, "episode", episode)
    monkeypatch.setattr(
        worker,
        "trial",
        lambda config, ways, seed: episode(replace(config, scene=replace(config.scene, task=with_strategies(config.task, ways))), {}, seed),
    )
    monkeypatch.setattr("gensim2.design.briefing.has_instances", lambda library, name, words: name in CLASSES)

    def here(scene: SceneOptions, _: Execution, progress: Any, **given: Any) -> EpisodeRunner:
        return EpisodeRunner(scene, Execution(0), progress, **given)

    monkeypatch.setattr("gensim2.design.run.EpisodeRunner", here)


@pytest.fixture
def server() -> Iterator[ModelServer]:
    with ModelServer(GoodModel(BOX, DRAWER)) as found:
        yield found


def run(
    server: ModelServer, out: Path, asking: Asking | None = None, resume: bool = False, **given: Any
) -> PipelineResult:
    options = {"base_url": server.url, "retries": 1, "timeout": 5.0} if "replay" not in given else {}
    settings = {
        name: given.pop(name) for name in ("replay", "budget", "price_in", "price_out") if name in given
    }
    asked = model_designer("test-model", asking or Asking(trials=2), SceneOptions("builtin"), **options, **settings)
    fields = {"num_tasks": 2, "from_empty": True, "verify": 2, "episodes": 0, "videos": 0, "assets": "builtin"}
    return run_pipeline(designer=asked, out=out, resume=resume, budget=SMALL, **{**fields, **given})


def page(out: Path) -> str:
    """Return a report without dates and paths."""
    text = (out / "report.html").read_text()
    return re.sub(r"started [^ ]+|finished [^ <]+|<pre class=\"command\">.*?</pre>", "", text, flags=re.DOTALL)


def test_a_recorded_run_is_replayed_to_the_same_report_without_a_model(server: ModelServer, tmp_path: Path) -> None:
    first = run(server, tmp_path / "run", price_in=1.0, price_out=2.0)
    assert len(first.tasks) == 2
    asked = server.requests
    again = run(server, tmp_path / "again", replay=tmp_path / "run")
    assert server.requests == asked
    drop = ("run_dir", "cpu_s")
    assert _without(again.to_dict(), drop) == _without(first.to_dict(), drop)
    assert page(tmp_path / "again") == page(tmp_path / "run")
    text = page(tmp_path / "run")
    assert "Fling the box open." in text, "answers"
    assert "# Solver stage 1: constraints" in text, "prompts"
    assert re.search(r"\d+ answers · [\d,]+ tokens asked, [\d,]+ answered · 0\.\d{4} USD", text)
    assert KEY not in "".join(path.read_text() for path in tmp_path.rglob("*") if path.suffix in (".json", ".html"))
    with pytest.raises(InputError, match="holds no answer to this question"):
        run(server, tmp_path / "other", replay=tmp_path / "run", seed=1)


def test_a_run_goes_on_after_the_endpoint_was_away(server: ModelServer, tmp_path: Path) -> None:
    model = GoodModel(BOX, DRAWER)

    def goes_away_in_the_second_task(asked: Asked) -> str:
        if asked.stage == "constraints" and "ShoveDrawerShut" in asked.prompt:
            server.faults.extend([SERVER_ERROR] * 2)
        return model(asked)

    server.script = goes_away_in_the_second_task
    with pytest.raises(ModelError):
        run(server, tmp_path / "run")
    assert (tmp_path / "run" / "report.html").exists()
    assert (tmp_path / "run" / "tasks" / "FlingBoxOpen" / "verification.json").exists()
    before = len(server.asked)
    server.faults.clear()
    server.script = model
    result = run(server, tmp_path / "run", resume=True)
    assert [task.name for task in result.tasks] == ["FlingBoxOpen", "ShoveDrawerShut"]
    earlier, later = ({asked.last for asked in part} for part in (server.asked[:before], server.asked[before:]))
    assert server.asked[before].stage == "motions"
    assert not earlier & later, "nothing is asked twice"
    with pytest.raises(InputError, match=r"model\.json: asking: the recorded answers were requested with"):
        run(server, tmp_path / "run", Asking(trials=5), resume=True)


def test_the_budget_ends_a_run_and_what_is_done_stays(server: ModelServer, tmp_path: Path) -> None:
    result = run(server, tmp_path / "run", price_in=1.0, price_out=10.0, budget=0.05)
    assert len(result.tasks) + len(result.rejected) < 2 or result.notes
    assert any("of 0.05 USD are spent" in text for text in (*result.notes, *(r["reason"] for r in result.rejected)))
    assert (tmp_path / "run" / "report.html").exists()


def test_long_tasks_taken_apart_go_all_the_way(server: ModelServer, tmp_path: Path) -> None:
    server.script = GoodModel(LONG)
    result = run(server, tmp_path / "run", Asking("topdown", trials=2), num_tasks=1)
    (task,) = result.tasks
    assert task.name == "StowGolfBall"
    (folder,) = [*(tmp_path / "run").glob("*/StowGolfBall")]
    strategies = sorted(path.stem for path in (folder / "strategies").iterdir())
    assert {"designed_open", "designed_place", "designed_close", "grasp"} <= set(strategies)
    assert "decomposition" in server.stages()


def test_long_tasks_put_together_go_all_the_way(server: ModelServer, tmp_path: Path) -> None:
    result = run(server, tmp_path / "run", Asking("bottomup", trials=1), num_tasks=1, from_empty=False)
    (task,) = result.tasks
    assert task.name == "StowBallAway"
    assert server.stages()[:1] == ["composition"]


def test_pictures_go_along_and_a_run_is_replayed_where_nothing_can_be_drawn(
    server: ModelServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Real images take half a minute of CPU; see benchmarks/model_run.py."""

    def drawn(draw: Callable[..., bytes], *given: Any) -> bytes:
        return b"\x89PNG\r\n\x1a\n" + f"{draw.__name__} {given[1] if draw is views.draw_thing else given[2:]}".encode()

    monkeypatch.setattr(views, "_drawn", drawn)
    first = run(server, tmp_path / "run", Asking(trials=1, visual=True), num_tasks=1)
    assert not any(each.pictures for each in server.asked if each.stage == "proposal")
    # Tasks are designed in parallel, so select the requests about the box.
    asked = {each.stage: each.pictures for each in server.asked if b"box_rotate" in b"".join(each.pictures)}
    box, start = asked["constraints"]
    assert b"draw_thing box_rotate" in box
    assert b"draw_scene ({}, 'open')" in start
    assert asked["motions"][:2] == (box, start)
    assert b"articulated_object_head" in asked["motions"][2], "where stage 1 leads to"
    monkeypatch.setattr(views, "_drawn", lambda *_: pytest.fail("a replay draws nothing"))
    replayed = run(server, tmp_path / "again", num_tasks=1, replay=tmp_path / "run")
    assert [task.name for task in replayed.tasks] == [task.name for task in first.tasks]
    assert page(tmp_path / "again") == page(tmp_path / "run")


def test_a_model_that_cannot_write_configs_gets_its_tasks_rejected(server: ModelServer, tmp_path: Path) -> None:
    model = GoodModel(BOX, DRAWER)
    server.script = lambda asked: "no." if asked.stage == "motions" else model(asked)
    result = run(server, tmp_path / "run", Asking(trials=1, max_rounds=1))
    assert result.tasks == ()
    assert {each["name"] for each in result.rejected} == {"FlingBoxOpen", "ShoveDrawerShut"}
    assert all("the answer holds no JSON or YAML" in each["reason"] for each in result.rejected)
    assert "FlingBoxOpen" in (tmp_path / "run" / "report.html").read_text()


class AnyModel(GoodModel):
    """A model that proposes a long or a whole task if asked for one."""

    def free(self, asked: Asked) -> str:
        return json.dumps(WHOLE).replace('"class": "apple"', '"class": "golf_ball"')

    def proposal(self, asked: Asked) -> str:
        return json.dumps(LONG) if "one rigid object" in asked.prompt else super().proposal(asked)


def test_the_commands_and_the_program_of_the_page_run(
    server: ModelServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server.script = AnyModel(BOX, DRAWER)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OPENAI_BASE_URL", server.url)
    monkeypatch.setenv("GENSIM2_ASSETS", "builtin")
    text = PAGE.read_text()
    commands = [shlex.split(line, comments=True) for line in re.findall(r"^gensim2 (run-pipeline .*)", text, re.M)]
    assert len(commands) >= 6
    for number, words in enumerate(commands):
        given = [server.url if word.startswith("http://localhost") else word for word in words]
        out = given[given.index("--out") + 1] if "--out" in given else f"run{number}"
        code = command([*given, "--out", out, "--videos", "0", "--episodes", "1", "--verify", "2", "--from-empty"])
        assert code == 0, words
        assert json.loads((tmp_path / out / "run.json").read_text())["result"]["tasks"], words
    (program,) = re.findall(r"```python\n(.*?)```", text, re.S)
    # There is nothing to film in the fake world.
    exec(program.replace("num_tasks=2", "num_tasks=2, videos=0"), {})
    assert list((tmp_path / "runs").glob("*/tasks/StowGolfBall/verification.json"))


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("--visual",), "--visual: does not apply to the offline designer"),
        (("--mode", "topdown"), "needs a language model"),
        (("--designer", "m", "--budget", "1"), "requires price_in and price_out"),
        (("--replay", "nowhere"), "nowhere/model.json: cannot be read"),
        (("--designer", "m", "--prompts", "nowhere"), "nowhere: prompts: the path is not a folder"),
        (("--designer", "m", "--single", "2", "--long", "2"), "--long: the model proposes only tasks of one step"),
        (("--designer", "m", "--mode", "topdown", "--single", "2"), "--single: the model proposes only tasks of several steps"),
        (("--designer", "m", "--base-url", "file:///etc/passwd"), "no http or https address"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    words: tuple[str, ...], complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    assert command(["run-pipeline", "--assets", "builtin", "--out", "run", *words]) == 2
    assert complaint in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def _without(value: Any, names: tuple[str, ...]) -> Any:
    if isinstance(value, dict):
        return {name: _without(each, names) for name, each in value.items() if name not in names}
    return [_without(each, names) for each in value] if isinstance(value, list) else value
