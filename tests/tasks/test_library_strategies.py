"""Each stored task is done by its strategies: in physics, on generated objects, where a still arm does not do it."""

from __future__ import annotations

import pytest

from gensim2.episodes.record import Episode
from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.setting import Circumstances
from gensim2.tasks.library import load_strategies, load_task, task_names

pytest.importorskip("mani_skill")

#: Of each task; no search and no table uses them.
SEEDS = tuple(range(910_000, 910_005))
NEEDED = 4


@pytest.fixture(scope="module")
def episodes() -> dict[str, list[Episode]]:
    """All episodes of all tasks; two workers, which change nothing."""
    found: dict[str, list[Episode]] = {}
    with PoolEvaluator(Circumstances("builtin"), 2) as evaluator:
        for name in task_names():
            strategies = load_strategies(name)
            jobs = [(strategies, seed) for seed in SEEDS]
            found[name] = evaluator.episodes(evaluator.setting(load_task(name), "all"), jobs)
    return found


@pytest.mark.parametrize("name", task_names())
def test_the_stored_strategies_do_their_task(name: str, episodes: dict[str, list[Episode]]) -> None:
    assert [episode.seed for episode in episodes[name]] == list(SEEDS)
    failures = [(episode.seed, episode.cause) for episode in episodes[name] if not episode.held]
    assert len(failures) <= len(SEEDS) - NEEDED, failures
    for episode in episodes[name]:
        assert episode.still is not True or not episode.held
