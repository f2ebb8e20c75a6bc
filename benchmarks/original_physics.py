"""The single-step tasks of the library under our physics and under the original's, on the same seeds.

    python benchmarks/original_physics.py --assets builtin --episodes 20
    python benchmarks/original_physics.py --assets DIR --episodes 20

Prints the three verdicts of each, causes of misses, and how many episodes stood at the original's default pose.
"""

from __future__ import annotations

import argparse
from collections import Counter

from gensim2.episodes.chain import ChainController
from gensim2.episodes.run import run
from gensim2.objects import open_library
from gensim2.seeding import scene_seeds
from gensim2.sim.lane import Lane
from gensim2.sim.physics import PHYSICS_NAMES
from gensim2.tasks.library import load_strategies, load_task, task_names


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", default="builtin")
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--tasks", nargs="*", default=None)
    options = parser.parse_args()
    library = open_library(options.assets)
    names = options.tasks or [name for name in task_names() if load_task(name).is_single_step]
    total: Counter[tuple[str, str]] = Counter()
    print(f"| task ({library.name}) | physics | paper | held | strict | original pose | why not held |")
    print("|---|---|---|---|---|---|---|")
    for name in names:
        task, strategies = load_task(name), load_strategies(name)
        for physics in PHYSICS_NAMES:
            lane = Lane(task, assets=library, physics=physics)
            seeds = scene_seeds(0, task.name, "benchmark", options.episodes)
            controllers = (ChainController(task, strategies, lane.profile) for _ in seeds)
            episodes = [run(lane, how, seed=seed).episode for seed, how in zip(seeds, controllers, strict=True)]
            counts = {verdict: sum(getattr(e, verdict) for e in episodes) for verdict in ("paper", "held", "strict")}
            posed = sum(thing.default_pose == "original" for e in episodes for thing in e.objects.values())
            causes = Counter(episode.cause.value for episode in episodes if episode.cause is not None)
            why = ", ".join(f"{count} {cause}" for cause, count in causes.most_common())
            row = " | ".join(str(count) for count in counts.values())
            print(f"| {name} | {physics} | {row} | {posed} | {why} |", flush=True)
            for verdict, count in counts.items():
                total[physics, verdict] += count
    whole = len(names) * options.episodes
    for physics in PHYSICS_NAMES:
        shares = [f"{verdict} {total[physics, verdict] / whole:.3f}" for verdict in ("paper", "held", "strict")]
        print(f"\n{physics}: {', '.join(shares)} of {whole}")


if __name__ == "__main__":
    main()
