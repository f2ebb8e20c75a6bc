"""Kill renderings, exports and imports, fill their disk, run two at once, and remove things that usually exist.

    python tests/kill/transfers.py                              # the simulator: 40 kills, every disk, every pair
    python tests/kill/transfers.py --only kills --trials 100

Run again, each must give the same bytes as an undisturbed one; a refusal must be one line and leave no files. Ends with
1 otherwise. Needs permission to mount file systems in its own name space (``unshare --mount``), and ``faketime`` for
the clock.

    kills         SIGKILL to the command or one of its processes, at any moment
    disks         a full disk for several shares of the needed size; a read-only disk
    writers       two commands at once to the same name
    mixed         two different commands at once to the same name
    surroundings  no ``/dev/shm``; a clock that is set back by 400 days
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import kill_runs

FORMATS = ("maniskill", "zarr", "lerobot")
COLLECT = ("collect", "OpenDrawer", "CloseBox", "--seed", "3", "--assets", "builtin")
RENDER = ("--modalities", "pointcloud,depth", "--points", "64", "--cameras", "left", "--workers", "2")
RUN_FILES = {".lock", "report.html", "errors.log", "run.json"}
"""Files that contain times and durations."""

MIXED = (
    ("export zarr", "export lerobot"),
    ("export maniskill", "export zarr"),
    ("import zarr", "import lerobot"),
    ("import maniskill", "import zarr"),
    ("collect", "import lerobot"),
    ("collect", "export maniskill"),
)
"""Pairs of commands that write to the same name at once; either may start first."""

SHARES = (0.0, 0.1, 0.5, 0.95)
"""Sizes of the full disk as shares of the needed size."""

LIMIT = 600.0
"""Seconds after which a command counts as hung."""


def tree(folder: Path) -> dict[str, str]:
    """Return a digest of each file, by its path."""
    paths = (path for path in folder.rglob("*") if path.is_file() and path.name not in RUN_FILES)
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


@dataclass(frozen=True)
class Operation:
    """A command that writes a folder.

    Attributes:
        words: its arguments except the folder, which comes last.
        on: folder that is copied there first and continued with ``--resume``.
    """

    name: str
    words: tuple[str, ...]
    on: Path | None = None

    def line(self, out: Path, world: str, again: bool = False) -> list[str]:
        """Return the command line that writes ``out``."""
        more = ["--resume"] if again and self.on is not None else []
        words = ["render", str(out), *self.words] if self.on is not None else [*self.words, "--out", str(out)]
        return [sys.executable, kill_runs.__file__, "--child", world, *words, *more]


@dataclass
class Bench:
    """Operations and their undisturbed results."""

    folder: Path
    world: str
    collection: Operation
    operations: list[Operation] = field(default_factory=list)
    expected: dict[str, dict[str, str]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)
    tally: Counter[str] = field(default_factory=Counter)

    def add(self, operation: Operation) -> Path:
        """Run an operation undisturbed; return its folder."""
        out = self.folder / operation.name.replace(" ", "-")
        self.begin(operation, out)
        began = time.monotonic()
        code, said = self.run(operation, out)
        if code != 0:
            raise SystemExit(f"{operation.name} ended with {code}: {said}")
        self.seconds[operation.name] = time.monotonic() - began
        self.operations.append(operation)
        self.expected[operation.name] = tree(out)
        return out

    def begin(self, operation: Operation, out: Path) -> None:
        """Prepare the files that must exist before it starts."""
        if operation.on is not None:
            shutil.copytree(operation.on, out)

    def run(
        self, operation: Operation, out: Path, again: bool = False, prefix: tuple[str, ...] = ()
    ) -> tuple[int, list[str]]:
        """Run it to its end; return exit code and lines of standard error."""
        line = [*prefix, *operation.line(out, self.world, again)]
        environment = kill_runs.SCRIPT_ENVIRONMENT
        done = subprocess.run(line, capture_output=True, text=True, env=environment, timeout=LIMIT, check=False)
        return done.returncode, done.stderr.splitlines()

    def check(self, where: str, operation: Operation, out: Path) -> None:
        """Compare the result with the undisturbed one, and look for leftovers beside it."""
        names = list(kill_runs.differences(self.expected[operation.name], tree(out)))
        self.wrong += [f"{where}: {name} differs" for name in names]
        left = [path.name for path in out.parent.glob(f".{out.name}*")]
        left += [path.name for path in out.rglob(".*.tmp*")]
        self.wrong += [f"{where}: {name} is left" for name in left]

    def refused(self, where: str, code: int, said: list[str]) -> None:
        """Check that a refusal is one line with exit code 2."""
        ours = [line for line in said if line.startswith("gensim2:")]
        if code != 2 or len(ours) != 1 or any("Traceback" in line for line in said):
            self.wrong.append(f"{where}: ended with {code}: {said[-3:]}")


def prepared(folder: Path, world: str, episodes: int) -> Bench:
    """Make a data set, its rendering (if it has states), its exports and their imports."""
    bench = Bench(folder, world, Operation("collect", (*COLLECT, "--episodes", str(episodes), "--workers", "2")))
    bench.add(bench.collection)
    source = folder / "collect"
    if world == "simulator":
        source = bench.add(Operation("render", RENDER, on=source))
    for to in FORMATS:
        export = bench.add(Operation(f"export {to}", ("data", "export", str(source), "--to", to)))
        bench.add(Operation(f"import {to}", ("data", "import", str(export), "--from", to)))
    bench.operations = list(operations(folder, world))  # kill_runs.py kills collections
    return bench


def descendants(pid: int) -> list[int]:
    """Return all processes below a process."""
    return [each for child in kill_runs.children(pid) for each in (child, *descendants(child))]


def kills(bench: Bench, trials: int, seed: int) -> None:
    """Kill the command or one of its processes at any moment; run it again."""
    dice = random.Random(seed)
    for number in range(trials):
        operation = bench.operations[number % len(bench.operations)]
        out = bench.folder / f"killed-{number}"
        bench.begin(operation, out)
        process = kill_runs.start(operation.line(out, bench.world), out.with_suffix(".log"))
        time.sleep(dice.uniform(0.0, 1.1 * bench.seconds[operation.name]))
        below = descendants(process.pid)
        victim = dice.choice(below) if below and dice.random() < 0.3 else process.pid
        try:
            os.kill(victim, 9)
            bench.tally["the command" if victim == process.pid else "a process of its"] += 1
        except ProcessLookupError:
            bench.tally["over already"] += 1
        code = process.wait(LIMIT)
        where = f"{operation.name} {number}"
        end = time.monotonic() + 30
        while any(Path(f"/proc/{pid}/fd").exists() for pid in below) and time.monotonic() < end:
            time.sleep(0.05)
        if left := [pid for pid in below if Path(f"/proc/{pid}").exists() and kill_runs.command_line(pid)]:
            bench.wrong.append(f"{where}: processes {left} are left")
        if code not in (0, -9):
            said = out.with_suffix(".log").read_text().splitlines()
            if code == 3:
                bench.tally["ended with 3"] += 1
            else:
                bench.refused(where, code, said)
        if operation.on is not None or not out.exists():
            code, said = bench.run(operation, out, again=True)
            if code != 0:
                bench.wrong.append(f"{where}, again: ended with {code}: {said[-3:]}")
        bench.check(where, operation, out)
        shutil.rmtree(out, ignore_errors=True)


def disks(bench: Bench, shares: tuple[float, ...] = SHARES) -> None:
    """Try full disks, which are then enlarged, and a read-only disk."""
    for operation in bench.operations:
        size = sum(path.stat().st_size for path in bench.folder.joinpath(operation.name.replace(" ", "-")).rglob("*"))
        begun = 0 if operation.on is None else sum(p.stat().st_size for p in operation.on.rglob("*"))
        for share in (*shares, None):
            mounted = Path(tempfile.mkdtemp(dir=bench.folder))
            # A size of 0 would mean half of the memory, and a small file needs a page.
            room = None if share is None else int(2 * begun + share * (2 * size - 2 * begun)) + 2**15
            words = [str(bench.folder), bench.world, operation.name, str(mounted), "ro" if room is None else str(room)]
            script = [sys.executable, __file__, "--inside", *words]
            done = subprocess.run(
                ["unshare", "--mount", *script], capture_output=True, text=True, timeout=LIMIT, check=False
            )
            mounted.rmdir()
            bench.tally[done.stdout.strip() or "broken"] += 1
            bench.wrong += [f"{operation.name}, room {room}: {line}" for line in done.stderr.splitlines()]


def inside(folder: Path, world: str, name: str, mounted: Path, room: str) -> None:
    """In its own name space: fill the disk, check, enlarge it, run again."""

    def mount(*options: str) -> None:
        subprocess.run(["mount", "-t", "tmpfs", "-o", ",".join(options), "none", str(mounted)], check=True)

    bench = Bench(folder, world, Operation("collect", COLLECT))
    operation = next(each for each in operations(folder, world) if each.name == name)
    bench.expected[name] = tree(folder / name.replace(" ", "-"))
    out = mounted / "out"
    mount("size=1g" if room == "ro" else f"size={room}")
    bench.begin(operation, out)
    before = tree(mounted)
    if room == "ro":
        subprocess.run(["mount", "-o", "remount,ro", str(mounted)], check=True)
    code, said = bench.run(operation, out)
    if code != 0:
        bench.refused("full", code, said)
        kept = tree(mounted)
        bench.wrong += [f"{path} was changed" for path, digest in before.items() if kept.get(path) != digest]
        if operation.on is None and list(mounted.iterdir()):
            bench.wrong.append(f"left {[path.name for path in mounted.iterdir()]}")
        subprocess.run(["mount", "-o", "remount,rw,size=1g", str(mounted)], check=True)
        again, said = bench.run(operation, out, again=True)
        if again != 0:
            bench.wrong.append(f"again: ended with {again}: {said[-3:]}")
    bench.check("then", operation, out)
    print("fitted" if code == 0 else "read-only" if room == "ro" else "full")
    for line in bench.wrong:
        print(line, file=sys.stderr)


def operations(folder: Path, world: str) -> Iterator[Operation]:
    """Return the operations of :func:`prepared`, once their folders exist."""
    source = folder / "collect"
    if world == "simulator":
        yield Operation("render", RENDER, on=source)
        source = folder / "render"
    for to in FORMATS:
        yield Operation(f"export {to}", ("data", "export", str(source), "--to", to))
        yield Operation(f"import {to}", ("data", "import", str(folder / f"export-{to}"), "--from", to))


def writers(bench: Bench, seed: int) -> None:
    """Run two at once, the second a little later: one succeeds, the other is refused, and the result is complete."""
    dice = random.Random(seed)
    for operation in (bench.collection, *bench.operations):
        for number in range(2):
            out = bench.folder / f"two-{operation.name.replace(' ', '-')}-{number}"
            bench.begin(operation, out)
            logs = [out.with_suffix(f".{each}") for each in "ab"]
            both = []
            for log in logs:
                both.append(kill_runs.start(operation.line(out, bench.world), log))
                time.sleep(dice.uniform(0.0, 0.3 * bench.seconds[operation.name]))
            codes = [process.wait(LIMIT) for process in both]
            where = f"two writers, {operation.name} {number}"
            if sorted(codes) != [0, 2]:
                bench.wrong.append(f"{where}: ended with {codes}")
            for code, log in zip(codes, logs, strict=True):
                if code != 0:
                    said = log.read_text().splitlines()
                    bench.refused(where, code, said)
                    bench.tally[said[-1].rpartition(": ")[2]] += 1
            bench.check(where, operation, out)
            shutil.rmtree(out, ignore_errors=True)


def mixed_writers(bench: Bench, seed: int) -> None:
    """Run two different commands at once to the same name: the result is complete and equals that of one of them."""
    dice = random.Random(seed)
    by_name = {operation.name: operation for operation in bench.operations} | {"collect": bench.collection}
    for pair in MIXED:
        for first, second in (pair, pair[::-1]):
            out = bench.folder / f"mixed-{first}-{second}".replace(" ", "-")
            both = []
            for name in (first, second):
                log = out.with_suffix(f".{len(both)}")
                both.append((name, kill_runs.start(by_name[name].line(out, bench.world), log), log))
                time.sleep(dice.uniform(0.0, 0.5 * bench.seconds[name]))
            where = f"{first} beside {second}"
            codes = {name: process.wait(LIMIT) for name, process, _ in both}
            done = [name for name, code in codes.items() if code == 0]
            if len(done) != 1:
                bench.wrong.append(f"{where}: ended with {codes}")
            for name, _, log in both:
                if codes[name] != 0:
                    said = log.read_text().splitlines()
                    bench.refused(where, codes[name], said)
                    bench.tally[said[-1].rpartition(": ")[2]] += 1
            if done:
                bench.check(where, by_name[done[0]], out)
            shutil.rmtree(out, ignore_errors=True)


def surroundings(bench: Bench) -> None:
    """Run commands in an unusual environment."""
    ways: dict[str, tuple[str, ...]] = {
        "no /dev/shm": ("unshare", "--mount", "sh", "-c", 'mount -t tmpfs -o ro none /dev/shm && exec "$@"', "sh")
    }
    if shutil.which("faketime"):
        ways["a clock set back"] = ("faketime", "-f", "-400d")
    for what, prefix in ways.items():
        for operation in bench.operations:
            out = bench.folder / f"{what.replace(' ', '-').replace('/', '')}-{operation.name.replace(' ', '-')}"
            bench.begin(operation, out)
            code, said = bench.run(operation, out, prefix=prefix)
            if code != 0:
                bench.wrong.append(f"{what}, {operation.name}: ended with {code}: {said[-3:]}")
            bench.check(f"{what}, {operation.name}", operation, out)
            bench.tally[what] += 1
            shutil.rmtree(out, ignore_errors=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=40, help="kills")
    parser.add_argument("--episodes", type=int, default=4, help="of each task")
    parser.add_argument("--world", choices=("simulator", "fake"), default="simulator")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=("kills", "disks", "writers", "mixed", "surroundings"))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        bench = prepared(Path(name).resolve(), options.world, options.episodes)
        print({name: round(seconds, 1) for name, seconds in bench.seconds.items()}, flush=True)
        parts: dict[str, Callable[[], None]] = {
            "kills": lambda: kills(bench, options.trials, options.seed),
            "disks": lambda: disks(bench),
            "writers": lambda: writers(bench, options.seed),
            "mixed": lambda: mixed_writers(bench, options.seed),
            "surroundings": lambda: surroundings(bench),
        }
        for part in options.only or parts:
            began = time.monotonic()
            bench.tally.clear()
            parts[part]()
            print(
                f"{part}: {dict(bench.tally)}, {len(bench.wrong)} wrong, {time.monotonic() - began:.0f} s", flush=True
            )
    for line in bench.wrong:
        print(line)
    return 1 if bench.wrong else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--inside"]:
        inside(Path(sys.argv[2]), sys.argv[3], sys.argv[4], Path(sys.argv[5]), sys.argv[6])
    else:
        sys.exit(main())
