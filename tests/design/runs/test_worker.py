"""Jobs of workers, in the simulator where necessary and with fake scenes otherwise."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import fake_world
import process_jobs
import pytest

from gensim2.core.errors import InputError, NotRunError
from gensim2.core.processes import Execution, Job
from gensim2.rollout import worker
from gensim2.rollout.runner import EpisodeRunner
from gensim2.rollout.config import EpisodeConfig, RolloutOptions
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.library import load_strategies, load_task
from gensim2.tasks.strategies import Strategies

SIMULATOR = True
TASK = load_task("PushDrawerClose")
CONFIG = EpisodeConfig(SceneOptions("builtin").with_task(TASK, "all"))
STRATEGIES = load_strategies("PushDrawerClose")
WAYS = {step.name: {name: STRATEGIES[name] for name in step.strategies} for step in TASK.steps}


def changed(old: str, new: str) -> Strategies:
    """Return the strategies with one word replaced."""
    found: Strategies = json.loads(json.dumps(STRATEGIES).replace(old, new))
    assert found != STRATEGIES
    return found


def test_an_episode_is_a_pure_function_recorded_or_not() -> None:
    first = worker.episode(CONFIG, STRATEGIES, 5)
    other, _ = worker.demonstrate(CONFIG, STRATEGIES, 6)
    again, recording = worker.demonstrate(CONFIG, STRATEGIES, 5)
    assert first == again
    assert first != other
    assert first.held
    assert first.still is False
    assert recording is not None
    assert recording.steps == first.control_steps


def test_an_open_loop_episode_makes_one_plan_a_step() -> None:
    episode = worker.episode(replace(CONFIG, rollout=RolloutOptions(open_loop=True)), STRATEGIES, 5)
    assert [len(step.plans) for step in episode.steps] == [1]


def test_configs_of_equal_specs_share_a_simulator() -> None:
    again = EpisodeConfig(SceneOptions("builtin").with_task(TASK.model_validate_json(TASK.model_dump_json())))
    assert again == CONFIG
    assert worker.simulator(again.scene) is worker.simulator(CONFIG.scene)
    assert worker.simulator(replace(CONFIG.scene, instances="train")) is not worker.simulator(CONFIG.scene)


def test_screening_counts_a_candidate_that_cannot_be_planned_as_a_drop() -> None:
    name, *_ = STRATEGIES
    unknown = {**STRATEGIES, name: {**STRATEGIES[name], "nonsense": 1}}
    lost = changed("articulated_object_head", "no_such_keypoint")
    (step,) = TASK.steps
    ways = [{step.name: given} for given in (STRATEGIES, lost, unknown, {name: {}})]
    good, misfit, *bad = worker.screen_scene(CONFIG, 5, [*ways, {}])
    assert good == (1.0, None, {})
    assert misfit[:2] == (0.0, "invalid")
    assert misfit[2]["step"] == step.name
    assert all(score == 0.0 and str(cause).startswith("planner error: ") for score, cause, _ in bad)


def test_a_panic_of_the_solver_is_a_drop_and_lack_of_memory_is_not() -> None:
    panic = type("PanicException", (BaseException,), {"__module__": "pyo3_runtime"})
    planner, scene = SimpleNamespace(), SimpleNamespace()
    for error in (panic("index out of bounds"), ValueError("odd")):
        planner.plan = _raising(error)
        screened = worker._screen(planner, TASK, scene, WAYS)  # type: ignore[arg-type]
        assert screened == (0.0, f"planner error: {type(error).__name__}: {error}", {})
    for error in (MemoryError(), KeyboardInterrupt()):
        planner.plan = _raising(error)
        with pytest.raises(type(error)):
            worker._screen(planner, TASK, scene, WAYS)  # type: ignore[arg-type]


def _raising(error: BaseException) -> Any:
    def call(*_: object, **__: object) -> None:
        raise error

    return call


@pytest.mark.parametrize(
    ("reached", "score"), [(("actuation",), 0.75), ((), 0.5)], ids=["past the actuation pose", "not that far"]
)
def test_a_candidate_of_two_steps_is_scored_by_the_steps_that_can_be_planned(
    reached: tuple[str, ...], score: float
) -> None:
    first = TASK.steps[0]
    task = TASK.model_copy(update={"steps": (first, first.model_copy(update={"name": "again"}))})
    scenes: list[str] = []

    def plan(scene: Any, step: Any, strategy: object, following: object) -> Any:
        scenes.append(scene)
        if step.name == first.name:
            return SimpleNamespace(is_solved=True, status="solved", rank=0, after="the scene after it")
        motion = SimpleNamespace(trajectory=1, keyframes=[{"label": label, "reached": True} for label in reached])
        return SimpleNamespace(is_solved=False, status="collision", rank=3, after=None, plan=motion, detail=dict)

    planner: Any = SimpleNamespace(plan=plan)
    ways = {step.name: STRATEGIES for step in task.steps}
    found = worker._screen(planner, task, "the scene", ways)  # type: ignore[arg-type]
    assert found[:2] == (score, "collision")
    assert found[2]["step"] == "again"
    assert scenes == ["the scene", *["the scene after it"] * len(STRATEGIES)]


def test_strategies_that_do_not_fit_an_object_are_an_episode_with_that_cause() -> None:
    episode = worker.episode(CONFIG, changed("articulated_object_head", "no_such_keypoint"), 5)
    assert not episode.held
    assert episode.cause == "invalid problem"
    assert "no_such_keypoint" in json.dumps(episode.to_dict())


def test_strategies_that_nobody_takes_are_bad_input() -> None:
    with pytest.raises(InputError, match=r"strategies/\w+\.yaml: .*nonsense"):
        worker.episode(CONFIG, changed('"gripper"', '"nonsense"'), 5)


class _Made(EpisodeRunner):
    """An executor that runs jobs in this process."""

    def __init__(self) -> None:
        super().__init__(SceneOptions("builtin"), Execution(0))


def test_an_evaluator_gives_episodes_and_scores_in_the_order_of_its_jobs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        worker, "screen_scene", lambda config, seed, candidates: [(c["n"]["n"] * seed, None, {}) for c in candidates]
    )
    monkeypatch.setattr(
        worker, "trial", lambda config, ways, seed: fake_world.episode_of(config.task, seed, held=True)
    )
    with _Made() as evaluator:
        config = evaluator.config(TASK, "all")
        assert config == CONFIG
        assert evaluator.screen(config, [{"n": {"n": 1}}, {"n": {"n": 2}}], [3, 4, 5]) == [
            [(3, None, {}), (4, None, {}), (5, None, {})],
            [(6, None, {}), (8, None, {}), (10, None, {})],
        ]
        assert [e.seed for e in evaluator.trials(config, [({}, 9), ({}, 2), ({}, 5)])] == [9, 2, 5]


def test_an_evaluator_names_what_could_not_be_run() -> None:
    from gensim2.core.processes import Failure, Outcome

    class Lossy:
        """An executor that loses the second job."""

        def map_unordered(self, function: Any, jobs: Any) -> Iterator[Outcome[Any]]:
            for job in jobs:
                lost = (Failure(job.index, 3, "the worker process died (SIGKILL)"),)
                yield Outcome(job.index, failures=lost) if job.index == 1 else Outcome(job.index, [(1.0, None, {})])

        def close(self) -> None: ...

    with _Made() as evaluator:
        evaluator._executor = Lossy()
        what = r"PushDrawerClose: planning of candidates: could not be run: 1 \(.*SIGKILL"
        with pytest.raises(NotRunError, match=what):
            evaluator.screen(CONFIG, [{}], [3, 4, 5])


@pytest.mark.parametrize("workers", [0, 2])
def test_cpu_is_that_of_all_processes(workers: int) -> None:
    with EpisodeRunner(SceneOptions("builtin"), Execution(workers)) as evaluator:
        list(evaluator.run(process_jobs.spin, [Job(index, (0.25,)) for index in range(4)], "work"))
        assert 1.0 <= evaluator.cpu_s < 2.0
