"""Measure ``gensim2 collect``: episodes per second with one and two workers, memory of all processes, size on disk.

    python benchmarks/collection.py                        # 10 tasks of one step x 20 episodes
    python benchmarks/collection.py OpenBox OpenSafe --episodes 100 --workers 1 2
    python benchmarks/collection.py --single-step --episodes 40 --workers 1 2 1 2

The script prints two rates in episodes per second: of the complete command, and between the first and the last
finished episode, which excludes the import of the simulator. Other processes on the machine change these rates, but not
the CPU time per episode. The script samples the resident memory every 0.5 s. The peak in each quarter of a run shows
whether the memory grows.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import signal
import statistics
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

from gensim2.tasks.library import load_task, task_names

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "kill"))

import kill_runs

TASKS = (
    "CloseBox",
    "CloseLaptop",
    "CloseMicrowave",
    "CloseSafe",
    "OpenBox",
    "OpenDrawer",
    "OpenSafe",
    "PushDrawerClose",
    "PushToasterForward",
    "TurnOnFaucet",
)

SAMPLE_SECONDS = 0.5


@dataclass
class Watched:
    """Exit code, duration and memory of a run.

    Attributes:
        code: exit code.
        seconds: wall time, s.
        samples: (seconds, MB of the driver, MB of the largest worker).
    """

    code: int
    seconds: float
    samples: list[tuple[float, float, float]] = field(repr=False)

    def quarters(self) -> list[tuple[float, float]]:
        """Return the peak memory of the driver and of the largest worker in each quarter of the run, MB."""
        found = []
        for quarter in range(4):
            low, high = quarter * self.seconds / 4, (quarter + 1) * self.seconds / 4
            inside = [sample for sample in self.samples if low <= sample[0] < high] or [(0.0, 0.0, 0.0)]
            found.append((max(sample[1] for sample in inside), max(sample[2] for sample in inside)))
        return found

    def __str__(self) -> str:
        drivers, workers = zip(*self.quarters(), strict=True)
        return f"driver {_row(drivers)} MB, largest worker {_row(workers)} MB (peak in each quarter)"


def watch(command: list[str], log: Path, limit: float = math.inf) -> Watched:
    """Run a command and sample the memory of its processes; stop it by SIGTERM after ``limit`` seconds."""
    begin = time.monotonic()
    process = kill_runs.start(command, log)
    samples = []
    stopped = False
    try:
        while process.poll() is None:
            if not stopped and time.monotonic() - begin > limit:
                process.terminate()
                stopped = True
            workers = [resident(pid) for pid in descendants(process.pid)]
            samples.append((time.monotonic() - begin, resident(process.pid), max(workers, default=0.0)))
            time.sleep(SAMPLE_SECONDS)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    return Watched(process.wait(), time.monotonic() - begin, samples)


def descendants(pid: int) -> list[int]:
    """Return all descendants of a process."""
    return [each for child in kill_runs.children(pid) for each in (child, *descendants(child))]


def resident(pid: int) -> float:
    """Return the memory of a process, MB; 0 if it has ended."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except (OSError, IndexError):
        return 0.0


def size(folder: Path, pattern: str) -> tuple[int, int]:
    """Return the number and the total size (bytes) of files."""
    sizes = [path.stat().st_size for path in folder.glob(pattern)]
    return len(sizes), sum(sizes)


def steady_rate(folder: Path) -> float:
    """Return the episodes per second between the first and the last finished episode, from the times of their files."""
    times = sorted(path.stat().st_mtime for kept in ("episodes", "failures") for path in folder.glob(f"*/{kept}/*.h5"))
    return (len(times) - 1) / (times[-1] - times[0])


def single_step_tasks() -> list[str]:
    """Return the single-step tasks of the paper's suite."""
    return [name for name in task_names("paper") if load_task(name).is_single_step]


def _row(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.0f}" for value in values)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", default=TASKS)
    parser.add_argument("--single-step", action="store_true", help="use all single-step tasks of the paper's suite")
    parser.add_argument("--episodes", type=int, default=20, help="number of episodes of each task")
    parser.add_argument(
        "--workers",
        type=int,
        nargs="+",
        default=[1, 2],
        help="numbers of workers to measure, in this order; a number can be repeated",
    )
    parser.add_argument("--assets", default="builtin")
    parser.add_argument("--out", type=Path, help="folder for the data sets; default: a temporary folder")
    options = parser.parse_args()
    if options.single_step:
        options.tasks = single_step_tasks()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        rates: dict[int, list[tuple[float, float]]] = defaultdict(list)
        for workers in options.workers:
            out = folder / f"workers-{workers}"
            shutil.rmtree(out, ignore_errors=True)
            rates[workers].append(_collect(out, workers, options))
    means = {workers: [statistics.mean(each) for each in zip(*found, strict=True)] for workers, found in rates.items()}
    first = options.workers[0]
    for workers, (whole, steady) in list(means.items())[1:]:
        print(
            f"{workers} workers: {whole / means[first][0]:.2f} times the speed of {first}, "
            f"{steady / means[first][1]:.2f} from the first episode to the last"
        )
    return 0


def _collect(out: Path, workers: int, options: argparse.Namespace) -> tuple[float, float]:
    """Collect, print the measurements, and return episodes per second: of the complete run, and from first to last."""
    told, log = out.with_suffix(".json"), out.with_suffix(".log")
    words = ["collect", *options.tasks, "--episodes", str(options.episodes), "--workers", str(workers)]
    words += ["--assets", options.assets, "--out", str(out), "--json", str(told)]
    watched = watch([sys.executable, "-m", "gensim2", *words], log)
    if watched.code != 0:
        raise SystemExit(log.read_text()[-2000:])
    result = json.loads(told.read_text())
    count, steady = result["episodes"], steady_rate(out)
    rate = count / watched.seconds
    print(
        f"{workers} workers: {count} episodes in {watched.seconds:.0f} s, {rate:.2f} a second, {steady:.2f} from the "
        f"first to the last, {result['cpu_s'] / count:.3f} s of CPU each, {result['held']} held"
    )
    print(f"  {watched}")
    for pattern, what in (("*/episodes/*.h5", "held"), ("*/failures/*.h5", "failed"), ("*/episodes.jsonl", "rows")):
        files, total = size(out, pattern)
        print(f"  {what}: {files} files, {total / 1e6:.2f} MB, {total / max(files, 1) / 1e3:.1f} kB each", flush=True)
    return rate, steady


if __name__ == "__main__":
    sys.exit(main())
