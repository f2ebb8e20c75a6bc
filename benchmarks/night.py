"""A night's collection, once undisturbed and once killed again and again: the same bytes, or it ends with 1.

    python benchmarks/night.py --out /data/night                        # 24 tasks x 417 episodes, 100 kills
    python benchmarks/night.py --episodes 20 --tasks 10 --kills 10      # 200 episodes
    python benchmarks/night.py --out /data/night --every 30             # both runs at once

Both runs are of all tasks of the suite with one step, or the first so many of them. Kills come at random moments that
are spread over the whole run: drivers by SIGKILL and SIGTERM, single workers, the server that forks them. With --out an
undisturbed run that is there already is taken as it is, and one that was cut short is gone on with.
"""

from __future__ import annotations

import argparse
import json
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


class Disturbed(kill_runs.Disturbed):
    """A collection that is killed about every ``mean`` seconds."""

    mean = 60.0

    def _wait(self, process: subprocess.Popen[bytes]) -> bool:
        until = time.monotonic() + self.dice.uniform(0, 2 * self.mean)
        while process.poll() is None:
            if time.monotonic() > until:
                return True
            time.sleep(0.05)
        return False


def undisturbed(command: kill_runs.Command, out: Path) -> float:
    """Collect without disturbance, say what it took, and return the seconds."""
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
    return watched.seconds


def killed(command: kill_runs.Command, out: Path, kills: int, mean: float, seed: int) -> None:
    """Collect with kills about every ``mean`` seconds, and say what it took."""
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
    parser.add_argument(
        "--every",
        type=float,
        metavar="SECONDS",
        help="kill so often, in the mean, and let both runs go at once; default: one after the other, and the kills "
        "spread over as long as the first took",
    )
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
            every = options.every or first.result() / (options.kills + 1)
            killed(command, folder / "killed", options.kills, every, options.seed)
            first.result()
        ours, theirs = (kill_runs.contents(folder / name) for name in ("undisturbed", "killed"))
    differing = list(kill_runs.differences(ours, theirs))
    for name in differing:
        print(f"differs: {name}")
    print(f"{len(differing)} of {len(ours)} files differ")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
