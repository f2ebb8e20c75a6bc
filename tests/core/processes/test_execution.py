"""``Execution`` is checked when it is created; ``Execution.of`` ignores other keywords."""

from __future__ import annotations

from typing import Any

import pytest

from gensim2.core.errors import InputError
from gensim2.core.processes import Execution, WorkerPool

pytestmark = pytest.mark.fast


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"workers": -1}, "workers: must be at least 0"),
        ({"workers": None}, "workers: must be a number"),
        ({"time_limit": 0.0}, "time_limit: must lie in"),
        ({"time_limit": float("nan")}, "time_limit: must lie in"),
        ({"time_limit": float("inf")}, "time_limit: must lie in"),
        ({"jobs_per_worker": 0}, "jobs_per_worker: must be at least 1"),
        ({"ray": "nowhere"}, "--ray: 'nowhere' is not a Ray address"),
    ],
)
def test_values_that_mean_nothing_are_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Execution(**given)


def test_keywords_of_other_things_are_left_alone() -> None:
    assert Execution.of({"workers": 3, "assets": "builtin"}) == Execution(3)
    assert Execution.of({}) == Execution()


def test_no_more_processes_than_jobs() -> None:
    assert Execution(4).at_most(2) == Execution(2)
    assert Execution(1).at_most(2) == Execution(1)
    with Execution(0).executor() as executor:
        assert isinstance(executor, WorkerPool)
