"""Each stored task is done by its stored config: in physics, on generated objects, where a still arm does not do it."""

from __future__ import annotations

from collections import defaultdict

import pytest

from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.records import Attempt
from gensim2.tasks.library import load_config, load_task, task_names

pytest.importorskip("mani_skill")

#: Of each task; no search and no table uses them.
SEEDS = tuple(range(910_000, 910_005))
NEEDED = 4


@pytest.fixture(scope="module")
def attempts() -> dict[str, list[Attempt]]:
    """All episodes of all tasks; two workers, which change nothing."""
    found: dict[str, list[Attempt]] = defaultdict(list)
    with PoolEvaluator("builtin", 2) as evaluator:
        for name in task_names():
            found[name] = evaluator.attempt(load_task(name), [(load_config(name), seed) for seed in SEEDS])
    return found


@pytest.mark.parametrize("name", task_names())
def test_the_stored_config_does_its_task(name: str, attempts: dict[str, list[Attempt]]) -> None:
    assert [attempt.seed for attempt in attempts[name]] == list(SEEDS)
    failures = [(attempt.seed, attempt.instance, attempt.cause) for attempt in attempts[name] if not attempt.success]
    assert len(failures) <= len(SEEDS) - NEEDED, failures
    for attempt in attempts[name]:
        assert attempt.still_success is not True or not attempt.success
