"""Does the check with a still arm, which leaves the arm out of the scene, say the same as a scene with an arm in it?

    python benchmarks/still_arm.py [--episodes 12] [--seed 0] [--assets DIR] [--physics original]

For every task of the library: the verdict of the check as episodes run it, beside that of the same scene with the arm
held where it stands for the whole length of an episode. Prints where they differ, and CPU milliseconds of both; ends
with 1 where they do.
"""

from __future__ import annotations

import argparse
import sys
import time

from gensim2.objects import open_library
from gensim2.rollout.controller import spec_of
from gensim2.rollout.motion import is_at_rest
from gensim2.rollout.settling import MAX_SETTLE_SECONDS, SETTLE_SECONDS
from gensim2.rollout.still import StillController, still_arm
from gensim2.seeding import scene_seeds
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.library import load_task, task_names


def beside_an_arm(lane: HeadlessEnv, seed: int) -> bool:
    """Whether the goal holds after an episode's length in which the arm holds where it stands."""
    longest, settle = lane.profile.steps(MAX_SETTLE_SECONDS), lane.profile.steps(SETTLE_SECONDS)
    steps = lane.max_episode_steps - longest
    controller = StillController(lane.profile, steps)
    lane.reset(seed)
    controller.reset(lane.observe(spec_of(controller)))
    before = now = lane.measure()
    for index in range(steps + longest):
        action = controller.act(lane.observe(spec_of(controller)))
        if action is None:
            if index >= steps + settle and is_at_rest(before, now, 1.0 / lane.profile.control_hz):
                break
            lane.wait()
        else:
            lane.step(action)
        before, now = now, lane.measure()
    return all_hold(lane.task.success, now)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=12, help="of each task")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--assets", default="builtin")
    parser.add_argument("--physics", choices=("default", "original"), default="default")
    given = parser.parse_args()
    classes = open_library(given.assets).classes()
    counted, differ, true, cost = 0, 0, 0, [0.0, 0.0]
    for name in task_names("paper"):
        if not all(thing.asset_class in classes for thing in load_task(name).objects.values()):
            print(f"{name}: skipped, an object is not there")
            continue
        lane = HeadlessEnv(name, assets=given.assets, physics=given.physics)
        for seed in scene_seeds(given.seed, name, "benchmark/still", given.episodes):
            started = time.process_time()
            without = still_arm(lane, seed).success
            between = time.process_time()
            beside = beside_an_arm(lane, seed)
            cost[0] += between - started
            cost[1] += time.process_time() - between
            counted, true = counted + 1, true + beside
            if without != beside:
                differ += 1
                print(f"{name}, seed {seed}: {without} without the arm, {beside} beside it", flush=True)
    print(
        f"{differ} of {counted} verdicts differ; the goal came about by itself in {true}. "
        f"{1000 * cost[0] / counted:.1f} ms without the arm, {1000 * cost[1] / counted:.1f} ms beside it"
    )
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
