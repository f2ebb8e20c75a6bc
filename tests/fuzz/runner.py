"""Try numbered inputs, count how they ended, and provide the command line of the damaging scripts."""

from __future__ import annotations

import argparse
import gc
import os
import select
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from gensim2.core.foreign.process import Bounds
from gensim2.core.progress import Progress

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
    """Number of inputs by outcome, and the total and largest CPU time and memory."""

    ended: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    slowest: float = 0.0
    largest: int = 0
    faults: int = 0


Round = Callable[[range, int, Path, Say], Tally]
"""Takes the inputs' numbers, the seed, a folder to write to and a listener, and tries the inputs."""


def tried(numbers: Iterable[int], attempt: Callable[[int], Ended], say: Say) -> Tally:
    """Try each input until Ctrl-C or SIGTERM; report and count failures."""
    tally = Tally()
    gc.collect()
    gc.freeze()  # a collection in a forked process would copy all of its memory
    for count, number in enumerate(numbers, 1):
        try:
            found = attempt(number)
        except KeyboardInterrupt:
            break
        except Exception as error:  # noqa: BLE001 - other exceptions are the bugs to be found
            tally.faults += 1
            say(f"{number}: {type(error).__name__}: {str(error)[-1500:]}")
        else:
            tally.ended[found.outcome] += 1
            tally.seconds += found.seconds
            tally.slowest, tally.largest = max(tally.slowest, found.seconds), max(tally.largest, found.memory)
        if count % SAID == 0:
            say(f"{count} tried, {tally.faults} faults")
    return tally


class Cost(Progress):
    """CPU time (s) and highest memory (bytes) of a reader in another process, which :func:`measured` reports."""

    seconds, memory = 0.0, 0

    def message(self, text: str) -> None:
        """Read a report."""
        seconds, memory = text.split()
        self.seconds, self.memory = float(seconds), int(memory)


@contextmanager
def measured(progress: Progress) -> Iterator[None]:
    """Report the CPU time and the highest memory of the block to a :class:`Cost`."""
    begun = time.process_time()
    Path("/proc/self/clear_refs").write_text("5")  # reset the highest memory
    try:
        yield
    finally:
        progress.message(f"{time.process_time() - begun} {peak()}")


def peak() -> int:
    """Return the highest memory of this process, bytes."""
    report = Path("/proc/self/status").read_text()
    return 1024 * next(int(line.split()[1]) for line in report.splitlines() if line.startswith("VmHWM"))


def listing(folder: Path) -> set[tuple[str, int, int]]:
    """Return the paths in a folder, with sizes and times of files."""
    found = ((path, path.lstat()) for path in folder.rglob("*"))
    return {
        (str(path.relative_to(folder)), about.st_size * (not path.is_dir()), about.st_mtime_ns * (not path.is_dir()))
        for path, about in found
    }


def in_process(attempt: Callable[[], str], folder: Path, written: int = 0) -> tuple[str, float, int]:
    """Return how an attempt ended in a forked process of bounded means, its CPU seconds and its highest memory.

    Args:
        attempt: returns a word.
        folder: working directory, from which the process could import modules.
        written: size of the largest file that it may write elsewhere, bytes.

    Raises:
        AssertionError: it failed, hung, printed, wrote a file or ran what lies in the folder.
    """
    read, write = os.pipe()
    heard, printed = os.pipe2(os.O_NONBLOCK)
    before = listing(folder)
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            os.close(read)
            os.chdir(folder)
            sys.path.insert(0, str(folder))
            os.dup2(printed, 1)
            os.dup2(printed, 2)
            sys.stdout = sys.stderr = os.fdopen(2, "w", buffering=1, closefd=False)
            sys.excepthook = sys.__excepthook__
            threading.excepthook = threading.__excepthook__
            Bounds(MEMORY, CPU_S, (written, written)).apply()
            Path("/proc/self/clear_refs").write_text("5")
            outcome = attempt()
            os.write(write, f"{outcome} {time.process_time()} {peak()}".encode())
            code = 0
        except BaseException:  # noqa: BLE001 - told, and the process ends
            os.write(write, traceback.format_exc()[-3000:].encode("utf-8", "replace"))
        finally:
            os._exit(code)
    os.close(write)
    os.close(printed)
    process = os.pidfd_open(pid)
    try:
        assert select.select([process], [], [], HANGS)[0], f"hung for {HANGS:.0f} s"
    finally:
        os.close(process)
        os.kill(pid, signal.SIGKILL)
        _, status = os.waitpid(pid, 0)
        told, text = (os.read(descriptor, 2**16).decode(errors="replace") for descriptor in (read, heard))
        os.close(read)
        os.close(heard)
    assert status == 0, f"status {status}: {told}"
    assert not text, f"printed: {text[-1500:]}"
    changed = listing(folder) ^ before
    assert not changed, f"wrote {sorted(changed)}"
    outcome, seconds, memory = told.split()
    return outcome, float(seconds), int(memory)


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
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    faults = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        for option, rounds in prepare(folder).items():
            began = time.monotonic()
            for each in rounds:
                numbers = range(options.first, options.first + getattr(options, option))
                tally = each(numbers, options.seed, folder / "tries", lambda text: print(text, file=sys.stderr))
                faults += tally.faults
                done = tally.ended.total() + tally.faults
                print(f"{done} {option}, {tally.faults} faults, {time.monotonic() - began:.0f} s in all")
                print(f"  {tally.seconds:.0f} s of CPU, slowest {tally.slowest:.2f} s", end="")
                print(f", largest {tally.largest / 2**20:.0f} MiB")
                for outcome, number in sorted(tally.ended.items()):
                    print(f"  {outcome}: {number}", flush=True)
    return 1 if faults else 0
