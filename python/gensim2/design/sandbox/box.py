"""A process that can do nothing but compute and answer: for unreviewed programs.

Two walls of the operating system, neither of which needs a privilege. The inner one is a seccomp filter that the
process puts on before it looks at the program (``filter``, ``inside/main.py``), beside limits on time, memory and
files. The outer one is bubblewrap: namespaces of its own in which there is no network, no other process and no
file but Python's. The inner one is a must; the outer one is there where bubblewrap is installed and works.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import selectors
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO, Any

from gensim2.design.sandbox.filter import NoFilterError, instructions
from gensim2.errors import GenSim2Error

INSIDE = Path(__file__).parent / "inside"

#: Tries what is forbidden to all: look at files, signal, start a process. Tells what went through; run unchecked.
_PROBE = """
import ctypes, os
libc = ctypes.CDLL(None)
acts = {"access": (b"/", 0), "kill": (0, 0), "fork": ()}
done = []
for name, arguments in acts.items():
    found = getattr(libc, name)(*arguments)
    if name == "fork" and found == 0:
        os._exit(0)
    if found != -1:
        done.append(name)
raise ValueError("went through: " + ", ".join(done))
"""
#: What bubblewrap's complaint means on Ubuntu from 23.10 on, and in containers.
_FORBIDDEN = "; it may make no namespaces: on Ubuntu give it an AppArmor profile (docs/sandbox.md)"
_NOTHING_WENT_THROUGH = "ValueError: went through: "


class NoSandboxError(GenSim2Error):
    """This machine has no sandbox; the message says what to install."""

    def __init__(self, why: str) -> None:
        super().__init__(f"generated code is not run: this machine has no sandbox for it ({why})")
        self.why = why


@dataclass(frozen=True)
class Limits:
    """Resource limits of a program.

    Attributes:
        wall_s: seconds until it is killed.
        cpu_s: whole seconds of CPU.
        memory: bytes of address space, Python's own included.
        answer: bytes of its answer.
    """

    wall_s: float = 30.0
    cpu_s: int = 3
    memory: int = 256 * 2**20
    answer: int = 2**20

    def resources(self) -> dict[str, int]:
        """As :func:`resource.setrlimit` takes them, by name."""
        return {
            "RLIMIT_CPU": self.cpu_s,
            "RLIMIT_AS": self.memory,
            "RLIMIT_FSIZE": 0,
            "RLIMIT_NOFILE": 3,
            "RLIMIT_NPROC": 0,
            "RLIMIT_CORE": 0,
        }


@dataclass(frozen=True)
class Ended:
    """Exit of a process.

    Attributes:
        answer: what it wrote, cut where it was too much.
        why: what ended it, where it did not end by itself.
        code: exit code, negative for a signal.
    """

    answer: bytes
    why: str | None
    code: int


@dataclass(frozen=True)
class Sandbox:
    """Sandbox of the operating system in which programs run.

    Attributes:
        bubblewrap: the program that makes namespaces; None: the filter alone.
        limits: of each run.
        without: why there is no bubblewrap.
    """

    bubblewrap: str | None
    limits: Limits = Limits()
    without: str | None = None

    @property
    def in_words(self) -> str:
        """Its walls: ``"seccomp inside bubblewrap"``."""
        return "seccomp" if self.bubblewrap is None else "seccomp inside bubblewrap"

    def run(self, source: str, criteria: dict[str, list[str]], *, checked: bool = True) -> Ended:
        """Run a program to its end, by itself or by force.

        Args:
            source: the program.
            criteria: arguments of each type of criterion.
            checked: whether it must pass the allow-list first.
        """
        document = {
            "source": source,
            "checked": checked,
            "criteria": criteria,
            "limits": self.limits.resources(),
            "filter": base64.b64encode(instructions()).decode(),
        }
        with _reading(json.dumps(document).encode()) as stream:
            process = subprocess.Popen(
                self._command(), stdin=stream, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env={}, cwd="/"
            )
        with process:
            try:
                return _watched(process, self.limits)
            finally:
                process.kill()

    def _command(self) -> list[str]:
        if self.bubblewrap is None:
            return [sys.executable, "-I", "-S", "-B", str(INSIDE / "main.py")]
        python = os.path.realpath(sys.executable)
        return [self.bubblewrap, *_namespaces(), "--", python, "-I", "-S", "-B", "/inside/main.py"]


@cache
def sandbox() -> Sandbox:
    """The sandbox of this machine; it was tried out.

    Raises:
        NoSandboxError: there is none; says what to install.
    """
    try:
        instructions()
    except NoFilterError as error:
        raise NoSandboxError(str(error)) from error
    alone = Sandbox(None, without="bubblewrap is not installed (Debian, Ubuntu: apt-get install bubblewrap)")
    found = shutil.which("bwrap")
    if found is not None:
        wrapped = Sandbox(found)
        why = _fault(wrapped)
        if why is None:
            return wrapped
        alone = Sandbox(None, without=f"{found} cannot be used: {_complaint(wrapped) or why}")
    why = _fault(alone)
    if why is not None:
        raise NoSandboxError(f"a trial of the seccomp filter failed: {why}; it needs Linux 4.8 or newer")
    return alone


def _fault(tried: Sandbox) -> str | None:
    """Why a sandbox cannot be used; None where it can."""
    ended = tried.run(_PROBE, {}, checked=False)
    if ended.why is not None or ended.code != 0:
        return ended.why or f"its process ended with {ended.code}"
    try:
        words = str(json.loads(ended.answer)["problems"][0])
    except (ValueError, LookupError, TypeError):
        return "its process gave no answer"
    return None if words.endswith(_NOTHING_WENT_THROUGH) else words


def _complaint(tried: Sandbox) -> str:
    """The last line of what bubblewrap says when it cannot make its namespaces."""
    done = subprocess.run(tried._command(), stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    lines = done.stderr.strip().splitlines()
    said = lines[-1] if lines and lines[-1].startswith("bwrap: ") else ""
    return f"{said}{_FORBIDDEN}" if said.endswith(("Permission denied", "Operation not permitted")) else said


def _namespaces() -> list[str]:
    """Arguments of bubblewrap: nothing of the machine but Python and its libraries, which cannot be written to."""
    options = ["--unshare-all", "--unshare-user", "--uid", "65534", "--gid", "65534", "--cap-drop", "ALL"]
    options += ["--die-with-parent", "--new-session", "--clearenv", "--hostname", "box"]
    prefixes = dict.fromkeys(["/usr", sys.base_prefix, str(Path(os.path.realpath(sys.executable)).parents[1])])
    for folder in prefixes:
        if Path(folder) not in (Path("/usr"), Path("/")) and not Path(folder).is_relative_to("/usr"):
            options += ["--ro-bind", folder, folder]
    options += ["--ro-bind", "/usr", "/usr", "--ro-bind-try", "/etc/ld.so.cache", "/etc/ld.so.cache"]
    for folder in ("/lib", "/lib64"):
        if Path(folder).is_symlink():
            options += ["--symlink", str(Path(folder).readlink()), folder]
        else:
            options += ["--ro-bind-try", folder, folder]
    return [*options, "--ro-bind", str(INSIDE), "/inside", "--remount-ro", "/", "--chdir", "/"]


@contextlib.contextmanager
def _reading(data: bytes) -> Iterator[IO[bytes]]:
    """A file without a name that holds the data, to be read from the start."""
    with tempfile.TemporaryFile() as stream:
        stream.write(data)
        stream.seek(0)
        yield stream


def _watched(process: subprocess.Popen[bytes], limits: Limits) -> Ended:
    """Read what a process writes until it ends, writes too much or takes too long."""
    assert process.stdout is not None
    found, deadline = bytearray(), time.monotonic() + limits.wall_s
    with selectors.DefaultSelector() as waiting:
        waiting.register(process.stdout, selectors.EVENT_READ)
        while True:
            if not waiting.select(max(0.0, deadline - time.monotonic())):
                return _killed(process, found, f"it took longer than {limits.wall_s:g} s")
            part = os.read(process.stdout.fileno(), 65536)
            if not part:
                break
            found += part
            if len(found) > limits.answer:
                return _killed(process, found[: limits.answer], f"it wrote more than {limits.answer} bytes")
    try:
        return Ended(bytes(found), None, process.wait(max(0.0, deadline - time.monotonic())))
    except subprocess.TimeoutExpired:
        return _killed(process, found, f"it took longer than {limits.wall_s:g} s")


def _killed(process: subprocess.Popen[bytes], found: bytearray, why: str) -> Ended:
    process.kill()
    return Ended(bytes(found), why, process.wait())


def to_json_value(ended: Ended) -> Any:
    """The answer of a process as plain data; None where there is none."""
    try:
        return json.loads(ended.answer)
    except (ValueError, RecursionError):
        return None
