"""Tasks of several steps in physics: how many episodes hold, also where something is disturbed on the way.

    python benchmarks/long_horizon.py [--tasks NAME ...] [--assets builtin] [--episodes 50] [--seed 0]
        [--disturb none|push|open] [--open-loop] [--workers 2] [--json OUT]

``push`` moves the rigid object 3 cm over the table in a drawn direction, at a control step drawn from the first 100.
``open`` commands the fingers to open for half a second, from a step drawn from the 50 after they have closed on it.
Real drawers are the eight that the original draws from.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from gensim2.episodes.chain import ChainController
from gensim2.episodes.controller import Action, Observation
from gensim2.episodes.run import run as run_episode
from gensim2.planning.scene import Scene
from gensim2.processes import WorkerPool, enumerated
from gensim2.processes import results as run
from gensim2.robots import robot
from gensim2.seeding import rng
from gensim2.sim.lane import Lane
from gensim2.tasks.library import load_strategies, load_task

TASKS = ("PlaceGolfBallIntoDrawer", "PutCrackerBoxInBox", "PlaceLemonIntoDrawer")
#: The original's choice; others of its drawers hold nothing.
DRAWERS = ("19179", "20279", "20411", "20555", "22692", "26525", "29921", "31249")
PUSH = 0.03
PUSHED_WITHIN, OPENED_WITHIN, OPEN_STEPS = 100, 50, 10


class Disturbed(ChainController):
    """A chain in whose way something is put once.

    Args:
        lane: in which the object is pushed.
        kind: ``"none"``, ``"push"`` or ``"open"``.
        rigid: name of the object that is taken up.
    """

    def __init__(self, lane: Lane, kind: str, rigid: str, seed: int, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        random = rng(seed, f"long_horizon/{kind}")
        self._lane, self._kind, self._rigid = lane, kind, rigid
        self._push_at, self._open_after = int(random.integers(PUSHED_WITHIN)), int(random.integers(OPENED_WITHIN))
        self._angle = random.uniform(-np.pi, np.pi)

    def reset(self, scene: Scene) -> None:
        """Begin an episode."""
        super().reset(scene)
        self._closed = 0

    def act(self, observation: Observation) -> Action | None:
        """The chain's action, or what is made of it."""
        if self._kind == "push" and observation.step == self._push_at:
            self._lane.nudge(self._rigid, PUSH * np.cos(self._angle), PUSH * np.sin(self._angle))
        action = super().act(observation)
        if self._kind != "open" or action is None or self.turn is None:
            return action
        # Of the steps about the rigid object, from where the fingers press.
        about = next(step for step in self._task.steps if step.name == self.turn)
        holds = self._rigid in (about.object, about.tool) and action[-1] < 0
        self._closed += holds or self._closed > 0
        if 0 <= self._closed - 1 - self._pressing - self._open_after < OPEN_STEPS:
            return np.append(action[:-1], np.float32(1.0))
        return action

    @property
    def _pressing(self) -> int:
        """Steps from the first closing command to a firm hold."""
        return 15


@lru_cache(maxsize=1)
def lane_of(name: str, assets: str) -> Lane:
    """The physics of a task."""
    real = assets != "builtin" and "Drawer" in name
    return Lane(name, assets=assets, instances=DRAWERS if real else "all")


def episode(name: str, assets: str, seed: int, kind: str, open_loop: bool) -> dict[str, Any]:
    """One episode, as its record."""
    lane = lane_of(name, assets)
    task = load_task(name)
    rigid = next(step.tool for step in task.steps if step.tool in task.objects)
    chain = Disturbed(lane, kind, rigid, seed, task, load_strategies(name), robot("panda"), open_loop=open_loop)
    return run_episode(lane, chain, seed=seed).episode.to_dict()


def interval(count: int, total: int) -> str:
    """Share with its 95 % interval (Wilson)."""
    low, high = binomtest(count, total).proportion_ci(method="wilson")
    return f"{count / total:.2f} ({low:.2f} to {high:.2f})"


def row(name: str, records: list[Mapping[str, Any]]) -> str:
    """One line of the table."""
    total = len(records)
    shares = [interval(sum(r[key] for r in records), total) for key in ("held", "paper", "strict")]
    causes = Counter(str(r["cause"]) for r in records if r["cause"] is not None)
    misses = Counter(str(miss) for r in records if r["held"] for miss in r["strict_misses"])
    replans = sum(max(len(step["plans"]) - 1, 0) for r in records for step in r["steps"])
    told = [", ".join(f"{n} {what}" for what, n in counts.most_common()) or "none" for counts in (causes, misses)]
    return f"| {name} | {' | '.join(shares)} | {replans / total:.1f} | {told[0]} | {told[1]} |"


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns 1 where a task holds in less than 0.7 of its episodes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="*", default=list(TASKS))
    parser.add_argument("--assets", default="builtin")
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--disturb", choices=("none", "push", "open"), default="none")
    parser.add_argument("--open-loop", action="store_true")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    jobs = [
        (name, options.assets, options.seed + number, options.disturb, options.open_loop)
        for name in options.tasks
        for number in range(options.episodes)
    ]
    with WorkerPool(options.workers) as pool:
        found = {}
        for index, result in run(pool.map_unordered(episode, enumerated(jobs)), "episodes"):
            found[index] = result
            said = "held" if result["held"] else result["cause"]
            print(f"{len(found)} of {len(jobs)}: {jobs[index][0]} {jobs[index][2]} {said}", file=sys.stderr)
    print("| task | held | paper | strict | plans beyond the first | what went wrong | what strict misses |")
    print("|---|---|---|---|---|---|---|")
    by_task = {name: [found[i] for i, job in enumerate(jobs) if job[0] == name] for name in options.tasks}
    for name, records in by_task.items():
        print(row(name, records))
    if options.json:
        options.json.write_text(json.dumps([found[i] for i in sorted(found)], indent=1))
    return 0 if all(sum(r["held"] for r in records) >= 0.7 * len(records) for records in by_task.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
