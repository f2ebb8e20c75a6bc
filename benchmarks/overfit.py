"""Gate of training: does each head with the default encoder learn ten episodes by heart?

    python benchmarks/overfit.py --out DIR --json overfit.json        # some minutes of CPU a head

Ten demonstrations of CloseBox (keypose: the plans of ten scenes) are trained on without augmentation, and the policy is
rolled out from the ten scenes that it was trained on. A head that holds in fewer has a fault, or had too few steps.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from gensim2.core.files import write_json
from gensim2.core.seeding import scene_seeds
from gensim2.data import DataSet, collect, render
from gensim2.policy.config import HEADS
from gensim2.policy.controller import PolicyController
from gensim2.policy.keypose.controller import KeyposeController
from gensim2.policy.keypose.data import RECORD, Planned, make_shard, read_planned, record_of
from gensim2.policy.keypose.examples import other_openness
from gensim2.policy.keypose.source import PlannedSource
from gensim2.policy.keypose.training import TRAINING, train_keypose
from gensim2.policy.learn_settings import CHUNK_POLICY, CHUNK_SPEC
from gensim2.policy.starting import SPEC
from gensim2.policy.training import train
from gensim2.rollout.inputs import TaskInput, read_task_input
from gensim2.rollout.run import run
from gensim2.rollout.worker import simulator

TASK, EPISODES = "CloseBox", 10
PLAIN = {"jitter": 0.0, "dropout": 0.0, "colour_jitter": 0.0, "ema": 0.99, "threads": 1}


def by_heart(head: str, steps: int, out: Path) -> dict[str, Any]:
    """Train a head on ten episodes and roll it out on their scenes."""
    given = read_task_input(TASK, assets="builtin", instances="train")
    folder = out / head
    if head == "keypose":
        planned = _planned(out / "planned", given)
        seeds = sorted({int(seed) for seed in planned.arrays["seed"]})
        training = TRAINING.of({**TRAINING.to_dict(), **PLAIN, "steps": steps})
        begin = time.process_time()
        train_keypose(PlannedSource([planned]), folder, training=training)
        controller: Any = KeyposeController(str(folder))
    else:
        data = out / "data"
        if not data.exists():
            collect([TASK], episodes=EPISODES, out=data, seed=0, workers=1, assets="builtin", instances="train")
            render(data, spec=CHUNK_SPEC, workers=1)
        seeds = [row.seed for row in DataSet.open(data).task(TASK).logged() if row.held][:EPISODES]
        begin = time.process_time()
        train(data, out=folder, settings={**CHUNK_POLICY.to_dict(), **PLAIN, "head": head, "steps": steps})
        controller = PolicyController(str(folder))
    spent = time.process_time() - begin
    env = simulator(given.scene)
    held = [run(env, controller, seed=seed, stop="goal").episode.held for seed in seeds]
    return {"head": head, "steps": steps, "episodes": len(held), "held": sum(held), "training_cpu_s": round(spent, 1)}


def _planned(folder: Path, given: TaskInput) -> Planned:
    """Plans of ten scenes, of those whose joints stand as they are drawn."""
    if not (folder / RECORD).exists():
        folder.mkdir(parents=True, exist_ok=True)
        drawn = scene_seeds(0, TASK, "overfit", 4 * EPISODES)
        seeds = [seed for seed in drawn if other_openness(given.scene, seed) is None][:EPISODES]
        make_shard(given.scene, given.strategies, SPEC, seeds, str(folder), 0)
        write_json(folder / RECORD, record_of(given, SPEC, 0).model_dump(mode="json"))
    return read_planned(folder)


def main() -> None:
    """Measure, and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--head", action="append", help="only this one; may be given again")
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--json", type=Path, default=None)
    given = parser.parse_args()
    rows = []
    for head in given.head or HEADS:
        rows.append(by_heart(head, given.steps, given.out))
        print("{head}: {held} of {episodes} held after {steps} steps, {training_cpu_s} s of CPU".format(**rows[-1]))
        if given.json is not None:
            write_json(given.json, {"schema_version": 1, "task": TASK, "rows": rows})


if __name__ == "__main__":
    main()
