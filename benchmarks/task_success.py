"""Success of the task library: every task on random objects, poses and openness, beside the paper's figures.

    python benchmarks/task_success.py --assets builtin --episodes 20 --json builtin.json
    python benchmarks/task_success.py --assets DIR --episodes 20 --json real.json

A success counts only if the same seed with a still arm fails.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from statistics import mean

from gensim2.objects import open_library
from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.records import Verification
from gensim2.pipeline.search import design_seeds
from gensim2.progress import ConsoleProgress
from gensim2.tasks.library import load_config, load_task, task_names

#: Mean success of the paper's demonstrations (Table 4) for the tasks that both have.
PAPER = {
    "OpenBox": 0.84,
    "CloseBox": 0.94,
    "OpenLaptop": 0.76,
    "CloseLaptop": 0.95,
    "TurnOnFaucet": 0.67,
    "OpenDrawer": 0.80,
    "PushDrawerClose": 0.87,
    "OpenSafe": 0.62,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", default="builtin")
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--instances", default="all", help="all, train, test or an id: what episodes draw from")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--tasks", nargs="*", default=list(task_names()))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    library = open_library(options.assets)
    table: dict[str, Verification] = {}
    with (
        ConsoleProgress() as progress,
        PoolEvaluator(library.location, options.workers, progress, options.instances) as evaluator,
    ):
        for name in options.tasks:
            task, config = load_task(name), load_config(name)
            progress.start(name, options.episodes)
            seeds = design_seeds(options.seed, task, "benchmark", options.episodes)
            attempts = evaluator.attempt(task, [(config, seed) for seed in seeds])
            table[name] = Verification(tuple(attempts), threshold=0.7)

    print(f"| task | {library.name} | paper | what went wrong |\n|---|---|---|---|")
    for name, result in table.items():
        causes = ", ".join(f"{count} {cause}" for cause, count in result.causes().items())
        print(f"| {name} | {result.successes}/{len(result.attempts)} | {PAPER.get(name, '')} | {causes} |")
    print(f"| mean | {mean(result.rate for result in table.values()):.2f} | {mean(PAPER.values()):.2f} | |")
    if options.json:
        options.json.write_text(json.dumps({name: result.to_dict() for name, result in table.items()}, indent=2))


if __name__ == "__main__":
    main()
