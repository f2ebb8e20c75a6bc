"""The server that forks workers, out of the reach of Ctrl-C."""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import sys
from multiprocessing import forkserver, resource_tracker
from pathlib import Path

_registered_in: int | None = None
"""The process that ends its server when it ends; one that is forked of it does not."""


def start_fork_server() -> None:
    """Start the server that forks processes, unless it runs; SIGINT stays blocked in it.

    It ignores SIGINT itself only once it has imported what it preloads: until then Ctrl-C, which reaches the whole
    group, would end it with a traceback. The signal is blocked while it starts, not ignored: the caller gets it after.
    """
    global _registered_in
    forget_piped_script()
    if _registered_in != os.getpid():
        _registered_in = os.getpid()
        atexit.register(_end_server, _registered_in)
    resource_tracker.ensure_running()  # on its own: as it starts, it unblocks what is blocked here
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def forget_piped_script() -> None:
    """Forget the name of a script that came through a pipe: each worker would look for a file called ``<stdin>``."""
    main = sys.modules["__main__"]
    path = getattr(main, "__file__", None)
    if path is not None and not Path(path).is_file():
        del main.__file__


def _end_server(registered: int) -> None:
    """End the server with the program: while it imports it sees no end, and holds open what the program writes to."""
    server: int | None = getattr(forkserver._forkserver, "_forkserver_pid", None)
    if server is not None and os.getpid() == registered:
        with contextlib.suppress(ProcessLookupError):
            os.kill(server, signal.SIGTERM)


def ignore_interrupts() -> None:
    """Ignore SIGINT in a worker, and let it through again: programs that the worker starts have it as usual."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT,))
