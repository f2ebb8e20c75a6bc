"""A long task that a model proposed, from the first question to its place in the library, in physics.

The model is a script (a fake, which answers with strategies of our library); the endpoint, the search, the episodes and
the verification are real.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("openai")

import yaml
from llm_answers import LONG, MOTION_FIELDS, GoodModel
from llm_server import KEY, Asked, ModelServer

from gensim2.designers.llm import Asking
from gensim2.pipeline import run_pipeline
from gensim2.pipeline.designing import model_designer
from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.search import Budget
from gensim2.pipeline.setting import Circumstances
from gensim2.tasks.library import load_task_file, shared_strategy

SIMULATOR = True

#: As little as shows every part of a search.
SMALL = Budget(
    screen_scenes=1,
    rounds=((2, 1),),
    refined=(1, 1),
    comparison=(1, 2),
    most_episodes=3,
    enough=0.6,
    enough_strict=0.0,
    enough_episodes=2,
)

#: What the script says of each step: once, and when it is told what went wrong.
FIRST = {"open": "open_drawer_from_the_front", "place": "place_deep_in_drawer", "close": "close_drawer_from_the_front"}
BETTER = {
    "open": ("open_drawer_from_inside", "open_drawer_over_the_front"),
    "place": ("place_in_drawer", "drop_into_drawer_from_above"),
    "close": ("close_drawer_from_the_side",),
}


class Learner(GoodModel):
    """Writes a poor way to open at first, and better ones when it is told of failures."""

    def constraints(self, asked: Asked) -> str:
        return yaml.safe_dump({"constraint_list": self._config(asked)["constraint_list"]})

    def motions(self, asked: Asked) -> str:
        config = self._config(asked)
        return yaml.safe_dump({"trials": [{name: config[name] for name in MOTION_FIELDS if name in config}]})

    def regeneration(self, asked: Asked) -> str:
        fields = ("constraint_list", *MOTION_FIELDS)
        found = [shared_strategy(name) for name in BETTER[_step(asked)]]
        return yaml.safe_dump({"configs": [{name: each[name] for name in fields if name in each} for each in found]})

    def _config(self, asked: Asked) -> dict[str, Any]:
        return shared_strategy(FIRST[_step(asked)])


def _step(asked: Asked) -> str:
    return next(name for name in FIRST if f"step `{name}`" in asked.prompt)


def test_a_long_task_goes_from_the_first_question_to_the_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("gensim2.pipeline.briefing.has_instances", lambda _, name, __: name in ("drawer", "golf_ball"))

    def here(circumstances: Circumstances, workers: int, progress: Any, **given: Any) -> PoolEvaluator:
        return PoolEvaluator(circumstances, 0, progress, **given)

    monkeypatch.setattr("gensim2.pipeline.run.PoolEvaluator", here)
    with ModelServer(Learner(LONG)) as server:
        designer = model_designer(
            "test-model", Asking("topdown", trials=1), Circumstances("builtin"), base_url=server.url, timeout=10.0
        )
        result = run_pipeline(
            designer=designer,
            num_tasks=1,
            from_empty=True,
            assets="builtin",
            verify=5,
            episodes=0,
            video=False,
            seed=1,
            budget=SMALL,
            out=tmp_path / "run",
        )
    (task,) = result.tasks
    assert task.kept
    assert task.verification.held >= 3
    stages = server.stages()
    assert stages[:3] == ["proposal", "reflection", "decomposition"]
    assert sorted(stages[3:9]) == ["constraints"] * 3 + ["motions"] * 3
    folder = tmp_path / "run" / "tasks" / "StowGolfBall"
    spec = load_task_file(folder)
    assert [step.name for step in spec.steps] == ["open", "grasp", "place", "close"]
    report = (tmp_path / "run" / "report.html").read_text()
    assert "StowGolfBall" in report
    if "regeneration" in stages:
        (told, *_) = (asked.prompt for asked in server.asked if asked.stage == "regeneration")
        assert "step `" in told
