"""What a worker does: in the simulator where that is the point, on made-up scenes where it is not."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gensim2.demos import rollout
from gensim2.demos.rollout import EpisodeResult, StillResult, is_stable
from gensim2.errors import NotRunError
from gensim2.pipeline import worker
from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.records import Attempt, Verification
from gensim2.tasks.library import load_config, load_task

SIMULATOR = True
SETTING = worker.Setting(load_task("PushDrawerClose").model_dump_json(), "builtin")
CONFIG = load_config("PushDrawerClose")


def test_an_episode_is_a_pure_function_recorded_or_not() -> None:
    first = worker.attempt(SETTING, CONFIG, 5)
    other, _ = worker.demonstrate(SETTING, CONFIG, 6)
    again, recording = worker.demonstrate(SETTING, CONFIG, 5)
    assert first == again
    assert first != other
    assert first.success
    assert first.still_success is False
    assert recording is not None
    assert recording.steps == first.steps
    assert recording.openness[-1] == pytest.approx(first.openness_end)


def test_screening_counts_a_candidate_that_cannot_be_planned_as_a_drop() -> None:
    unknown = CONFIG | {"nonsense": 1}
    lost = json.loads(json.dumps(CONFIG).replace("articulated_object_head", "no_such_keypoint"))
    assert lost != CONFIG
    good, *bad = worker.screen_scene(SETTING, 5, [CONFIG, unknown, lost, {}])
    assert good == (1.0, None)
    assert all(score == 0.0 and str(cause).startswith("planner error: ") for score, cause in bad)


def test_a_panic_of_the_solver_is_a_drop_and_lack_of_memory_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    panic = type("PanicException", (BaseException,), {"__module__": "pyo3_runtime"})
    problems: Any = SimpleNamespace()
    for error in (panic("index out of bounds"), ValueError("odd")):
        problems.problem = _raising(error)
        score, cause = worker._screen(problems, CONFIG)
        assert (score, cause) == (0.0, f"planner error: {type(error).__name__}: {error}")
    for error in (MemoryError(), KeyboardInterrupt()):
        problems.problem = _raising(error)
        with pytest.raises(type(error)):
            worker._screen(problems, CONFIG)


def _raising(error: BaseException) -> Any:
    def call(*_: object) -> None:
        raise error

    return call


def test_a_config_that_does_not_fit_an_object_is_a_failed_attempt() -> None:
    lost = json.loads(json.dumps(CONFIG).replace("articulated_object_head", "no_such_keypoint"))
    attempt = worker.attempt(SETTING, lost, 5)
    assert not attempt.success
    assert attempt.cause == "no plan: invalid problem"
    assert "no_such_keypoint" in attempt.plan_reason


@pytest.mark.parametrize("end", [math.nan, math.inf, 40.0])
def test_physics_that_blew_up_has_a_cause_of_its_own_and_is_written(
    monkeypatch: pytest.MonkeyPatch, end: float
) -> None:
    """The lane, the plan and the episode are made up; what is judged is the record of it."""
    instance = SimpleNamespace(id="0", content_hash="ab12")
    lane = SimpleNamespace(reset=lambda seed: None, openness=0.5, instance=instance, task=load_task("OpenDrawer"))
    plan = SimpleNamespace(status="solved", reason="")
    monkeypatch.setattr(worker, "simulator", lambda setting: lane)
    monkeypatch.setattr(worker, "plan_episode", lambda lane, config: (plan, np.zeros((3, 8), np.float32)))
    result = EpisodeResult(5, "0", False, True, False, False, False, 0.5, end, 9)
    monkeypatch.setattr(rollout, "run_episode", lambda lane, actions, record: result)
    attempt = worker.attempt(SETTING, CONFIG, 5)
    assert attempt.cause == worker.UNSTABLE
    assert attempt.openness_end == (end if math.isfinite(end) else None)
    document = json.dumps(Verification((attempt,), 0.7).to_dict(), allow_nan=False)
    assert json.loads(document)["causes"] == {"physics became unstable": 1}


def test_a_still_arm_under_which_physics_blows_up_makes_no_success(monkeypatch: pytest.MonkeyPatch) -> None:
    instance = SimpleNamespace(id="0", content_hash="ab12")
    lane = SimpleNamespace(reset=lambda seed: None, openness=0.5, instance=instance, task=load_task("OpenDrawer"))
    good = EpisodeResult(5, "0", True, True, True, True, False, 0.5, 0.9, 9)
    monkeypatch.setattr(worker, "simulator", lambda setting: lane)
    plan = SimpleNamespace(status="solved", reason="")
    monkeypatch.setattr(worker, "plan_episode", lambda lane, config: (plan, np.zeros((3, 8), np.float32)))
    monkeypatch.setattr(rollout, "run_episode", lambda lane, actions, record: good)
    still = StillResult(success=False, stable=False, openness_start=0.5, openness_end=0.5)
    monkeypatch.setattr(worker, "still_episode", lambda setting, seed: still)
    assert worker.attempt(SETTING, CONFIG, 5).cause == worker.UNSTABLE


@pytest.mark.parametrize(
    ("openness", "finite", "stable"),
    [(0.5, True, True), (1.01, True, True), (math.nan, True, False), (9.0, True, False), (0.5, False, False)],
)
def test_what_counts_as_stable(openness: float, finite: bool, stable: bool) -> None:
    lane: Any = SimpleNamespace(openness=openness, is_finite=finite)
    assert is_stable(lane) is stable


class _Made(PoolEvaluator):
    """Jobs in this process."""

    def __init__(self) -> None:
        super().__init__("builtin", 0)


def test_an_evaluator_gives_attempts_and_scores_in_the_order_of_its_jobs(monkeypatch: pytest.MonkeyPatch) -> None:
    task = load_task("OpenDrawer")
    monkeypatch.setattr(worker, "screen_scene", lambda setting, seed, configs: [(c["n"] * seed, None) for c in configs])
    monkeypatch.setattr(
        worker, "attempt", lambda setting, config, seed: Attempt(seed, "0", "", True, False, 0, 1, 9, None, "", "")
    )
    with _Made() as evaluator:
        assert evaluator.screen(task, [{"n": 1}, {"n": 2}], [3, 4, 5]) == [
            [(3, None), (4, None), (5, None)],
            [(6, None), (8, None), (10, None)],
        ]
        assert [a.seed for a in evaluator.attempt(task, [({}, 9), ({}, 2), ({}, 5)])] == [9, 2, 5]


def test_an_evaluator_names_what_could_not_be_run(monkeypatch: pytest.MonkeyPatch) -> None:
    from gensim2.processes import Failure, Outcome

    class Lossy:
        """An executor that loses the second job for good."""

        def map_unordered(self, function: Any, jobs: Any) -> Iterator[Outcome[Any]]:
            for job in jobs:
                lost = (Failure(job.index, 3, "the worker process died (SIGKILL)"),)
                yield Outcome(job.index, failures=lost) if job.index == 1 else Outcome(job.index, [(1.0, None)])

        def close(self) -> None: ...

    with _Made() as evaluator:
        evaluator._executor = Lossy()
        with pytest.raises(NotRunError, match=r"OpenDrawer: planning of candidates: could not be run: 1 \(.*SIGKILL"):
            evaluator.screen(load_task("OpenDrawer"), [{}], [3, 4, 5])
