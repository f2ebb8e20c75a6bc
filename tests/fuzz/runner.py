"""Try numbered inputs, count how they ended, and provide the command line of the damaging scripts."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gensim2.core.foreign.process import Bounds

SAID = 1000
"""Inputs after which the count of faults is said."""
CPU_S = 5
MEMORY = 2**30
HANGS = 60.0
"""Seconds by the clock: other work may hold the machine up; what waits for ever waits longer."""
CANARY = "from pathlib import Path\nPath(__file__).with_name('ran').touch()\nclass Policy: pass\nrobot = Policy\n"

Say = Callable[[str], object]


@dataclass(frozen=True)
class Ended:
    """How an input ended, the CPU seconds of its reader, and its highest memory in bytes."""

    outcome: str
    seconds: float = 0.0
    memory: int = 0


@dataclass
class Tally:
    """Number of inputs by outcome, and the largest CPU time and memory, if measured."""

    ended: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0
    largest: int = 0
    faults: int = 0


Round = Callable[[range, int, Path, Say], Tally]
"""Takes the inputs' numbers, the seed, a folder to write to and a listener, and tries the inputs."""


def tried(numbers: Iterable[int], attempt: Callable[[int], Ended], say: Say) -> Tally:
    """Try each input; report and count failures."""
    tally = Tally()
    for count, number in enumerate(numbers, 1):
        try:
            found = attempt(number)
        except Exception as error:  # noqa: BLE001 - other exceptions are the bugs to be found
            tally.faults += 1
            say(f"{number}: {type(error).__name__}: {str(error)[-1500:]}")
        else:
            tally.ended[found.outcome] += 1
            tally.slowest, tally.largest = max(tally.slowest, found.seconds), max(tally.largest, found.memory)
        if count % SAID == 0:
            say(f"{count} tried, {tally.faults} faults")
    return tally


def in_process(attempt: Callable[[], str], folder: Path) -> tuple[str, float, int]:
    """Return how an attempt ended in a forked process of bounded means, its CPU seconds and its highest memory.

    Raises:
        AssertionError: it failed, hung, printed, wrote a file or ran what lies in the folder.
    """
    read, write = os.pipe()
    printed = folder.with_suffix(".err")
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            os.close(read)
            os.chdir(folder)
            sys.path.insert(0, str(folder))
            descriptor = os.open(printed, os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
            os.dup2(descriptor, 1)
            os.dup2(descriptor, 2)
            sys.stdout = sys.stderr = os.fdopen(2, "w", buffering=1, closefd=False)
            sys.excepthook = sys.__excepthook__
            threading.excepthook = threading.__excepthook__
            Bounds(MEMORY, CPU_S, (2**20, 2**20)).apply()
            Path("/proc/self/clear_refs").write_text("5")
            outcome = attempt()
            report = Path("/proc/self/status").read_text()
            peak = next(int(line.split()[1]) for line in report.splitlines() if line.startswith("VmHWM"))
            os.write(write, f"{outcome} {time.process_time()} {1024 * peak}".encode())
            code = 0
        except BaseException:  # noqa: BLE001 - told, and the process ends
            os.write(write, traceback.format_exc()[-3000:].encode("utf-8", "replace"))
        finally:
            os._exit(code)
    os.close(write)
    end, ended = time.monotonic() + HANGS, 0
    try:
        while not ended and time.monotonic() < end:
            ended, status = os.waitpid(pid, os.WNOHANG)
            time.sleep(0.0 if ended else 0.002)
        assert ended, f"hung for {HANGS:.0f} s"
    finally:
        if not ended:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
        told = os.read(read, 4096).decode()
        os.close(read)
    assert status == 0, f"status {status}: {told}"
    text = printed.read_text(errors="replace")
    assert not text, f"printed: {text[-1500:]}"
    left = sorted(path.name for path in folder.iterdir())
    assert left == ["canary.py"], f"wrote {left}"
    outcome, seconds, peak = told.split()
    return outcome, float(seconds), int(peak)


def main(
    about: str,
    counts: Mapping[str, int],
    prepare: Callable[[Path], Mapping[str, Sequence[Round]]],
    arguments: Sequence[str] | None = None,
) -> int:
    """Run a command line; return 1 if an input is neither accepted correctly nor refused in one line.

    Args:
        about: help text.
        counts: option names with their default numbers of inputs.
        prepare: fills a folder with good inputs and returns the rounds of each option.
        arguments: command-line arguments; None: those of the process.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, count in counts.items():
        parser.add_argument(f"--{name}", type=int, default=count)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    options = parser.parse_args(arguments)
    faults = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        for option, rounds in prepare(folder).items():
            count, began = getattr(options, option), time.monotonic()
            for each in rounds:
                numbers = range(options.first, options.first + count)
                tally = each(numbers, options.seed, folder / "tries", lambda text: print(text, file=sys.stderr))
                faults += tally.faults
                print(f"{count} {option}, {tally.faults} faults, {time.monotonic() - began:.0f} s in all")
                if tally.slowest:
                    print(f"  slowest {tally.slowest:.2f} s of CPU, largest {tally.largest / 2**20:.0f} MiB")
                for outcome, number in sorted(tally.ended.items()):
                    print(f"  {outcome}: {number}", flush=True)
    return 1 if faults else 0
