"""Kill runs at random moments, resume them, and compare the results with an undisturbed run, byte for byte.

    python tests/kill/kill_runs.py --kills 100                # the simulator, half an hour
    python tests/kill/kill_runs.py --kills 10 --world fake    # the same runs in a fake world, a minute

Drivers are killed by SIGKILL and SIGTERM, single workers by SIGKILL, mostly while episodes are collected. Ends with 1
if a file differs, or if a run ends in another way than killed, stopped (143), incomplete (3) or complete (0).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

VICTIMS = {"driver SIGKILL": 0.25, "driver SIGTERM": 0.1, "worker SIGKILL": 0.6, "fork server SIGKILL": 0.05}
"""Processes that are killed, with their frequencies."""

LIFE_LIMIT = 900.0
"""Seconds without progress after which a run counts as hung."""

MID_COLLECTION = 0.8
"""Share of kills that wait for the collection to start; the others come at any moment."""

VOLATILE = {".lock", "report.html", "errors.log"}
"""Files that contain times and durations; ``run.json`` is compared without these fields, that of a data set not at all.
"""


SCRIPT_ENVIRONMENT = {
    **os.environ,
    "GENSIM2_LIBRARY": "none",
    "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)]),
}
"""Environment of this script as a child process, whose workers import the fake world."""


@dataclass(frozen=True)
class Command:
    """A command to disturb.

    Attributes:
        name: name of the command.
        words: its arguments.
        episodes: number of episodes that it collects in the simulator.
        spared: options that leave out work.
        record: file without which there is nothing to resume; None if ``--resume`` also starts a new folder.
    """

    name: str
    words: tuple[str, ...]
    episodes: int
    spared: tuple[str, ...] = (
        "--videos",
        "0",
    )
    record: str | None = "run.json"

    def line(self, out: Path, world: str, resume: bool) -> list[str]:
        words = [*self.words, "--episodes", str(self.episodes), "--out", str(out), *self.spared, "--assets", "builtin"]
        return [sys.executable, __file__, "--child", world, *words, *(["--resume"] if resume else [])]


COMMANDS = (
    Command("demo", ("demo", "PushDrawerClose", "--workers", "2"), 30),
    Command("run-pipeline", ("run-pipeline", "--target-task", "PushDrawerClose", "--workers", "2"), 25),
    Command("benchmark", ("benchmark", "PushDrawerClose", "CloseBox", "--runs", "1", "--workers", "2"), 15, ()),
    Command("collect", ("collect", "PushDrawerClose", "CloseBox", "--seed", "3", "--workers", "2"), 15, (), None),
)


def child(world: str, arguments: list[str]) -> NoReturn:
    """Run the command line, with a short search and the selected world."""
    from gensim2.cli import main as command
    from gensim2.design import search

    small = search.Budget(
        screen_scenes=1, rounds=((4, 1),), refined=(4, 1), comparison=(1, 2), enough=0.3, enough_episodes=3
    )
    search.budget_for = lambda task: small
    if world == "fake":
        import fake_world

        fake_world.install()
    command.main(arguments)


@dataclass
class Tally:
    """Counts of kills and restarts."""

    kills: Counter[str]
    mid_collection: int = 0
    runs: int = 0

    def __str__(self) -> str:
        return (
            f"{sum(self.kills.values())} kills {dict(self.kills)} in {self.runs} runs, "
            f"{self.mid_collection} of them while collecting"
        )


class Disturbed:
    """A run that is killed again and again."""

    def __init__(self, command: Command, world: str, out: Path, dice: random.Random, tally: Tally) -> None:
        self.command, self.world, self.out, self.dice, self.tally = command, world, out, dice, tally

    def run(self, kills: int) -> int:
        """Kill the run up to ``kills`` times, let it end, and return how often it was killed."""
        done = 0
        while True:
            resume = self.command.record is None or (self.out / self.command.record).exists()
            process = start(self.command.line(self.out, self.world, resume), self.out.with_suffix(".log"))
            try:
                while done < kills and self._wait(process):
                    victim = self.dice.choices(tuple(VICTIMS), tuple(VICTIMS.values()))[0]
                    if kill(process, victim, self.dice):
                        done += 1
                        self.tally.kills[victim] += 1
                        self.tally.mid_collection += self._collecting()
                    if victim.startswith("driver"):
                        break
                code = process.wait(timeout=LIFE_LIMIT)
            finally:
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGKILL)
                    process.wait()
            if code not in (0, 3, 143, -signal.SIGKILL, -signal.SIGTERM):
                log = self.out.with_suffix(".log").read_text()
                raise SystemExit(f"{self.command.name} ended with {code}:\n{log[-2000:]}")
            if code == 0:
                return done

    def _wait(self, process: subprocess.Popen[bytes]) -> bool:
        """Wait for the next moment to kill; return False if the run ends before."""
        begin = time.monotonic()
        anywhere = self.dice.random() > MID_COLLECTION
        until = begin + self.dice.uniform(0, 3 if self.world == "fake" else 12)
        logged = self._logged()
        extra: float | None = None
        while process.poll() is None:
            now = time.monotonic()
            if anywhere and now > until:
                return True
            if not anywhere and extra is None and self._logged() > logged:
                extra = now + self.dice.uniform(0, 0.1 if self.world == "fake" else 1.0)
            if extra is not None and now > extra:
                return True
            if now > begin + LIFE_LIMIT:
                raise SystemExit(f"{self.command.name} does not go on")
            time.sleep(0.02)
        return False

    def _logged(self) -> int:
        """Return the number of finished episodes."""
        logs = sum(path.read_bytes().count(b"\n") for path in self.out.glob("*/*/attempts.jsonl"))
        files = (f"{depth}/{folder}/[0-9]*.h5" for depth in ("*", "*/*") for folder in ("episodes", "failures"))
        return logs + sum(1 for pattern in files for _ in self.out.glob(pattern))

    def _collecting(self) -> bool:
        done = ("*/*/trajectory.json", "CloseBox/episodes.jsonl")
        return self._logged() > 0 and not any(path for pattern in done for path in self.out.glob(pattern))


def kill(process: subprocess.Popen[bytes], victim: str, dice: random.Random) -> bool:
    """Kill the run or, drawn by ``dice``, one of its workers; return whether there was such a process."""
    with contextlib.suppress(ProcessLookupError):
        number = signal.SIGTERM if victim.endswith("SIGTERM") else signal.SIGKILL
        if victim.startswith("driver"):
            os.kill(process.pid, number)
            return True
        servers = [pid for pid in children(process.pid) if b"forkserver" in command_line(pid)]
        workers = [pid for server in servers for pid in children(server)]
        targets = workers if victim.startswith("worker") else servers
        if targets:
            os.kill(dice.choice(targets), number)
            return True
    return False


def start(command: list[str], log: Path) -> subprocess.Popen[bytes]:
    """Start a process in its own session, with its output in a file."""
    with log.open("ab") as stream:
        return subprocess.Popen(
            command,
            stdout=stream,
            stderr=stream,
            start_new_session=True,
            env=SCRIPT_ENVIRONMENT,
        )


def children(pid: int) -> list[int]:
    """Return the running child processes of a process."""
    with contextlib.suppress(OSError):
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return []


def command_line(pid: int) -> bytes:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


def contents(folder: Path) -> dict[str, Any]:
    """Return what a run left, by path: bytes, or the lasting part of ``run.json``."""
    found: dict[str, Any] = {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        name = str(path.relative_to(folder))
        if name not in VOLATILE:
            found[name] = path.read_bytes()
    if "dataset.json" in found:
        del found["run.json"]
        return found
    record = json.loads(found["run.json"])
    for field in ("command_line", "started", "finished", "resumed", "effort"):
        del record[field]
    for told in (record["result"], *record["result"].get("tasks", ())):
        told.pop("cpu_s", None)
        if (effort := told.get("design")) is not None:
            del effort["cpu_s"]
    record["result"].pop("episodes_per_second", None)
    del record["result"]["run_dir"]
    found["run.json"] = record
    return found


def differences(ours: dict[str, Any], theirs: dict[str, Any]) -> Iterator[str]:
    """Return the names of files that differ."""
    return (name for name in sorted(ours.keys() | theirs.keys()) if ours.get(name) != theirs.get(name))


def kill_runs(
    kills: int, world: str, seed: int, folder: Path, commands: Sequence[Command] = COMMANDS
) -> tuple[Tally, list[str]]:
    """Disturb runs of ``commands`` with ``kills`` kills in total.

    Returns:
        The counts, and the files that differ from those of an undisturbed run.
    """
    dice = random.Random(seed)
    tally = Tally(Counter())
    peaceful = [folder / command.name for command in commands]
    running = [
        start(command.line(out, world, resume=False), out.with_suffix(".log"))
        for command, out in zip(commands, peaceful, strict=True)
    ]
    for process, out in zip(running, peaceful, strict=True):
        if process.wait(timeout=LIFE_LIMIT) != 0:
            raise SystemExit(out.with_suffix(".log").read_text())
    undisturbed = {out.name: contents(out) for out in peaceful}
    wrong: list[str] = []
    while (left := kills - sum(tally.kills.values())) > 0:
        command = commands[tally.runs % len(commands)]
        out = folder / f"{command.name}-{tally.runs}"
        share = min(left, max(1, kills // min(3, len(commands)))) if kills <= 10 else min(left, dice.randint(6, 14))
        Disturbed(command, world, out, dice, tally).run(share)
        tally.runs += 1
        wrong += [f"{out.name}/{name}" for name in differences(undisturbed[command.name], contents(out))]
        print(
            f"{out.name}: {dict(tally.kills)}, {tally.mid_collection} while collecting, {len(wrong)} differ", flush=True
        )
    return tally, wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--world", choices=("simulator", "fake"), default="simulator")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", nargs="+", choices=[each.name for each in COMMANDS], help="default: all")
    parser.add_argument("--out", type=Path, help="keep the runs here; default: a temporary folder")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        begin = time.monotonic()
        chosen = [each for each in COMMANDS if options.commands is None or each.name in options.commands]
        tally, wrong = kill_runs(options.kills, options.world, options.seed, options.out or Path(temporary), chosen)
    print(f"{tally}, {time.monotonic() - begin:.0f} s")
    for name in wrong:
        print(f"differs: {name}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(child(sys.argv[2], sys.argv[3:]) if sys.argv[1:2] == ["--child"] else main())
