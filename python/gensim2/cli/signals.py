"""Treat signals that ask the program to stop like Ctrl-C."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

from gensim2.core.errors import Stopped

_STOPPING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

#: Packages that catch BaseException, for example around imports. They would treat Ctrl-C as a missing module.
SWALLOWING = ("networkx", "trimesh")

#: Delay in seconds after which a postponed signal is handled. A signal is postponed while a package of ``SWALLOWING``
#: is running, because this package would catch the exception.
AGAIN = 0.05


def exit_code(error: BaseException) -> int:
    """Return the exit code of a stopped program: 128 plus the signal's number, for example 130 after Ctrl-C."""
    return 128 + (error.number if isinstance(error, Stopped) else signal.SIGINT)


@contextlib.contextmanager
def stopping_signals() -> Iterator[None]:
    """Raise :class:`Stopped` on the first SIGTERM or SIGHUP in the block, and KeyboardInterrupt on Ctrl-C.

    After SIGTERM or SIGHUP, later signals are ignored, so that they do not interrupt the cleanup. If the parent process
    has made the program ignore a signal (as ``nohup`` does), the signal stays ignored. If a signal arrives while a
    package of ``SWALLOWING`` is running, the exception is raised only after the package has returned, because these
    packages catch all exceptions.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ours = [number for number in _STOPPING if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler)]
    before = {number: signal.getsignal(number) for number in (*ours, signal.SIGALRM)}

    def stop(number: int, frame: FrameType | None) -> None:
        if _swallowed(frame):
            signal.signal(signal.SIGALRM, lambda _, later: stop(number, later))
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
            return
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        for each in ours:
            signal.signal(each, signal.SIG_IGN)
        raise Stopped(number)

    try:
        for number in ours:
            signal.signal(number, stop)
        yield
    finally:
        if signal.getsignal(signal.SIGALRM) is not before[signal.SIGALRM]:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            if handler is not None:  # Python reports None for a handler that C code has installed
                signal.signal(number, handler)


def _swallowed(frame: FrameType | None) -> bool:
    """Return whether a package of ``SWALLOWING`` is on the call stack and would catch an exception raised here."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).partition(".")[0] in SWALLOWING:
            return True
        frame = frame.f_back
    return False
