"""A night's collection, once undisturbed and once killed again and again: the same bytes, or it ends with 1.

    python benchmarks/night.py --out /data/night                        # 24 tasks x 417 episodes, 100 kills
    python benchmarks/night.py --episodes 20 --tasks 10 --kills 10      # 200 episodes
    python benchmarks/night.py --out /data/night --at-once              # both runs at the same time

Both runs are of all tasks of the suite with one step, or the first so many of them. Kills come at random moments all
along the run: drivers by SIGKILL and SIGTERM, single workers, the server that forks them. With --out an
undisturbed run that is there already is taken as it is, and one that was cut short is gone on with.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import collection

import kill_runs  # isort: skip - found by collection

START_SECONDS = 15.0
"""Within which a kill comes that waits for no episode: about what a start takes."""


class Disturbed(kill_runs.Disturbed):
    """A collection that is killed again and again, until all of it is there.

    Most kills come when a random number of further episodes is finished, ``mean`` in the mean, and so all along the run
    however long starting anew takes; the others a random time after the last, and meet starts too.
    """

    mean = 100.0

    def _wait(self, process: subprocess.Popen[bytes]) -> bool:
        if self.dice.random() > kill_runs.MID_COLLECTION:
            until, wanted = time.monotonic() + self.dice.uniform(0, START_SECONDS), math.inf
        else:
            until, wanted = math.inf, self._logged() + self.dice.uniform(0, 2 * self.mean)
        while process.poll() is None:
            if time.monotonic() > until or self._logged() > wanted:
                return True
            time.sleep(0.2)
        return False

    def _logged(self) -> int:
        """Episodes that are finished; quickly, for it is asked all the time."""
        folders = [folder for kept in ("episodes", "failures") for folder in self.out.glob(f"*/{kept}")]
        return sum(1 for folder in folders for _ in os.scandir(folder))


def undisturbed(command: kill_runs.Command, out: Path) -> None:
    """Collect without disturbance, and say what it took."""
    told, log = out.with_suffix(".json"), out.with_suffix(".log")
    watched = collection.watch([*command.line(out, "simulator", resume=True), "--json", str(told)], log)
    if watched.code != 0:
        raise SystemExit(log.read_text()[-2000:])
    result = json.loads(told.read_text())
    tried, ran = result["episodes"], result["episodes_run"]
    print(f"undisturbed: {tried} episodes of {len(result['tasks'])} tasks, {result['held']} held")
    print(f"  {ran} of them in {watched.seconds:.0f} s: {ran / watched.seconds:.2f} a second, ", end="")
    print(f"{result['cpu_s'] / max(ran, 1):.3f} s of CPU each\n  {watched}")
    for pattern in ("*/episodes/*.h5", "*/failures/*.h5", "*/episodes.jsonl"):
        files, total = collection.size(out, pattern)
        print(f"  {pattern}: {files} files, {total / 1e6:.1f} MB", flush=True)


def killed(command: kill_runs.Command, out: Path, kills: int, mean: float, seed: int) -> None:
    """Collect with kills about every ``mean`` episodes, and say what it took."""
    shutil.rmtree(out, ignore_errors=True)
    tally, begin = kill_runs.Tally(Counter()), time.monotonic()
    run = Disturbed(command, "simulator", out, random.Random(seed), tally)
    run.mean = mean
    done = run.run(kills)
    print(f"killed: {done} kills {dict(tally.kills)} in {time.monotonic() - begin:.0f} s", flush=True)
    if done < kills:
        print(f"  the run was over before it had been killed {kills} times")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=417, help="of each task")
    parser.add_argument("--tasks", type=int, default=24, help="how many tasks")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="of the kills")
    parser.add_argument("--at-once", action="store_true", help="let both runs go at the same time")
    parser.add_argument("--out", type=Path, help="keep the data sets here; default: a temporary folder")
    options = parser.parse_args()
    kill_runs.LIFE_LIMIT = 48 * 3600.0
    single = collection.single_step_tasks()[: options.tasks]
    words = ("collect", *single, "--workers", str(options.workers))
    command = kill_runs.Command("collect", words, options.episodes, (), None)
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor() as threads:
            first = threads.submit(undisturbed, command, folder / "undisturbed")
            if not options.at_once:
                first.result()
            # Episodes are finished, too, while a kill waits that waits for none, and while what was killed starts anew.
            mean = 0.5 * options.episodes * len(single) / max(options.kills, 1)
            killed(command, folder / "killed", options.kills, mean, options.seed)
            first.result()
        ours, theirs = (kill_runs.contents(folder / name) for name in ("undisturbed", "killed"))
    differing = list(kill_runs.differences(ours, theirs))
    for name in differing:
        print(f"differs: {name}")
    print(f"{len(differing)} of {len(ours)} files differ")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
