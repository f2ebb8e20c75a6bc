"""Run programs in forked processes that have the slow libraries imported already.

The processes are forked from the fork server of the worker pools, in which PhysX, torch and Vulkan were never used. Its
hash seed is shared, so tests that need another one or look at imports must start a new interpreter.
"""

from __future__ import annotations

import multiprocessing
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import types
from collections.abc import Mapping, Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path

from gensim2.rollout.worker import PRELOAD

_CONTEXT = multiprocessing.get_context("forkserver")

#: Modules that simulators, renderers and readers of exports need.
MODULES = (
    *PRELOAD["sapien"],
    "gensim2.sim.env",
    "gensim2.data.observing",
    "gensim2.data.formats.importing",
    "embreex.rtcore_scene",
)


def start(
    *words: str | Path, out: Path, err: Path, cwd: Path | None = None, env: Mapping[str, str] | None = None
) -> BaseProcess:
    """Start ``python WORDS`` in a forked process: a file, ``-c CODE`` or ``-m MODULE``, and its arguments.

    Args:
        out, err: files for its output.
    """
    environment = dict(os.environ if env is None else env)
    given = ([str(word) for word in words], (out, err), cwd or Path.cwd(), environment, sys.path)
    process = _CONTEXT.Process(target=_program, args=given)
    process.start()
    return process


def run(
    *words: str | Path, cwd: Path | None = None, env: Mapping[str, str] | None = None, timeout: float = 600
) -> subprocess.CompletedProcess[str]:
    """Run ``python WORDS`` to its end, as :func:`start` starts it."""
    with tempfile.TemporaryDirectory() as folder:
        out, err = (Path(folder) / name for name in ("out", "err"))
        process = start(*words, out=out, err=err, cwd=cwd, env=env)
        process.join(timeout)
        if process.exitcode is None:
            process.kill()
            process.join()
            raise subprocess.TimeoutExpired(list(words), timeout)
        return subprocess.CompletedProcess(list(words), process.exitcode, out.read_text(), err.read_text())


def _program(
    words: Sequence[str], said: Sequence[Path], cwd: Path, environment: Mapping[str, str], path: Sequence[str]
) -> None:
    for descriptor, file in enumerate(said, start=1):
        opened = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(opened, descriptor)
        os.close(opened)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(cwd)
    # As in a new interpreter:
    multiprocessing.set_start_method(None, force=True)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT,))
    first, *rest = words
    sys.path[:] = path
    if first == "-c":
        sys.argv = ["-c", *rest[1:]]
        module = types.ModuleType("__main__")
        sys.modules["__main__"] = module
        exec(compile(rest[0], "<string>", "exec"), vars(module))
    elif first == "-m":
        sys.argv = rest
        runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
    else:
        sys.argv = list(words)
        sys.path.insert(0, str(Path(first).parent))
        runpy.run_path(first, run_name="__main__")
