"""``gensim2 benchmark``: run the planner on library tasks by the paper's protocol (several runs of random episodes)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Unpack

from gensim2.core.errors import InputError
from gensim2.core.processes import Execution
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.record_files import SCHEMA_VERSION
from gensim2.evaluation.benchmark_table import compared
from gensim2.evaluation.running import Arguments, Table, TableExtent, tabulate
from gensim2.rollout.config import DISTURBANCES, Disturbance, EpisodeConfig, RunArguments
from gensim2.rollout.controller_spec import ControllerError
from gensim2.rollout.inputs import TaskInput, check_counts, check_scene_source, read_task_inputs
from gensim2.scenes.config import SceneOptions, split_arguments
from gensim2.scenes.physics import Engine
from gensim2.tasks.spec import Step

NOTHING_TO_DISTURB = "grasps no rigid object, so that nothing can be pushed or dropped"


@dataclass(frozen=True, kw_only=True)
class BenchmarkResult(Table):
    """Result of a benchmark.

    Attributes:
        provenance: commit of gensim2, date, and command.
    """

    provenance: dict[str, str] = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        return {**super().to_dict(), "provenance": self.provenance}


def benchmark(
    tasks: Sequence[str] = (),
    *,
    origin: str | None = None,
    runs: int = 5,
    episodes: int = 50,
    seed: int = 0,
    attempts: int = 1,
    one_plan: bool = False,
    disturbance: Disturbance | None = None,
    out: Path | None = None,
    resume: bool = False,
    progress: Progress = NULL_PROGRESS,
    **scene: Unpack[RunArguments],
) -> BenchmarkResult:
    """Run the planner in random scenes of every task; each episode is stored as soon as it is finished.

    Example:
        ```python
        result = gensim2.benchmark(["OpenDrawer"], runs=1, episodes=10, assets="builtin", out=Path("runs/drawer"))
        result.rows[0].rates("held")  # success rate of each run
        ```

    Args:
        tasks: names of library tasks, or folders with task.yaml and strategies/; empty for all tasks of ``origin``. A
            task whose object classes are not available is skipped and listed in the result.
        origin: origin of the tasks if ``tasks`` is empty; None: the tasks of the GenSim2 paper.
        runs: number of runs. The standard deviation is computed from them.
        episodes: number of episodes of each task in each run.
        seed: seed of the scenes. No search for strategies uses these scenes.
        attempts: maximum number of attempts from the same start. The episode ends after the first success.
        one_plan: use the method of the paper: each step is planned once, before it is executed, with its first
            strategy.
        disturbance: ``"push"`` or ``"drop"``, once in each episode at a seeded moment. Tasks without a grasp are
            skipped.
        out: run folder; default ``runs/<date>-<time>``.
        resume: continue the run in ``out``.
        scene: options of scenes, strategies and worker processes: see :class:`~gensim2.rollout.config.RunArguments`.

    Returns:
        A table with one row per task: the success rate by each of the three verdicts with its 95 % interval.

    Raises:
        InputError: an argument is invalid.
        NotRunError: some episodes could not be run; all others are finished, and ``resume`` continues.
    """
    check_counts(runs=runs, episodes=episodes, attempts=attempts)
    execution = Execution.of(scene)
    if disturbance is not None and disturbance not in DISTURBANCES:
        wrong = f"unknown disturbance {disturbance!r}"
        raise InputError(wrong, field="disturbance", remedy=f"one of {', '.join(DISTURBANCES)}")
    if one_plan and scene.get("open_loop", False):
        wrong = "this option cannot be combined with one_plan"
        raise InputError(wrong, field="open_loop", remedy="leave one of them out")
    given, skipped = read_task_inputs(tasks, seed=seed, origin=origin, **scene)
    # Import late, because these modules take long to import.
    from gensim2.data.runfolder import RUN_JSON
    from gensim2.rollout import worker
    from gensim2.rollout.identity import identity, provenance

    if disturbance is not None:
        given, without = _disturbable(given, resume and out is not None and (Path(out) / RUN_JSON).exists())
        skipped |= dict.fromkeys(without, NOTHING_TO_DISTURB)
    given, estimators, unseen = _perceivable(given)
    skipped |= unseen
    rollout = replace(given[0].rollout, one_plan=one_plan, disturbance=disturbance, attempts=attempts)

    def arguments(one: TaskInput, config: EpisodeConfig, _: Path) -> Arguments:
        return lambda _, seed: (config, one.strategies, seed)

    return tabulate(
        given,
        {**given[0].scene.options.to_record(), **rollout.to_record(), "instances": scene.get("instances", "all")},
        {**identity(given), **estimators},
        worker.episode,
        arguments,
        lambda table: BenchmarkResult(**vars(table), provenance=provenance()),
        command="benchmark",
        extent=TableExtent(runs, episodes, seed),
        rollout=rollout,
        skipped=skipped,
        execution=execution,
        out=out,
        resume=resume,
        progress=progress,
    )


@dataclass(frozen=True)
class BothEngines:
    """Benchmarks of the same scenes in both physics engines.

    Attributes:
        results: result of each engine. The engine that the arguments name comes first.
    """

    results: Mapping[Engine, BenchmarkResult]

    def to_dict(self) -> dict[str, Any]:
        one, other = self.results.values()
        return {
            "schema_version": SCHEMA_VERSION,
            "engines": {engine: result.to_dict() for engine, result in self.results.items()},
            "compared": compared(one.rows, other.rows),
        }


def benchmark_both(
    tasks: Sequence[str] = (), *, out: Path | None = None, resume: bool = False, **given: Any
) -> BothEngines:
    """Run :func:`benchmark` in one engine and then in the other.

    Example:
        ```python
        both = benchmark_both(["CloseBox"], runs=1, episodes=20, assets="builtin")
        ```

    Args:
        tasks, given: as for :func:`benchmark`.
        out: folder of both runs, ``out/sapien`` and ``out/mujoco``; default ``runs/<date>-<time>``.
        resume: continue the runs in ``out``.

    Raises:
        InputError: an argument is invalid, or an engine cannot simulate the physics.
        MissingExtraError: an engine is not installed.
        NotRunError: some episodes could not be run; all others are finished, and ``resume`` continues.
    """
    from gensim2.data.runfolder import RUN_JSON, default_run_dir

    options = SceneOptions.of(**split_arguments(given)[0])
    second = options.second_engine("both")
    assert second is not None
    folder = Path(out) if out is not None else default_run_dir()
    engines, results = (options.engine, second), dict[Engine, BenchmarkResult]()
    for engine in engines:
        place = folder / engine
        goes_on = resume and (engine == options.engine or (place / RUN_JSON).exists())
        results[engine] = benchmark(tasks, **{**given, "engine": engine}, out=place, resume=goes_on)
    return BothEngines(results)


def _disturbable(given: Sequence[TaskInput], is_begun: bool) -> tuple[list[TaskInput], list[str]]:
    """Return the tasks that grasp a rigid object, and the names of all other tasks.

    An existing run without a task that grasps was started without a disturbance. Return all its tasks in this case. The
    comparison with its record then reports the changed argument.

    Raises:
        InputError: no task of a new run grasps a rigid object.
    """
    found = [one for one in given if any(_is_rigid(one, step) for step in one.spec.steps)]
    if not found and is_begun:
        return list(given), []
    if not found:
        raise InputError(NOTHING_TO_DISTURB, field="disturbance", remedy="name tasks with a rigid object")
    return found, [one.spec.name for one in given if one not in found]


def _perceivable(given: Sequence[TaskInput]) -> tuple[list[TaskInput], dict[str, str], dict[str, str]]:
    """Select the tasks whose scene the planner can get from the simulator or from an estimator.

    Returns:
        The selected tasks, the digests of their estimators (for resuming), and the reason for each other task.

    Raises:
        InputError: no task remains.
    """
    kept: list[TaskInput] = []
    digests: dict[str, str] = {}
    refused: dict[str, InputError] = {}
    for one in given:
        try:
            found = check_scene_source(one)
        except ControllerError:
            raise
        except InputError as error:
            refused[one.spec.name] = error
            continue
        kept.append(one)
        if found is not None:
            digests[f"estimator of {one.spec.name}"] = found
    if not kept:
        raise next(iter(refused.values()))
    return kept, digests, {name: error.message for name, error in refused.items()}


def _is_rigid(given: TaskInput, step: Step) -> bool:
    return given.library.kind(given.spec.objects[step.object].asset_class) == "rigid"
