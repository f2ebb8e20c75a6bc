"""The simulator behind the search: a pool of worker processes that share nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gensim2.demos.pool import WorkerPool
from gensim2.pipeline import worker
from gensim2.pipeline.records import Attempt
from gensim2.progress import NULL_PROGRESS, Progress
from gensim2.tasks.spec import TaskSpec


class PoolEvaluator:
    """Plans and runs episodes in worker processes; results come in the order of the jobs, whatever their number.

    A context manager: leaving it ends the workers.

    Args:
        assets: ``"builtin"`` or the path of a folder of objects.
        workers: number of processes.
        progress: is advanced once a job; whoever calls starts the stage.
        instances: which instances episodes draw from, as in ``GenSim2Env``.
    """

    def __init__(self, assets: str, workers: int, progress: Progress = NULL_PROGRESS, instances: str = "all") -> None:
        self.assets, self.instances = assets, instances
        self.pool = WorkerPool(workers)
        self._workers, self._progress = workers, progress

    def __enter__(self) -> PoolEvaluator:
        return self

    def __exit__(self, *_: object) -> None:
        self.pool.close()

    def setting(self, task: TaskSpec) -> worker.Setting:
        """Return the environment of a task, as a value that pickles."""
        return worker.Setting(task.model_dump_json(), self.assets, self.instances)

    def screen(
        self, task: TaskSpec, configs: Sequence[Mapping[str, Any]], seeds: Sequence[int]
    ) -> list[list[worker.Screened]]:
        """Plan each config on each seed's scene; one list a config, one (score, cause) a seed."""
        setting = self.setting(task)
        by_seed: list[list[worker.Screened]] = []
        for outcome in self.pool.map(worker.screen_scene, [(setting, seed, configs) for seed in seeds]):
            by_seed.append(outcome.unwrap())
            self._progress.advance()
        return [list(outcomes) for outcomes in zip(*by_seed, strict=True)]

    def attempt(self, task: TaskSpec, jobs: Sequence[tuple[Mapping[str, Any], int]]) -> list[Attempt]:
        """Run (config, seed) episodes in physics; one whose worker died counts as failed, with the reason."""
        setting = self.setting(task)
        attempts = []
        for outcome in self.pool.map(worker.attempt, [(setting, config, seed) for config, seed in jobs]):
            if outcome.error is None:
                attempts.append(outcome.unwrap())
            else:
                attempts.append(worker.failed(jobs[outcome.index][1], outcome.error))
            self._progress.advance()
        return attempts
