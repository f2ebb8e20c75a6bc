"""The seccomp filter of the sandbox: the few system calls that a program needs which only computes."""

from __future__ import annotations

import errno
import mmap
import os
from functools import cache

#: Memory, time, and what was opened before. Nothing opens, starts, signals, connects or asks who else is there.
CALLS = (
    "read",
    "write",
    "writev",
    "close",
    "exit",
    "exit_group",
    "brk",
    "munmap",
    "mremap",
    "madvise",
    "futex",
    "clock_gettime",
    "clock_getres",
    "clock_nanosleep",
    "nanosleep",
    "gettimeofday",
    "time",
    "getrandom",
    "rt_sigreturn",
    "rt_sigprocmask",
    "restart_syscall",
)

#: Allowed as well, as long as the memory is not to be executed: argument 2 is the protection.
WITHOUT_EXECUTION = ("mmap", "mprotect")


class NoFilterError(Exception):
    """There is no library to make a filter with; the message says what to install."""


@cache
def instructions() -> bytes:
    """The filter as the kernel takes it: an array of ``struct sock_filter``.

    Every call that is not listed fails with EPERM; one of another architecture than the machine's kills.

    Raises:
        NoFilterError: pyseccomp or libseccomp is not installed.
    """
    try:
        import pyseccomp
    except ModuleNotFoundError as error:
        raise NoFilterError("pip install 'gensim2[llm]'") from error
    except (RuntimeError, OSError, AttributeError) as error:  # pyseccomp finds no libseccomp, or an old one
        raise NoFilterError("install libseccomp (Debian, Ubuntu: apt-get install libseccomp2)") from error
    made = pyseccomp.SyscallFilter(pyseccomp.ERRNO(errno.EPERM))
    for name in CALLS:
        made.add_rule(pyseccomp.ALLOW, name)
    for name in WITHOUT_EXECUTION:
        made.add_rule(pyseccomp.ALLOW, name, pyseccomp.Arg(2, pyseccomp.MASKED_EQ, mmap.PROT_EXEC, 0))
    reading, writing = os.pipe()  # a filter takes hundreds of bytes, a pipe thousands
    with os.fdopen(reading, "rb") as result:
        with os.fdopen(writing, "wb") as stream:
            made.export_bpf(stream)
        return result.read()
