"""Test that a collection of demonstrations that is killed and resumed many times gives the same files.

    python benchmarks/night.py --out /data/night                        # 24 tasks x 417 episodes, 100 kills
    python benchmarks/night.py --episodes 20 --tasks 10 --kills 10      # 200 episodes
    python benchmarks/night.py --out /data/night --hours 2.5            # stops; repeat the command to go on
    python benchmarks/night.py --out /data/night --at-once              # both runs at the same time

The script collects the same data set twice: without disturbance, and with kills. Both runs use the first --tasks
single-step tasks of the paper's suite. The times of the kills are fixed before the run. The run is divided into equal
parts, and one kill comes in each part, when a random number of episodes is finished. One kill in five comes earlier, at
a random time after the previous kill, so that some kills hit a run while it starts. The victims are the driver process
(SIGKILL or SIGTERM), single workers, and the fork server that starts the workers. With --out, the same command
continues a test that was interrupted; ``night.json`` stores its progress. The exit code is 1 if files differ or kills
are missing, and 3 if the time of --hours is over before the end of the test.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import collection

import gensim2

import kill_runs  # isort: skip - importing collection adds the folder of this module to sys.path

START_SECONDS = 15.0
"""Maximum delay (s) of a kill that does not wait for an episode; about the duration of a start."""

NO_VICTIM_SECONDS = 60.0
"""Time (s) after which a kill hits the driver instead, because its worker or server was not found."""

LAST = 0.98
"""Maximum fraction of finished episodes at a kill, so that the run is still active when the last kill comes."""

NOT_OVER = 3


@dataclass(frozen=True)
class Kill:
    """A kill, due when ``after`` episodes are finished, or earlier: ``delay`` seconds after the previous kill."""

    victim: str
    after: int
    delay: float


def planned(kills: int, episodes: int, seed: int) -> list[Kill]:
    """Return the kills of a run with ``episodes`` episodes, in order; equal arguments give equal kills."""
    dice = random.Random(seed)
    found = []
    for number in range(kills):
        victim = dice.choices(tuple(kill_runs.VICTIMS), tuple(kill_runs.VICTIMS.values()))[0]
        after = int((number + dice.random()) / kills * episodes * LAST)
        delay = math.inf if dice.random() < kill_runs.MID_COLLECTION else dice.uniform(0, START_SECONDS)
        found.append(Kill(victim, after, delay))
    return found


@dataclass
class Night:
    """Progress of a test.

    Attributes:
        begun: arguments of the test and digest of the tested program.
        kills: kills so far: (victim, number of episodes finished at that time).
        stretches: number of calls of the script for this test.
    """

    begun: dict[str, Any]
    kills: list[tuple[str, int]] = field(default_factory=list)
    stretches: int = 0

    @staticmethod
    def at(path: Path, begun: dict[str, Any]) -> Night:
        """Read the progress from ``path``, or begin; exit if the arguments or the program have changed since then."""
        if not path.exists():
            return Night(begun)
        kept = json.loads(path.read_text())
        if kept["begun"] != begun:
            raise SystemExit(f"{path} was begun with {kept['begun']}, not with {begun}: choose another --out")
        return Night(begun, [(str(hit), int(count)) for hit, count in kept["kills"]], int(kept["stretches"]))

    def write(self, path: Path) -> None:
        """Store the progress; if this script is killed, it loses only the kill in progress."""
        temporary = path.with_suffix(".tmp")
        temporary.write_text(json.dumps(asdict(self)))
        temporary.replace(path)


def program() -> str:
    """Return a digest of the tested program: all files of gensim2 and of its solver."""
    found = hashlib.sha256()
    for package in (Path(str(gensim2.__file__)).parent, Path(str(gensim2.__file__)).parents[1] / "gensim2_kpam"):
        for path in sorted(path for path in package.rglob("*") if path.is_file() and path.suffix != ".pyc"):
            found.update(str(path.relative_to(package)).encode() + path.read_bytes())
    return found.hexdigest()[:16]


def finished(out: Path) -> int:
    """Return the number of finished episodes, counted by file names, because this function is called often."""
    folders = [folder for kept in ("episodes", "failures") for folder in out.glob(f"*/{kept}")]
    return sum(1 for folder in folders for each in os.scandir(folder) if each.name[:1].isdigit())


def undisturbed(line: list[str], out: Path, until: float) -> bool:
    """Collect without disturbance until the time ``until``, print the cost, and return whether the run is complete."""
    told, log = out.with_suffix(".json"), out.with_suffix(".log")
    before = finished(out)
    watched = collection.watch([*line, "--json", str(told)], log, until - time.monotonic())
    if watched.code not in (0, 143):
        raise SystemExit(log.read_text()[-2000:])
    ran = finished(out) - before
    print(
        f"undisturbed: {ran} episodes in {watched.seconds:.0f} s: {ran / watched.seconds:.2f} per second\n  {watched}"
    )
    if watched.code != 0:
        return False
    result = json.loads(told.read_text())
    print(f"undisturbed: {result['episodes']} episodes of {len(result['tasks'])} tasks, {result['held']} held")
    if result["episodes_run"]:
        print(
            f"  {result['cpu_s'] / result['episodes_run']:.3f} s of CPU for each of the last {result['episodes_run']}"
        )
    for pattern in ("*/episodes/*.h5", "*/failures/*.h5", "*/episodes.jsonl"):
        files, total = collection.size(out, pattern)
        print(f"  {pattern}: {files} files, {total / 1e6:.1f} MB", flush=True)
    return True


def killed(line: list[str], out: Path, plan: list[Kill], night: Night, kept: Path, until: float) -> bool:
    """Collect with the planned kills until the time ``until``, and return whether the run is complete."""
    while time.monotonic() < until:
        process = kill_runs.start(line, out.with_suffix(".log"))
        try:
            for kill in plan[len(night.kills) :]:
                if not _moment(process, kill, out, until):
                    break
                hit, count = _strike(process, kill), finished(out)
                if hit is None:
                    break
                night.kills.append((hit, count))
                night.write(kept)
                if hit.startswith("driver"):
                    break
            code = _ended(process, until)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        if code not in (0, 3, 143, -signal.SIGKILL, -signal.SIGTERM):
            raise SystemExit(f"ended with {code}:\n{out.with_suffix('.log').read_text()[-2000:]}")
        if code == 0:
            return True
    return False


def _moment(process: subprocess.Popen[bytes], kill: Kill, out: Path, until: float) -> bool:
    """Wait until a kill is due; return False if the run or the time ``until`` comes first."""
    begin = time.monotonic()
    while process.poll() is None and time.monotonic() < until:
        if time.monotonic() - begin >= kill.delay or finished(out) >= kill.after:
            return True
        time.sleep(0.2)
    return False


def _strike(process: subprocess.Popen[bytes], kill: Kill) -> str | None:
    """Kill the planned victim, or the driver if the victim is not found in time.

    Return the process that was killed; None if the run has ended.
    """
    begin = time.monotonic()
    while process.poll() is None:
        victim = kill.victim if time.monotonic() - begin < NO_VICTIM_SECONDS else "driver SIGKILL"
        if kill_runs.kill(process, victim, random.Random(kill.after)):
            return victim
        time.sleep(0.1)
    return None


def _ended(process: subprocess.Popen[bytes], until: float) -> int:
    """Wait for the end of a run, stop it at the time ``until``, and return its exit code."""
    try:
        return process.wait(timeout=max(0.0, until - time.monotonic()))
    except subprocess.TimeoutExpired:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGTERM)
        return process.wait(timeout=kill_runs.LIFE_LIMIT)


def differing(ours: Path, theirs: Path) -> tuple[int, list[str]]:
    """Compare two data sets file by file; return the number of files, and the names of the files that differ."""
    left, right = (dict(_digests(folder)) for folder in (ours, theirs))
    return len(left), list(kill_runs.differences(left, right))


def _digests(folder: Path) -> Iterator[tuple[str, str]]:
    for path in folder.rglob("*"):
        name = str(path.relative_to(folder))
        if path.is_file() and name not in kill_runs.VOLATILE and name != "run.json":
            yield name, hashlib.sha256(path.read_bytes()).hexdigest()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=417, help="number of episodes of each task")
    parser.add_argument("--tasks", type=int, default=24, help="number of tasks")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="seed of the kills")
    parser.add_argument("--world", choices=("simulator", "fake"), default="simulator")
    parser.add_argument("--at-once", action="store_true", help="run both collections at the same time")
    parser.add_argument(
        "--hours", type=float, default=math.inf, help="hours after which the script stops; the same command continues"
    )
    parser.add_argument("--out", type=Path, help="folder for the data sets; default: a temporary folder")
    options = parser.parse_args()
    until = time.monotonic() + 3600 * options.hours
    single = collection.single_step_tasks()[: options.tasks]
    words = ("collect", *single, "--workers", str(options.workers))
    command = kill_runs.Command("collect", words, options.episodes, (), None)
    begun = {name: vars(options)[name] for name in ("episodes", "tasks", "kills", "seed", "world")}
    total = options.episodes * len(single)
    plan = planned(options.kills, total, options.seed)
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        kept = folder / "night.json"
        night = Night.at(kept, {**begun, "program": program()})
        night.stretches += 1
        night.write(kept)
        ours, theirs = folder / "undisturbed", folder / "killed"
        lines = [command.line(out, options.world, resume=True) for out in (ours, theirs)]
        with ThreadPoolExecutor() as threads:
            first = threads.submit(undisturbed, lines[0], ours, until)
            if not options.at_once:
                first.result()
            over = killed(lines[1], theirs, plan, night, kept, until) and first.result()
        hit = Counter(victim for victim, _ in night.kills)
        print(f"killed: {len(night.kills)} of {options.kills} kills {dict(hit)}, call {night.stretches}")
        if not over:
            counts = f"{finished(ours)} and {finished(theirs)} of {total}"
            print(f"not complete: {counts} episodes; repeat the command to continue")
            return NOT_OVER
        quarters = [sum(4 * count // total == quarter for _, count in night.kills) for quarter in range(4)]
        print(f"  {quarters} kills in the quarters of the run, by finished episodes")
        count, names = differing(ours, theirs)
    for name in names:
        print(f"differs: {name}")
    print(f"{len(names)} of {count} files differ")
    return 1 if names or len(night.kills) < options.kills else 0


if __name__ == "__main__":
    sys.exit(main())
