"""Measure how much CPU time each part of an episode takes: mean over all library tasks on generated objects, ms.

    python benchmarks/episode_cost.py --episodes 10 [--engine mujoco] [--long] [--physics original] [--core 1]

The process is pinned to one core. Parts are nested, and the time of a part excludes the parts inside it, so the rows
add up to the total. The row of the engine contains only its step function (``PhysxCpuSystem.step`` or ``mj_step``). The
no-op baseline, which runs the scene without the robot, has its own row.
"""

from __future__ import annotations

import argparse
import os
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import gensim2_kpam as kpam
from gensim2.core.seeding import scene_seeds
from gensim2.rollout import run as running
from gensim2.rollout.chain import ChainController
from gensim2.rollout.run import run
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_strategies, load_task, task_names

clock = time.process_time

NAMES = {"sapien": "PhysX", "mujoco": "MuJoCo"}


class Stopwatch:
    """Measures CPU seconds by part; the time of a part excludes the parts inside it."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.calls: dict[str, int] = defaultdict(int)
        self._open: list[list[Any]] = []
        self._prefix = ""
        self.is_running = False

    def timed(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that also records its CPU time."""

        def call(*args: Any, **kwargs: Any) -> Any:
            self._open.append([self._prefix + part, 0.0])
            start = clock()
            try:
                return function(*args, **kwargs)
            finally:
                spent = clock() - start
                name, inner = self._open.pop()
                if self.is_running:
                    self.seconds[name] += spent - inner
                    self.calls[name] += 1
                if self._open:
                    self._open[-1][1] += spent

        return call

    def rename(self, part: str) -> None:
        """Rename the current part."""
        self._open[-1][0] = self._prefix + part

    def within(self, prefix: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that records the parts inside it with a prefix."""

        def call(*args: Any, **kwargs: Any) -> Any:
            before, self._prefix = self._prefix, prefix
            try:
                return function(*args, **kwargs)
            finally:
                self._prefix = before

        return call


class TimedSystem:
    """A PhysX system, or a simulation in MuJoCo, whose steps are timed."""

    def __init__(self, system: Any, watch: Stopwatch, engine: str) -> None:
        self._system = system
        self.step = watch.timed(engine, system.step)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._system, name)


def instrument(watch: Stopwatch, engine: str) -> None:
    """Measure the time of the parts of the episode loop.

    Args:
        engine: name of the engine in the table.
    """
    building = HeadlessEnv.reset
    met: set[tuple[str, str]] = set()

    def reset(env: HeadlessEnv, *args: Any, **kwargs: Any) -> None:
        building(env, *args, **kwargs)
        models = {(thing.model.asset_class, thing.model.id) for thing in env.initial_state.objects.values()}
        if not models <= met:
            met.update(models)
            watch.rename("reset, an object for the first time")
        scene: Any = env._scene
        system = "simulation" if engine == NAMES["mujoco"] else "system"
        setattr(scene, system, TimedSystem(getattr(scene, system), watch, engine))

    HeadlessEnv.reset = watch.timed("reset", reset)  # type: ignore[method-assign]
    HeadlessEnv.step = watch.timed(f"step, around {engine}", HeadlessEnv.step)  # type: ignore[method-assign]
    HeadlessEnv.wait = watch.timed(f"step, around {engine}", HeadlessEnv.wait)  # type: ignore[method-assign]
    HeadlessEnv.measure = watch.timed("measuring", HeadlessEnv.measure)  # type: ignore[method-assign]
    HeadlessEnv.scene_state = watch.timed("planning, around the solver", HeadlessEnv.scene_state)  # type: ignore[method-assign]
    ChainController.reset = watch.timed("planning, around the solver", ChainController.reset)  # type: ignore[method-assign]
    ChainController._begin = watch.timed("planning, around the solver", ChainController._begin)  # type: ignore[method-assign]
    kpam.plan = watch.timed("planning, the solver", kpam.plan)
    still = watch.timed("rest", running.no_op_baseline)  # type: ignore[attr-defined]
    running.no_op_baseline = watch.within("no-op baseline: ", still)  # type: ignore[attr-defined]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", default="builtin")
    parser.add_argument("--episodes", type=int, default=10, help="number of episodes of each task")
    parser.add_argument("--physics", default="default")
    parser.add_argument("--core", type=int, default=0)
    parser.add_argument("--engine", choices=NAMES, default="sapien")
    parser.add_argument("--long", action="store_true", help="tasks with several steps instead of single-step tasks")
    parser.add_argument("--tasks", nargs="*", default=None)
    options = parser.parse_args()
    os.sched_setaffinity(0, {options.core})

    suite = [name for name in task_names("paper") if load_task(name).is_single_step != options.long]
    watch, held, steps, whole = Stopwatch(), 0, 0, 0.0
    names, engine = options.tasks or suite, NAMES[options.engine]
    by_task: dict[str, float] = {}
    first = "reset, an object for the first time"
    instrument(watch, engine)
    for name in names:
        task, strategies = load_task(name), load_strategies(name)
        env = HeadlessEnv(task, assets=options.assets, physics=options.physics, engine=options.engine)
        seeds = scene_seeds(0, task.name, "benchmark", options.episodes + 1)
        run(
            env, ChainController(task, strategies, env.profile), seed=seeds[-1]
        )  # the first episode also imports modules and fills caches, so it is not measured
        watch.is_running = True
        start, unseen = clock(), watch.seconds[first]
        for seed in seeds[:-1]:
            episode = run(env, ChainController(task, strategies, env.profile), seed=seed).episode
            held += episode.held
            steps += episode.control_steps
        spent = clock() - start
        whole += spent
        by_task[name] = (spent - watch.seconds[first] + unseen) / options.episodes
        watch.is_running = False
    count = len(names) * options.episodes
    physics = sum(seconds for part, seconds in watch.seconds.items() if part.endswith(engine) and "around" not in part)
    rest = whole - sum(watch.seconds.values())
    print(f"{count} episodes, {held} held, {steps / count:.0f} control steps each, {options.physics} physics\n")
    print("| part | ms an episode | share |\n|---|---|---|")
    for part, seconds in [*sorted(watch.seconds.items(), key=lambda item: -item[1]), ("judging and the rest", rest)]:
        print(f"| {part} | {1e3 * seconds / count:.2f} | {seconds / whole:.0%} |")
    print(f"| **whole** | **{1e3 * whole / count:.1f}** | {whole / physics:.2f} x {engine} |")
    later = whole - watch.seconds[first]
    print(f"\n{watch.calls[first]} resets loaded an object for the first time; without these resets:")
    print(f"{1e3 * later / count:.1f} ms an episode, {later / physics:.2f} x {engine}")
    for name, seconds in sorted(by_task.items(), key=lambda item: item[1]):
        print(f"{1e3 * seconds:8.1f} ms {name}")
    calls = watch.calls[engine]
    print(f"\n{engine}: {1e6 * watch.seconds[engine] / calls:.0f} us a call, {calls / count:.0f} calls")


if __name__ == "__main__":
    main()
