"""Start the server that forks worker processes, and protect the server from Ctrl-C."""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import sys
from multiprocessing import forkserver, resource_tracker
from pathlib import Path

_registered_in: int | None = None
"""Id of the process that ends the fork server at exit; its forked children must not end the server."""


def start_fork_server() -> None:
    """Start the fork server unless it is running, with SIGINT blocked in it.

    The server ignores SIGINT only after it has imported its preloaded modules. Until then Ctrl-C, which reaches the
    whole process group, would end the server with a traceback. SIGINT is also blocked in the caller during the start,
    and the caller receives the signal afterwards.
    """
    global _registered_in
    forget_piped_script()
    if _registered_in != os.getpid():
        _registered_in = os.getpid()
        atexit.register(_end_server, _registered_in)
    resource_tracker.ensure_running()  # start the tracker now, because its start unblocks signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def forget_piped_script() -> None:
    """Forget the name of a script that was piped in, because workers would look for a file called ``<stdin>``."""
    main = sys.modules["__main__"]
    path = getattr(main, "__file__", None)
    if path is not None and not Path(path).is_file():
        del main.__file__


def _end_server(registered: int) -> None:
    """Kill the fork server when the program ends.

    While the server imports modules, it does not notice that the program has ended, and would keep files open.
    """
    server: int | None = getattr(forkserver._forkserver, "_forkserver_pid", None)
    if server is not None and os.getpid() == registered:
        with contextlib.suppress(ProcessLookupError):
            os.kill(server, signal.SIGTERM)


def ignore_interrupts() -> None:
    """Ignore SIGINT (Ctrl-C) in a worker, and unblock this signal, so that programs which the worker starts can receive
    it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT,))
