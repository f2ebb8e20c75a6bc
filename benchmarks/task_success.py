"""Success of the task library: every task on random objects, poses and openness, beside the paper's figures.

    python benchmarks/task_success.py --assets builtin --episodes 100 --json builtin.json
    python benchmarks/task_success.py --assets DIR --physics original --episodes 100 --json original.json
    python benchmarks/task_success.py --tasks PlaceGolfBallIntoDrawer --open-loop --episodes 50

Three verdicts, never mixed (docs/episodes.md): what holds at the end and not with a still arm, with its 95 % interval
(Wilson); what the paper counts; what is strictly done. CPU is that of all processes without their start.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from statistics import mean
from typing import Any

from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.inputs import read_task_input
from gensim2.pipeline.search import design_seeds
from gensim2.pipeline.setting import DEFAULT_ROBOT, PHYSICS
from gensim2.pipeline.tally import Tally, interval
from gensim2.progress import ConsoleProgress
from gensim2.tasks.library import task_names

#: Mean success of the paper's demonstrations (Table 4).
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
    parser.add_argument("--physics", choices=PHYSICS, default="ours")
    parser.add_argument("--robot", default=DEFAULT_ROBOT)
    parser.add_argument("--open-loop", action="store_true")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--tasks", nargs="*", default=list(task_names()))
    parser.add_argument("--json", type=Path, help="every episode's record")
    options = parser.parse_args()

    found: dict[str, dict[str, Any]] = {}
    held: dict[str, float] = {}
    print(
        "| task | held | 95 % | paper's verdict | strict | partial | the paper | CPU s an episode | what went wrong |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name in options.tasks:
        given = read_task_input(
            name,
            options.assets,
            options.instances,
            options.seed,
            physics=options.physics,
            robot=options.robot,
            open_loop=options.open_loop,
        )
        seeds = design_seeds(options.seed, given.spec, "benchmark", options.episodes)
        with (
            ConsoleProgress() as progress,
            PoolEvaluator(given.circumstances, options.workers, progress) as evaluator,
        ):
            progress.start(name, options.episodes)
            setting = evaluator.setting(given.spec, given.instances)
            episodes = evaluator.episodes(setting, [(given.strategies, seed) for seed in seeds])
            cpu_s = evaluator.cpu_s / len(episodes)
        tally = Tally.of(episodes)
        low, high = interval(tally.held, tally.episodes)
        causes = ", ".join(f"{count} {cause}" for cause, count in tally.causes.items())
        print(
            f"| {name} | {tally.held}/{tally.episodes} | {low:.2f} to {high:.2f} | {tally.paper} | {tally.strict} "
            f"| {tally.partial} | {PAPER.get(name, '')} | {cpu_s:.3f} | {causes} |",
            flush=True,
        )
        held[name] = tally.held / tally.episodes
        found[name] = {**tally.to_dict(), "cpu_s": cpu_s, "episodes": [episode.to_dict() for episode in episodes]}
    known = [name for name in held if name in PAPER]
    if known:
        ours, theirs = mean(held[name] for name in known), mean(PAPER[name] for name in known)
        print(f"| mean of those in the paper's table | {ours:.2f} | | | | | {theirs:.2f} | | |")
    if options.json:
        options.json.write_text(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
