"""Check the no-op baseline, which simulates a scene without the arm, against a scene in which the arm does not move.

    python benchmarks/no_op_baseline.py [--episodes 12] [--seed 0] [--assets DIR] [--physics original]

The no-op baseline tests whether a goal comes true without the robot. For every task of the paper's suite and several
random scenes, the script compares its result with the result of an episode in which the arm holds its start position.
It prints the scenes with different results, and the CPU time of both methods (ms). The exit code is 1 if a result
differs.
"""

from __future__ import annotations

import argparse
import sys
import time

from gensim2.core.seeding import scene_seeds
from gensim2.objects import open_library
from gensim2.rollout.controller import spec_of
from gensim2.rollout.motion import MAX_SETTLE_SECONDS, SETTLE_SECONDS, is_at_rest
from gensim2.rollout.no_op import NoOpController, no_op_baseline
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.library import load_task, task_names


def beside_an_arm(env: HeadlessEnv, seed: int) -> bool:
    """Return whether the goal is met after a complete episode in which the arm holds its start position."""
    longest, settle = env.profile.steps(MAX_SETTLE_SECONDS), env.profile.steps(SETTLE_SECONDS)
    steps = env.max_episode_steps - longest
    controller = NoOpController(env.profile, steps)
    env.reset(seed)
    controller.reset(env.observe(spec_of(controller)))
    before = now = env.measure()
    for index in range(steps + longest):
        action = controller.act(env.observe(spec_of(controller)))
        if action is None:
            if index >= steps + settle and is_at_rest(before, now, 1.0 / env.profile.control_hz):
                break
            env.wait()
        else:
            env.step(action)
        before, now = now, env.measure()
    return all_hold(env.task.success, now)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=12, help="number of scenes of each task")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--assets", default="builtin")
    parser.add_argument("--physics", choices=("default", "original"), default="default")
    given = parser.parse_args()
    classes = open_library(given.assets).classes()
    counted, differ, true, cost = 0, 0, 0, [0.0, 0.0]
    for name in task_names("paper"):
        if not all(thing.asset_class in classes for thing in load_task(name).objects.values()):
            print(f"{name}: skipped, because the object folder lacks a class")
            continue
        env = HeadlessEnv(name, assets=given.assets, physics=given.physics)
        for seed in scene_seeds(given.seed, name, "benchmark/still", given.episodes):
            started = time.process_time()
            without = no_op_baseline(env, seed).success
            between = time.process_time()
            beside = beside_an_arm(env, seed)
            cost[0] += between - started
            cost[1] += time.process_time() - between
            counted, true = counted + 1, true + beside
            if without != beside:
                differ += 1
                print(f"{name}, seed {seed}: {without} without the arm, {beside} with the arm", flush=True)
    print(
        f"{differ} of {counted} results differ; the goal was met without a motion of the robot in {true}. "
        f"{1000 * cost[0] / counted:.1f} ms without the arm, {1000 * cost[1] / counted:.1f} ms with the arm"
    )
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
