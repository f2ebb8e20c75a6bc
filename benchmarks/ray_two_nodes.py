"""A collection on a Ray cluster of two nodes on this machine, one of which is taken away half-way.

    python benchmarks/ray_two_nodes.py                    # the simulator, some minutes
    python benchmarks/ray_two_nodes.py --world fake       # a made-up world, a minute

Prints how long each run took and whether the bytes are those of one process. Ends with 1 where they are not. Needs the
extra ``ray``.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "kill"))

import kill_runs

# The nodes and the driver know each other by a word that nobody else on this machine knows.
kill_runs.SCRIPT_ENVIRONMENT |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}

TRIES = 6

MEMORY = "100000000"
"""Bytes of a node's object store: next to nothing passes through it."""


class Cluster:
    """Two ``ray start`` on loopback, each with its processes in a group of its own."""

    def __init__(self, folder: Path, cpus: int) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = str(probe.getsockname()[1])
        self.address = f"127.0.0.1:{port}"
        self._log = (folder / "ray.log").open("ab")
        self.head = self._start("--head", "--port", port, "--num-cpus", str(cpus))
        try:
            self.other = self._start("--address", self.address, "--num-cpus", str(cpus))
        except BaseException:
            self.stop(self.head)
            raise

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        """Start a node and wait until it says that it has begun.

        Ray gives a node's agents 15 s to start (its issue 65983): on a busy machine it takes several tries.
        """
        command = [str(Path(sys.executable).with_name("ray")), "start", "--block", "--disable-usage-stats", *words]
        more = ["--object-store-memory", MEMORY, *(["--include-dashboard", "false"] if "--head" in words else [])]
        for _ in range(TRIES):
            before = self._said()
            process = subprocess.Popen(
                [*command, *more],
                stdout=self._log,
                stderr=self._log,
                start_new_session=True,
                env=kill_runs.SCRIPT_ENVIRONMENT,
            )
            deadline = time.monotonic() + 120
            while process.poll() is None and time.monotonic() < deadline:
                if self._said() > before:
                    return process
                time.sleep(0.2)
            self.stop(process)
        raise SystemExit(f"a Ray node does not start: see {self._log.name}")

    def _said(self) -> int:
        return Path(self._log.name).read_bytes().count(b"Ray runtime started")

    @staticmethod
    def stop(process: subprocess.Popen[bytes]) -> None:
        """Kill a node at once with everything that runs on it."""
        pids = _descendants(process.pid)
        for pid in [process.pid, *pids]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        process.wait()

    def close(self) -> None:
        """End both nodes."""
        for node in (self.other, self.head):
            self.stop(node)
        self._log.close()


def _descendants(pid: int) -> list[int]:
    return [each for child in kill_runs.children(pid) for each in (child, *_descendants(child))]


@contextlib.contextmanager
def cluster(folder: Path, cpus: int = 1) -> Iterator[Cluster]:
    """A cluster for as long as the block lasts."""
    folder.mkdir(parents=True, exist_ok=True)
    found = Cluster(folder, cpus)
    try:
        yield found
    finally:
        found.close()


def line(out: Path, options: argparse.Namespace, *more: str) -> list[str]:
    """The command that collects."""
    words = ["collect", *options.tasks, "--episodes", str(options.episodes), "--assets", "builtin", "--seed", "5"]
    return [sys.executable, kill_runs.__file__, "--child", options.world, *words, "--out", str(out), *more]


def run(out: Path, options: argparse.Namespace, *more: str, lose: Cluster | None = None) -> float:
    """Collect; with ``lose`` its second node is killed once half of the episodes are there. Seconds."""
    begin = time.monotonic()
    process = kill_runs.start(line(out, options, *more), out.with_suffix(".log"))
    half = options.episodes * len(options.tasks) // 2
    try:
        while process.poll() is None and time.monotonic() < begin + 3600:
            if lose is not None and sum(1 for _ in out.glob("*/*/[0-9]*.h5")) >= half:
                lose.stop(lose.other)
                lose = None
            time.sleep(0.1)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    if process.wait() != 0 or lose is not None:
        raise SystemExit(f"ended with {process.returncode}:\n{out.with_suffix('.log').read_text()[-2000:]}")
    return time.monotonic() - begin


def compare(folder: Path, options: argparse.Namespace) -> list[str]:
    """Collect in one process, on two nodes, and on two of which one is lost; the files that differ."""
    wrong = []
    seconds = run(folder / "one", options, "--workers", "1")
    print(f"one process: {seconds:.1f} s", flush=True)
    expected = kill_runs.contents(folder / "one")
    with cluster(folder / "cluster") as nodes:
        for name, lose in (("two nodes", None), ("a node lost half-way", nodes)):
            out = folder / name.replace(" ", "-")
            seconds = run(out, options, "--ray", nodes.address, lose=lose)
            differing = list(kill_runs.differences(expected, kill_runs.contents(out)))
            wrong += [f"{name}: {path}" for path in differing]
            print(f"{name}: {seconds:.1f} s, {len(differing)} of {len(expected)} files differ", flush=True)
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", default=["PushDrawerClose", "CloseBox"])
    parser.add_argument("--episodes", type=int, default=10, help="of each task")
    parser.add_argument("--world", choices=("simulator", "fake"), default="simulator")
    parser.add_argument("--out", type=Path, help="keep the runs here; default: a temporary folder")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.out or Path(temporary)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        wrong = compare(folder, options)
    for name in wrong:
        print(f"differs: {name}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
