"""Start the server that forks worker processes, and protect the server from Ctrl-C."""

from __future__ import annotations

import atexit
import contextlib
import multiprocessing
import os
import signal
import sys
from multiprocessing import forkserver, resource_tracker
from pathlib import Path

WORKER = "gensim2 worker"
"""Name of every worker process."""

_registered_in: int | None = None
"""Id of the process that ends the fork server at exit; its forked children must not end the server."""


def start_fork_server() -> None:
    """Start the fork server, the process from which workers are forked. If the server is already running, do nothing.

    Ctrl-C sends SIGINT to the whole process group. The signal would end the server with a traceback while the server
    imports its modules. Therefore this function blocks SIGINT in the caller while the server starts, and the server
    inherits the block. The caller receives the signal afterwards.
    """
    global _registered_in
    forget_piped_script()
    if _registered_in != os.getpid():
        _registered_in = os.getpid()
        atexit.register(_end_server, _registered_in)
    # Start the resource tracker before SIGINT is blocked below, because starting the tracker unblocks the signal.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_unguarded_worker() -> None:
    """End this process without a message if it is a worker process that is still importing the main script.

    Without ``if __name__ == "__main__":``, a worker that imports the main script would start the work of the script
    again. The parent raises an error with the remedy. Tracebacks of workers would only hide it.

    Raises:
        SystemExit: this process is such a worker process.
    """
    process = multiprocessing.current_process()
    # multiprocessing sets this attribute during the import, and has no public name for it.
    if process.name == WORKER and getattr(process, "_inheriting", False):
        raise SystemExit(1)


def forget_piped_script() -> None:
    """Delete ``__main__.__file__`` if it is not the name of a file, such as ``<stdin>``.

    Workers would try to open it.
    """
    main = sys.modules["__main__"]
    path = getattr(main, "__file__", None)
    if path is not None and not Path(path).is_file():
        del main.__file__


def _end_server(registered: int) -> None:
    """Kill the fork server at the end.

    A server that still imports modules would not notice the end and keep files open.
    """
    server: int | None = getattr(forkserver._forkserver, "_forkserver_pid", None)
    if server is not None and os.getpid() == registered:
        with contextlib.suppress(ProcessLookupError):
            os.kill(server, signal.SIGTERM)


def ignore_interrupts() -> None:
    """Ignore SIGINT (Ctrl-C) in a worker, and unblock SIGINT for the programs that the worker starts."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT,))


def end_with_the_parent() -> None:
    """End this process when the parent dies, so that a long job does not continue without the parent."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
