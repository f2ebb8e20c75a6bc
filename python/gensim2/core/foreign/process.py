"""Run a reader in a subprocess with limited memory and CPU time, because damaged files can crash C libraries.

HDF5, Arrow and the compressors are written in C and C++. Unexpected bytes may crash the process, exhaust the memory, or
cause an endless loop. In a subprocess such a failure ends only the reader and is reported as a one-line error.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import pickle
import resource
import signal
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, TypeVar

from gensim2.core.errors import GenSim2Error, InputError
from gensim2.core.processes.executor import WorkerStartError
from gensim2.core.processes.fork_server import end_with_the_parent
from gensim2.core.processes.pool import preload_modules, start_process
from gensim2.core.progress import Progress

Result = TypeVar("Result")

FRUGAL = {"MIMALLOC_ARENA_RESERVE": str(32 * 2**10)}
"""Memory that Arrow's allocator reserves in advance, KiB; its default of 1 GiB would count towards the limit."""

EXIT_LIMIT = 5.0
"""Time in which a finished reader must exit, s."""

_LAST = ("result", "error", "memory", "bug")


@dataclass(frozen=True)
class Bounds:
    """Resource limits of a reader.

    Attributes:
        memory: memory that the reader may allocate after its start, bytes.
        cpu_s: CPU time, s.
        file_size: maximum size of files that the reader writes, bytes; by default the limit of the calling process.
    """

    memory: int
    cpu_s: int
    file_size: tuple[int, int]

    @staticmethod
    def of(size: int) -> Bounds:
        """Return the limits for reading ``size`` bytes in total.

        The limits leave enough memory to decompress one episode.
        """
        megabytes = size // 2**20
        return Bounds(2**30 + 4 * min(size, 2**30), 60 + 4 * megabytes, resource.getrlimit(resource.RLIMIT_FSIZE))

    def apply(self) -> None:
        begun = int(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]))
        data = _data_size() + self.memory
        resource.setrlimit(resource.RLIMIT_DATA, (data, data))
        resource.setrlimit(resource.RLIMIT_CPU, (begun + self.cpu_s, begun + self.cpu_s + 5))
        resource.setrlimit(resource.RLIMIT_FSIZE, self.file_size)


def isolated(
    function: Callable[..., Result],
    arguments: tuple[Any, ...],
    source: Path,
    bounds: Bounds,
    progress: Progress,
    preload: tuple[str, ...] = (),
) -> Result:
    """Run ``function(*arguments, progress)`` in a new subprocess with limited resources and return the result.

    A script must call this function below ``if __name__ == "__main__":``, because the function starts a process.

    Args:
        function: function that can be pickled, like its arguments and its result. Its ``GenSim2Error`` or ``OSError``
            is raised again.
        source: file or folder that the function reads, for error messages.
        bounds: resource limits.
        progress: listener that receives the function's progress.
        preload: modules that the function needs. They are imported once, before the subprocess is forked.

    Raises:
        InputError: the subprocess crashed or exceeded a limit.
        WorkerStartError: the subprocess could not be started.
    """
    preload_modules(preload)
    process, ours = start_process(_run, (bounds, pickle.dumps((function, arguments))), duplex=False)
    try:
        while True:
            try:
                kind, *told = pickle.loads(ours.recv_bytes())
            except (EOFError, OSError):
                raise _death(process, source, bounds) from None
            if kind in _LAST:
                # A killed process would leak semaphores, and Python would print a warning.
                process.join(timeout=EXIT_LIMIT)
            if kind == "result":
                result: Result = told[0]
                return result
            if kind == "error":
                raise told[0]
            if kind == "memory":
                raise _too_large(source, bounds)
            if kind == "bug":
                raise RuntimeError(told[0])
            getattr(progress, kind)(*told)
    finally:
        ours.close()
        process.kill()
        process.join()


class _Told(Progress):
    """Progress listener that sends the progress from the subprocess to the waiting caller."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def start(self, description: str, total: int | None = None) -> None:
        self._send("start", description, total)

    def advance(self, steps: int = 1) -> None:
        self._send("advance", steps)

    def resize(self, total: int) -> None:
        self._send("resize", total)

    def message(self, text: str) -> None:
        self._send("message", text)

    def _send(self, *news: Any) -> None:
        self._connection.send_bytes(pickle.dumps(news))


def _run(connection: Connection, bounds: Bounds, payload: bytes) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole process group; the parent handles it
    threading.Thread(target=end_with_the_parent, daemon=True).start()
    faulthandler.disable()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # hide the messages that a library prints when it crashes
    os.environ |= FRUGAL
    function, arguments = pickle.loads(payload)
    try:
        bounds.apply()
        said: tuple[Any, ...] = ("result", function(*arguments, _Told(connection)))
    except (GenSim2Error, OSError) as error:
        said = ("error", error)
    except MemoryError:
        said = ("memory",)
    except BaseException:  # noqa: BLE001 - sent to the caller, who raises it
        said = ("bug", traceback.format_exc())
    with contextlib.suppress(OSError):  # if the parent process has ended, it cannot receive the result
        connection.send_bytes(pickle.dumps(said))


def _data_size() -> int:
    """Return how many bytes of this process's memory count towards the limit RLIMIT_DATA."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmData:"):
            return int(line.split()[1]) * 1024
    return 0


def _death(process: BaseProcess, source: Path, bounds: Bounds) -> GenSim2Error:
    process.join(timeout=5)
    code = process.exitcode
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return InputError(
            f"the process that reads the file used more than {bounds.cpu_s} s of CPU time, or was killed", file=source
        )
    if code == -signal.SIGABRT:
        return _too_large(source, bounds)
    if code is None or code >= 0:  # a negative code is the number of the signal that ended the process
        guard = 'a script must start such a process below `if __name__ == "__main__":`'
        return WorkerStartError(f"no process to read {source} could be started (exit code {code}; {guard})")
    fate = signal.Signals(-code).name
    return InputError(f"is damaged: the library that reads it crashed ({fate})", file=source)


def _too_large(source: Path, bounds: Bounds) -> InputError:
    limit = f"{bounds.memory // 2**20} MiB of memory"
    return InputError(f"reading the file takes more than {limit}; the file may be damaged", file=source)
