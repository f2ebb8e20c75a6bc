"""Signals that ask the program to stop are treated as Ctrl-C is."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

from gensim2.core.errors import Stopped

_STOPPING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

#: Packages with ``except BaseException``, around their imports too: Ctrl-C there would be taken for a missing module.
SWALLOWING = ("networkx", "trimesh")

#: Seconds after which a signal that came in one of them is looked at again.
AGAIN = 0.05


def exit_code(error: BaseException) -> int:
    """128 + the signal's number, as shells have it; 130 for Ctrl-C."""
    return 128 + (error.number if isinstance(error, Stopped) else signal.SIGINT)


@contextlib.contextmanager
def stopping_signals() -> Iterator[None]:
    """Raise in the block :class:`Stopped` on SIGTERM and SIGHUP, once, and KeyboardInterrupt on Ctrl-C.

    What comes after one of the former does not disturb the cleaning up. A signal that the parent had us ignore
    (``nohup``) stays ignored. What comes inside a package of ``SWALLOWING`` is raised once that has returned.
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
            if handler is not None:  # not Python's
                signal.signal(number, handler)


def _swallowed(frame: FrameType | None) -> bool:
    """Whether what is raised at a frame would end in one of the packages that catch everything."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).partition(".")[0] in SWALLOWING:
            return True
        frame = frame.f_back
    return False
