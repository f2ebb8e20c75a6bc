"""The eight tasks through the deployed line, with noise, delays and calibration errors drawn each trial.

    python benchmarks/robot_trials.py [--tasks CloseBox ...] [--trials 50] [--plan [--scene true|perceived|DIR]]
        [--policy NAME=DIR ...] --out DIR [--speed 0.5] [--force 140] [--pixels 320x240] [--seed 0] [--json OUT]

By a simulated clock and in simulation: limits, watch, line and encoder are those of a real arm, the world is not.
Each trial has a placement of the task's protocol; cameras have the noise of a D435, are off their calibration by 0.2
degrees and 3 mm, their depth by 0.5 % and 2 mm, their clocks by 10 ms (standard deviations); pictures come 20 to 60 ms
late, and the controller answers within 30 to 90 ms. The simulator judges; where the watch holds or stops the arm, the
trial has failed. --plan is the planner, which is shown the true scene, or with --scene perceived estimates the scene
from the point clouds of the cameras. --policy NAME=DIR is a checkpoint, or a folder with one for each task, by its
name. Killed, it goes on where it was when called again.

Policies are taught with this noise and without it, by at most 200 demonstrations of each task:

    gensim2 learn TASK --scenes 200 --minutes 2 --noise deployed --assets builtin --out noisy/TASK
    gensim2 learn TASK --scenes 200 --minutes 2 --assets builtin --out clean/TASK
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

from gensim2.core.progress import ConsoleProgress
from gensim2.rollout.config import TRUE_SCENE
from gensim2_robot.config import Delays
from gensim2_robot.trial.record import protocol_names, read_protocol, write_table
from gensim2_robot.trial.run import trial
from gensim2_robot.watch import WatchRules

DELAYS = Delays(camera=(0.02, 0.06), controller=(0.03, 0.09))
#: Pictures are 0.1 s apart and come up to 0.06 s late, by clocks that are off by some 0.01 s each.
RULES = WatchRules(frame_age=0.2)
CPU = "cpu.json"


def checkpoint(folder: Path, task: str) -> Path:
    """The checkpoint of a task: in a folder of its name, or the folder itself."""
    return folder / task if (folder / task).is_dir() else folder


def spent(folder: Path) -> float:
    """Seconds of CPU that a folder's trials took, as far as they are over."""
    file = folder / CPU
    return float(json.loads(file.read_text())) if file.exists() else 0.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="*", default=protocol_names())
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("--plan", action="store_true")
    parser.add_argument("--scene", default=TRUE_SCENE)
    parser.add_argument("--policy", action="append", default=[], metavar="NAME=DIR")
    parser.add_argument("--speed", type=float, default=0.5)
    parser.add_argument("--force", type=float, default=140.0)
    parser.add_argument("--pixels", default="320x240")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--assets", default="builtin")
    parser.add_argument("--instances", default="all")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    width, height = map(int, options.pixels.split("x"))
    planner = "plan" if options.scene == TRUE_SCENE else f"plan_{Path(options.scene).name}"
    who: dict[str, Path | None] = {planner: None} if options.plan else {}
    for word in options.policy:
        name, _, folder = word.partition("=")
        who[name] = Path(folder)
    figures: dict[str, Any] = {}
    for name, folder in who.items():
        place = options.out / name
        for task in options.tasks:
            begun = time.process_time()
            with ConsoleProgress() as progress:
                trial(
                    read_protocol(task),
                    out=place,
                    trials=options.trials,
                    verdict="simulator",
                    resume=True,
                    progress=progress,
                    policy=None if folder is None else checkpoint(folder, task),
                    scene_source=options.scene if folder is None else TRUE_SCENE,
                    speed=options.speed,
                    force=options.force,
                    pixels=(width, height),
                    noise="deployed",
                    delays=DELAYS,
                    rules=RULES,
                    seed=options.seed,
                    simulated_clock=True,
                    assets=options.assets,
                    instances=options.instances,
                )
            (place / task / CPU).write_text(json.dumps(spent(place / task) + time.process_time() - begun))
        found = write_table(place)
        for row in found["rows"]:
            row["cpu_s"] = spent(place / row["task"])
            low, high = row["interval"]
            said = f"{row['successes']}/{row['trials']} ({low:.2f} to {high:.2f}), {row['cpu_s']:.0f} s of CPU"
            print(f"{name:12} {row['task']:20} {said}  {row['causes']}", flush=True)
        mean = found["mean"]
        print(f"{name:12} mean over {len(found['rows'])} tasks: {mean:.3f}", flush=True)
        figures[name] = found
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
