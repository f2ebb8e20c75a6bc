"""Design the solver configs of the task library anew: searched on generated and real objects at once.

    python scripts/design_library.py --assets DIR --out designs [--tasks OpenBox ...] [--write]

The search is the offline designer's. Episodes alternate between the built-in objects and those of DIR, so that the
config that wins holds on both. ``--effort`` multiplies the episodes of every stage and lets more candidates through;
what ships was searched with 4. ``--write`` puts the winners into the task library.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gensim2.data.records import Attempt
from gensim2.design import Affordance, OfflineDesigner
from gensim2.design.search import Budget, Search
from gensim2.files import write_atomic, write_json
from gensim2.objects import open_library
from gensim2.progress import ConsoleProgress
from gensim2.rollout.evaluator import PoolEvaluator
from gensim2.rollout.worker import Screened
from gensim2.tasks.library import load_task, task_names
from gensim2.tasks.spec import TaskSpec
from gensim2.yaml_files import dump_yaml

LIBRARY = Path(__file__).parents[1] / "python/gensim2/tasks/library"


class BothLibraries:
    """Sends seeds to two evaluators in turn, by parity."""

    def __init__(self, first: PoolEvaluator, second: PoolEvaluator) -> None:
        self._sides = (first, second)

    def screen(
        self, task: TaskSpec, configs: Sequence[Mapping[str, Any]], seeds: Sequence[int]
    ) -> list[list[Screened]]:
        halves = [side.screen(task, configs, seeds[k::2]) for k, side in enumerate(self._sides)]
        return [[*a, *b] for a, b in zip(*halves, strict=True)]

    def attempt(self, task: TaskSpec, jobs: Sequence[tuple[Mapping[str, Any], int]]) -> list[Attempt]:
        results: dict[int, Attempt] = {}
        for k, side in enumerate(self._sides):
            indices = range(k, len(jobs), 2)
            results.update(zip(indices, side.attempt(task, [jobs[i] for i in indices]), strict=True))
        return [results[index] for index in range(len(jobs))]


def effort(factor: int) -> Budget:
    """The pipeline's budget with ``factor`` times the episodes a candidate and twice the candidates from 2 on."""
    usual, wider = Budget(), 2 if factor > 1 else 1
    return replace(
        usual,
        rounds=tuple((wider * count, factor * episodes) for count, episodes in usual.rounds),
        refine_episodes=factor * usual.refine_episodes,
        comparison=(wider * usual.comparison[0], factor * usual.comparison[1]),
        enough_episodes=factor * usual.enough_episodes,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", required=True, help="folder of real objects")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--tasks", nargs="*", default=list(task_names("paper")))
    parser.add_argument("--effort", type=int, default=1)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()

    libraries = open_library("builtin"), open_library(options.assets)
    with (
        ConsoleProgress() as progress,
        PoolEvaluator("builtin", options.workers, progress) as builtin,
        PoolEvaluator(libraries[1].location, options.workers, progress) as real,
    ):
        for name in options.tasks:
            task = load_task(name)
            instances = [
                library.load(task.asset_class, i)
                for library in libraries
                for i in library.instances(task.asset_class)[:2]
            ]
            search = Search(
                task,
                Affordance.of(instances),
                OfflineDesigner(),
                BothLibraries(builtin, real),
                options.seed,
                effort(options.effort),
                progress,
            )
            design = search.run()
            write_json(options.out / f"{name}.json", design.to_dict())
            best = design.results[0]
            progress.message(f"{name}: {best.physics_score:.2f} {best.candidate.label}")
            if options.write and design.chosen is not None:
                write_atomic(LIBRARY / name / "solver.yaml", dump_yaml(design.chosen))


if __name__ == "__main__":
    main()
