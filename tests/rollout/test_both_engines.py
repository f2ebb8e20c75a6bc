"""Demonstrations with ``engines="both"``: an episode counts only if it holds in both physics engines."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gensim2.core.errors import InputError
from gensim2.data.collection import collect
from gensim2.data.dataset import DataSet
from gensim2.design.run import run_pipeline
from gensim2.design.single import demo
from gensim2.perception import ObservationSpec
from gensim2.policy.keypose import examples
from gensim2.policy.learning import learn
from gensim2.rollout import worker
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.inputs import read_task_input
from gensim2.rollout.record import Cause, Episode, StrictMiss, in_all_engines
from gensim2.rollout.tally import Tally
from gensim2.tasks.strategies import Strategies

MUJOCO: dict[str, Any] = {"assets": "builtin", "engine": "mujoco", "workers": 0}


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Let MuJoCo stand for SAPIEN too, with every second episode failed there; return the seeds of these episodes."""
    plain, failed = worker.episode, list[int]()
    ran: list[int] = []

    def judged(config: EpisodeConfig, strategies: Strategies, seed: int) -> Episode:
        if config.scene.engine == "mujoco":
            return plain(config, strategies, seed)
        found = plain(replace(config, scene=replace(config.scene, engine="mujoco")), strategies, seed)
        ran.append(seed)
        if len(ran) % 2:
            return found
        failed.append(seed)
        miss = [StrictMiss.NOT_HELD]
        return replace(found, held=False, strict=False, strict_misses=miss, cause=Cause.GRASP_LOST)

    monkeypatch.setattr(worker, "episode", judged)
    return failed


@pytest.fixture(scope="module")
def held() -> Episode:
    given = read_task_input("CloseBox", seed=0, **MUJOCO)
    return worker.episode(EpisodeConfig(given.scene, given.rollout), given.strategies, 3)


def test_an_episode_passes_the_verdicts_of_both_engines(held: Episode) -> None:
    assert held.held
    assert held.strict
    lost = replace(held, held=False, strict=False, cause=Cause.GRASP_LOST, strict_misses=[StrictMiss.NOT_HELD])
    loose = replace(held, strict=False, strict_misses=[StrictMiss.NOT_LET_GO])
    for found, verdicts, cause, misses in (
        ({"sapien": held, "mujoco": held}, (True, True), None, []),
        ({"sapien": held, "mujoco": loose}, (True, False), None, [StrictMiss.NOT_LET_GO]),
        ({"sapien": held, "mujoco": lost}, (False, False), Cause.GRASP_LOST, [StrictMiss.NOT_HELD]),
        ({"sapien": lost, "mujoco": loose}, (False, False), Cause.GRASP_LOST, [StrictMiss.NOT_HELD]),
    ):
        both = in_all_engines(found)  # type: ignore[arg-type]
        assert ((both.held, both.strict), both.cause, both.strict_misses) == (verdicts, cause, misses)
        assert [(each.engine, each.held) for each in both.engines] == [(name, one.held) for name, one in found.items()]
        tally = Tally.of([both])
        assert tally.engines == {name: int(one.held) for name, one in found.items()}
        assert tally.disagreed == ((held.seed,) if len({one.held for one in found.values()}) > 1 else ())
    assert Tally.of([held]).engines == {}


def test_a_data_set_has_the_demonstrations_that_hold_in_both_engines(tmp_path: Path, failing: list[int]) -> None:
    out = tmp_path / "set"
    result = collect(["CloseBox"], episodes=4, seed=3, out=out, engines="both", **MUJOCO).to_dict()
    assert len(failing) == 2
    (task,) = result["tasks"]
    assert (task["tried"], task["held"], task["causes"]) == (4, 2, {str(Cause.GRASP_LOST): 2})
    assert (task["engines"], task["disagreed"]) == ({"mujoco": 4, "sapien": 2}, sorted(failing))
    dataset = DataSet.open(out)
    assert dataset.record.rollout.engines == "both"
    assert {"sapien", "mujoco-core"} <= dataset.record.versions.keys()
    rows = list(dataset.task("CloseBox").rows())
    assert [row.seed for row in rows if not row.held] == failing
    assert all([each.engine for each in row.engines] == ["mujoco", "sapien"] for row in rows)
    assert [dataset.task("CloseBox").read(row).recording is None for row in rows] == [not row.held for row in rows]
    page = (out / "report.html").read_text()
    assert "held in sapien" in page
    assert all(str(seed) in page for seed in failing)
    with pytest.raises(InputError, match=r"arguments\.engines"):
        collect(["CloseBox"], episodes=4, seed=3, out=out, resume=True, **MUJOCO)
    again = collect(["CloseBox"], episodes=4, seed=3, out=out, resume=True, engines="both", **MUJOCO).to_dict()
    assert (again["tasks"], again["episodes_run"]) == (result["tasks"], 0)


def test_demonstrations_are_collected_until_enough_hold_in_both(tmp_path: Path, failing: list[int]) -> None:
    result = demo("CloseBox", episodes=2, seed=3, out=tmp_path, videos=0, engines="both", **MUJOCO).to_dict()
    assert (result["demos"], result["episodes_run"], result["held"]) == (2, 3, 2)
    assert (result["engines"], result["disagreed"]) == ({"mujoco": 3, "sapien": 2}, failing)
    page = " ".join((tmp_path / "report.html").read_text().split())
    assert f"3 hold in mujoco, 2 hold in sapien, 2 in both engines. Only one engine holds seed {failing[0]}." in page
    with pytest.raises(InputError, match=r"arguments\.engines"):
        demo("CloseBox", episodes=2, seed=3, out=tmp_path, videos=0, resume=True, **MUJOCO)


def test_a_run_demonstrates_its_tasks_in_both_engines(tmp_path: Path, failing: list[int]) -> None:
    given: dict[str, Any] = {"single": 0, "long": 0, "stored_tasks": ("CloseBox",), "videos": 0, **MUJOCO}
    result = run_pipeline(verify=1, episodes=1, seed=3, out=tmp_path, engines="both", **given)
    (task,) = result.to_dict()["tasks"]
    assert task["kept"]
    verified = 1
    assert task["demos"] == 1
    assert task["engines"] == {"mujoco": 2, "sapien": 1}  # the second episode in SAPIEN fails, the third holds
    assert task["disagreed"] == failing
    assert task["episodes_run"] == verified + 2
    assert any("of 2 episodes for demonstrations 2 in mujoco, 1 in sapien hold, 1 in both" in n for n in result.notes)
    assert json.loads((tmp_path / "run.json").read_text())["arguments"]["engines"] == "both"


def test_plans_for_training_must_hold_in_both_engines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given = read_task_input("CloseBox", seed=0, **MUJOCO)
    asked: list[str] = []

    def refuted(scene: Any, taken: Any, seed: int) -> str | None:
        asked.append(scene.engine)
        return None if scene.engine == "mujoco" else "grasp lost"

    monkeypatch.setattr(examples, "refuted", refuted)
    spec = ObservationSpec()
    drawn = examples.draw(given.scene, given.strategies, spec, 3, verify=True, engines="both")
    assert (asked, drawn.examples, drawn.failed) == (["mujoco", "sapien"], (), "refuted: grasp lost")
    assert examples.draw(given.scene, given.strategies, spec, 3, verify=True).examples
    with pytest.raises(InputError, match="engines: applies to simulated demonstrations"):
        learn("CloseBox", engines="both", out=tmp_path, assets="builtin", engine="mujoco")
