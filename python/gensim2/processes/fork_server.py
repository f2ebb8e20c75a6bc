"""The server that forks workers, out of the reach of Ctrl-C."""

from __future__ import annotations

import signal
from multiprocessing import forkserver, resource_tracker


def start_fork_server() -> None:
    """Start the server that forks processes, unless it runs; SIGINT stays blocked in it.

    It ignores SIGINT itself only once it has imported what it preloads: until then Ctrl-C, which reaches the whole
    group, would end it with a traceback. The signal is blocked while it starts, not ignored: the caller gets it after.
    """
    resource_tracker.ensure_running()  # on its own: as it starts, it unblocks what is blocked here
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore_interrupts() -> None:
    """Ignore SIGINT in a worker, and let it through again: programs that the worker starts have it as usual."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT,))
