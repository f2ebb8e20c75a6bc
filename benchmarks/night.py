"""A night's collection, once undisturbed and once killed again and again: the same bytes, or it ends with 1.

    python benchmarks/night.py --out /data/night                        # 24 tasks x 417 episodes, 100 kills
    python benchmarks/night.py --episodes 20 --tasks 10 --kills 10      # 200 episodes
    python benchmarks/night.py --out /data/night --hours 2.5            # so long, then the same line goes on with it
    python benchmarks/night.py --out /data/night --at-once              # both runs at the same time

Both runs are of all tasks of the suite with one step, or the first so many of them. Kills are planned before: one in
each equal part of the run, when a certain number of episodes is finished; one of five comes sooner, a random time after
the one before, and meets starts too. They hit drivers by SIGKILL and SIGTERM, single workers, and the server that
forks them. With --out the same line goes on with what was cut short, the night itself included: ``night.json`` says how
far it is. Ends with 3 where --hours are over and the night is not.
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

import kill_runs  # isort: skip - found by collection

START_SECONDS = 15.0
"""Within which a kill comes that waits for no episode: about what a start takes."""

NO_VICTIM_SECONDS = 60.0
"""After which a kill whose worker or server is not to be found hits the driver."""

LAST = 0.98
"""Share of the episodes that are finished at the latest when a kill comes, so that there is something to hit."""

NOT_OVER = 3


@dataclass(frozen=True)
class Kill:
    """One kill: when ``after`` episodes are finished, or ``delay`` seconds after the last kill if that is sooner."""

    victim: str
    after: int
    delay: float


def planned(kills: int, episodes: int, seed: int) -> list[Kill]:
    """Return the kills of a run of ``episodes``, in order; the same for the same arguments."""
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
    """Progress of a night: what it was begun with, and the kills so far as (what was hit, episodes finished then)."""

    begun: dict[str, Any]
    kills: list[tuple[str, int]] = field(default_factory=list)
    stretches: int = 0

    @staticmethod
    def at(path: Path, begun: dict[str, Any]) -> Night:
        """Read ``path``, or begin; a night of other words or another program is not gone on with."""
        if not path.exists():
            return Night(begun)
        kept = json.loads(path.read_text())
        if kept["begun"] != begun:
            raise SystemExit(f"{path} was begun with {kept['begun']}, not {begun}: choose another --out")
        return Night(begun, [(str(hit), int(count)) for hit, count in kept["kills"]], int(kept["stretches"]))

    def write(self, path: Path) -> None:
        """Keep it: a night that is itself killed loses nothing but the kill under way."""
        temporary = path.with_suffix(".tmp")
        temporary.write_text(json.dumps(asdict(self)))
        temporary.replace(path)


def program() -> str:
    """Return a digest of the package that collects, solver included."""
    found = hashlib.sha256()
    for package in (Path(str(gensim2.__file__)).parent, Path(str(gensim2.__file__)).parents[1] / "gensim2_kpam"):
        for path in sorted(path for path in package.rglob("*") if path.is_file() and path.suffix != ".pyc"):
            found.update(str(path.relative_to(package)).encode() + path.read_bytes())
    return found.hexdigest()[:16]


def finished(out: Path) -> int:
    """Count episodes that are finished; quickly, for it is asked all the time."""
    folders = [folder for kept in ("episodes", "failures") for folder in out.glob(f"*/{kept}")]
    return sum(1 for folder in folders for each in os.scandir(folder) if each.name[:1].isdigit())


def undisturbed(line: list[str], out: Path, until: float) -> bool:
    """Collect without disturbance until then, and say what it took; whether it is over."""
    told, log = out.with_suffix(".json"), out.with_suffix(".log")
    before = finished(out)
    watched = collection.watch([*line, "--json", str(told)], log, until - time.monotonic())
    if watched.code not in (0, 143):
        raise SystemExit(log.read_text()[-2000:])
    ran = finished(out) - before
    print(f"undisturbed: {ran} episodes in {watched.seconds:.0f} s: {ran / watched.seconds:.2f} a second\n  {watched}")
    if watched.code != 0:
        return False
    result = json.loads(told.read_text())
    print(f"undisturbed: {result['episodes']} episodes of {len(result['tasks'])} tasks, {result['held']} held")
    if result["episodes_run"]:
        print(f"  {result['cpu_s'] / result['episodes_run']:.3f} s of CPU each of the last {result['episodes_run']}")
    for pattern in ("*/episodes/*.h5", "*/failures/*.h5", "*/episodes.jsonl"):
        files, total = collection.size(out, pattern)
        print(f"  {pattern}: {files} files, {total / 1e6:.1f} MB", flush=True)
    return True


def killed(line: list[str], out: Path, plan: list[Kill], night: Night, kept: Path, until: float) -> bool:
    """Collect with the kills that are planned until then; whether it is over."""
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
    """Wait for the moment of a kill; False where the run or the stretch ends before."""
    begin = time.monotonic()
    while process.poll() is None and time.monotonic() < until:
        if time.monotonic() - begin >= kill.delay or finished(out) >= kill.after:
            return True
        time.sleep(0.2)
    return False


def _strike(process: subprocess.Popen[bytes], kill: Kill) -> str | None:
    """Kill what is planned, or the driver where that is not found for long; what was hit, None where nothing runs."""
    begin = time.monotonic()
    while process.poll() is None:
        victim = kill.victim if time.monotonic() - begin < NO_VICTIM_SECONDS else "driver SIGKILL"
        if kill_runs.kill(process, victim, random.Random(kill.after)):
            return victim
        time.sleep(0.1)
    return None


def _ended(process: subprocess.Popen[bytes], until: float) -> int:
    """Wait for the end of a run, stopping it when the stretch is over."""
    try:
        return process.wait(timeout=max(0.0, until - time.monotonic()))
    except subprocess.TimeoutExpired:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGTERM)
        return process.wait(timeout=kill_runs.LIFE_LIMIT)


def differing(ours: Path, theirs: Path) -> tuple[int, list[str]]:
    """Compare two data sets file by file: how many there are, and the names of those that differ."""
    left, right = (dict(_digests(folder)) for folder in (ours, theirs))
    return len(left), list(kill_runs.differences(left, right))


def _digests(folder: Path) -> Iterator[tuple[str, str]]:
    for path in folder.rglob("*"):
        name = str(path.relative_to(folder))
        if path.is_file() and name not in kill_runs.VOLATILE and name != "run.json":
            yield name, hashlib.sha256(path.read_bytes()).hexdigest()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=417, help="of each task")
    parser.add_argument("--tasks", type=int, default=24, help="how many tasks")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="of the kills")
    parser.add_argument("--world", choices=("simulator", "fake"), default="simulator")
    parser.add_argument("--at-once", action="store_true", help="let both runs go at the same time")
    parser.add_argument("--hours", type=float, default=math.inf, help="after which it stops, to be gone on with")
    parser.add_argument("--out", type=Path, help="keep the data sets here; default: a temporary folder")
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
        print(f"killed: {len(night.kills)} of {options.kills} kills {dict(hit)}, stretch {night.stretches}")
        if not over:
            print(f"not over: {finished(ours)} and {finished(theirs)} of {total} episodes; the same line goes on")
            return NOT_OVER
        quarters = [sum(4 * count // total == quarter for _, count in night.kills) for quarter in range(4)]
        print(f"  {quarters} in the quarters of the run, by what was finished")
        count, names = differing(ours, theirs)
    for name in names:
        print(f"differs: {name}")
    print(f"{len(names)} of {count} files differ")
    return 1 if names or len(night.kills) < options.kills else 0


if __name__ == "__main__":
    sys.exit(main())
