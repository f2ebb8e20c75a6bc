"""Programs in processes that begin with the heavy libraries imported: a program of its own without seconds of imports.

What is started here is forked from the server that forks the workers of a pool, too. It has run nothing: PhysX, torch
and Vulkan are as fresh in it as in an interpreter that was just started; only the seed of hashes is the server's, so
tests that need another one, or that ask what is imported, start an interpreter.
"""

from __future__ import annotations

import multiprocessing
import os
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from gensim2.rollout.worker import PRELOAD

_CONTEXT = multiprocessing.get_context("forkserver")

#: What simulators, renderers and readers of exports need.
MODULES = (
    *PRELOAD,
    "gensim2.sim.env",
    "gensim2.data.observing",
    "gensim2.data.formats.importing",
    "embreex.rtcore_scene",
)


def run(
    *words: str | Path, cwd: Path | None = None, env: Mapping[str, str] | None = None, timeout: float = 600
) -> subprocess.CompletedProcess[str]:
    """Run ``python WORDS`` in a process that is forked: a file or ``-c CODE`` or ``-m MODULE``, and its arguments."""
    arguments = [str(word) for word in words]
    with tempfile.TemporaryDirectory() as folder:
        said = [Path(folder) / name for name in ("out", "err")]
        environment = dict(os.environ if env is None else env)
        process = _CONTEXT.Process(target=_program, args=(arguments, said, cwd or Path.cwd(), environment, sys.path))
        process.start()
        process.join(timeout)
        if process.exitcode is None:
            process.kill()
            process.join()
            raise subprocess.TimeoutExpired(arguments, timeout)
        out, err = (file.read_text() for file in said)
    return subprocess.CompletedProcess(arguments, process.exitcode, out, err)


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
    first, *rest = words
    sys.path[:] = path
    if first == "-c":
        sys.argv = ["-c", *rest[1:]]
        exec(compile(rest[0], "<string>", "exec"), {"__name__": "__main__"})
    elif first == "-m":
        sys.argv = rest
        runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
    else:
        sys.argv = list(words)
        sys.path.insert(0, str(Path(first).parent))
        runpy.run_path(first, run_name="__main__")
