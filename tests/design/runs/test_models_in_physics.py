"""A long task that a model proposes, from the first request until it is kept, in physics.

The model is a script that answers with strategies of the library. The endpoint, the search, the episodes and the
verification are real.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("openai")

from llm_answers import LONG, Learner
from llm_server import KEY, ModelServer

from gensim2.core.processes import Execution
from gensim2.design import run_pipeline
from gensim2.design.designing import model_designer
from gensim2.design.llm import Asking
from gensim2.design.search import Budget
from gensim2.rollout.runner import EpisodeRunner
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.library import load_task_file

SIMULATOR = True

#: The smallest search with all its parts.
SMALL = Budget(
    screen_scenes=1,
    rounds=((1, 4),),
    refined=(1, 4),
    comparison=(1, 1),
    max_episodes=5,
    enough=0.75,
    enough_strict=0.0,
    enough_episodes=4,
)


def test_a_long_task_goes_from_the_first_question_until_it_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("gensim2.design.briefing.has_instances", lambda _, name, __: name in ("drawer", "golf_ball"))

    def here(scene: SceneOptions, _: Execution, progress: Any, **given: Any) -> EpisodeRunner:
        return EpisodeRunner(scene, Execution(0), progress, **given)

    monkeypatch.setattr("gensim2.design.run.EpisodeRunner", here)
    with ModelServer(Learner(LONG)) as server:
        designer = model_designer(
            "test-model", Asking("topdown", trials=1), SceneOptions("builtin"), base_url=server.url, timeout=10.0
        )
        result = run_pipeline(
            designer=designer,
            num_tasks=1,
            from_empty=True,
            assets="builtin",
            verify=5,
            episodes=0,
            videos=0,
            seed=2,
            budget=SMALL,
            out=tmp_path / "run",
        )
    (task,) = result.tasks
    assert task.kept
    assert task.verification.held >= 3
    stages = server.stages()
    assert stages[:3] == ["proposal", "reflection", "decomposition"]
    assert sorted(stages[3:9]) == ["constraints"] * 3 + ["motions"] * 3
    told = [asked.prompt for asked in server.asked if asked.stage == "regeneration"]
    assert "step `place`" in told[0]
    assert "collision on the way; the keyframe pre_0 is not reached; panda_" in told[0], "what was hit, from physics"
    folder = tmp_path / "run" / "tasks" / "StowGolfBall"
    spec = load_task_file(folder)
    assert [step.name for step in spec.steps] == ["open", "grasp", "place", "close"]
    assert spec.steps[2].strategies[1:], "what was written first stays as the second choice"
    assert "StowGolfBall" in (tmp_path / "run" / "report.html").read_text()
