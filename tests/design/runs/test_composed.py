"""A task of several steps from proposal to verification, in physics."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gensim2.design.drafting import chains
from gensim2.design.run import run_pipeline
from gensim2.design.search import Budget
from shelving import shelve
from gensim2.tasks.library import load_strategies_beside, load_task_file

pytest.importorskip("mani_skill")

SIMULATOR = True
BUDGET = Budget(screen_scenes=1, rounds=((1, 2),), comparison=(1, 2), enough=0.5, enough_strict=0.0, enough_episodes=2)


def test_a_composed_task_is_designed_verified_and_shelved(tmp_path: Path) -> None:
    out = tmp_path / "run"
    result = run_pipeline(
        single=0,
        long=1,
        verify=4,
        episodes=0,
        from_empty=True,
        seed=6,
        assets="builtin",
        out=out,
        workers=1,
        budget=BUDGET,
    )
    (outcome,) = [task for task in result.tasks if task.kept]
    assert outcome.verification.episodes == 4
    assert outcome.effort is not None
    assert outcome.effort.episodes >= 2
    assert shelve(out, tmp_path / "shelf").tasks == (outcome.name,)
    folder = tmp_path / "shelf" / outcome.name
    task = load_task_file(folder)
    assert len(task.steps) > 1
    assert chains(task) == []
    assert task.provenance is not None
    assert task.provenance.origin == "offline"
    assert task.provenance.verification is not None
    assert task.provenance.verification.held == outcome.verification.held
    assert load_strategies_beside(folder, task)
    design = json.loads((out / "tasks" / outcome.name / "design.json").read_text())
    assert list(design["steps"]) == [step.name for step in task.steps]
    assert "episodes (" in design["notes"][-1], "the interval is told"
