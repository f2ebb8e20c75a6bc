"""A collection on a Ray cluster of two nodes on this machine; then a node, the driver and the head are taken away.

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
from collections.abc import Callable, Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "kill"))

import kill_runs

# The nodes and the driver know each other by a secret word.
kill_runs.SCRIPT_ENVIRONMENT |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}

TRIES = 6

NOT_RUN = 3
"""Exit code: what is finished is kept, and ``--resume`` goes on."""

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


def run(
    out: Path,
    options: argparse.Namespace,
    *more: str,
    half_way: Callable[[subprocess.Popen[bytes]], None] | None = None,
) -> tuple[float, int]:
    """Collect, and do something to the run once half of the episodes are there; its seconds and how it ended."""
    begin = time.monotonic()
    process = kill_runs.start(line(out, options, *more), out.with_suffix(".log"))
    half = options.episodes * len(options.tasks) // 2
    try:
        while process.poll() is None and time.monotonic() < begin + 3600:
            if half_way is not None and sum(1 for _ in out.glob("*/*/[0-9]*.h5")) >= half:
                half_way(process)
                half_way = None
            time.sleep(0.1)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    if half_way is not None:
        raise SystemExit(f"was over too early:\n{out.with_suffix('.log').read_text()[-2000:]}")
    return time.monotonic() - begin, process.wait()


class Comparison:
    """Collections on Ray beside that of one process."""

    def __init__(self, folder: Path, options: argparse.Namespace) -> None:
        self.folder, self.options = folder, options
        self.wrong: list[str] = []
        seconds, code = run(folder / "one", options, "--workers", "1")
        print(f"one process: {seconds:.1f} s", flush=True)
        self.expect(code, folder / "one")
        self._expected = kill_runs.contents(folder / "one")

    def expect(self, code: int, out: Path) -> None:
        """Stop where a run did not end well."""
        if code != 0:
            raise SystemExit(f"ended with {code}:\n{out.with_suffix('.log').read_text()[-2000:]}")

    def whole(self, name: str, address: str, lose: Callable[[], None] | None = None) -> None:
        """Collect to the end, whatever is lost on the way."""
        out = self._out(name)
        half_way = None if lose is None else lambda _: lose()
        seconds, code = run(out, self.options, "--ray", address, half_way=half_way)
        self.expect(code, out)
        self._compare(name, seconds)

    def cut(self, name: str, address: str, kill: Callable[[subprocess.Popen[bytes]], None], ends: int) -> None:
        """Collect until something is killed that no run outlives; it must end so."""
        out = self._out(name)
        seconds, code = run(out, self.options, "--ray", address, half_way=kill)
        left = sum(1 for _ in out.glob("*/*/[0-9]*.h5"))
        print(f"{name}: ended with {code} after {seconds:.1f} s, {left} episodes are there", flush=True)
        if code != ends:
            self.wrong.append(f"{name}: ended with {code}, not {ends}")

    def resume(self, name: str, address: str) -> None:
        """Go on with what was cut."""
        out = self._out(name)
        seconds, code = run(out, self.options, "--ray", address, "--resume")
        self.expect(code, out)
        self._compare(f"{name}, resumed", seconds)

    def _out(self, name: str) -> Path:
        return self.folder / name.replace(" ", "-")

    def _compare(self, name: str, seconds: float) -> None:
        differing = list(kill_runs.differences(self._expected, kill_runs.contents(self._out(name.split(",")[0]))))
        self.wrong += [f"{name}: {path}" for path in differing]
        print(f"{name}: {seconds:.1f} s, {len(differing)} of {len(self._expected)} files differ", flush=True)


def compare(folder: Path, options: argparse.Namespace) -> list[str]:
    """Collect in one process, on two nodes, and on two of which more and more is lost; the files that differ."""
    found = Comparison(folder, options)
    driver, head = "the driver killed half-way", "the head killed half-way"
    with cluster(folder / "cluster") as nodes:
        found.whole("two nodes", nodes.address)
        found.cut(driver, nodes.address, lambda process: process.kill(), -signal.SIGKILL)
        found.resume(driver, nodes.address)
        found.whole("a node lost half-way", nodes.address, lambda: nodes.stop(nodes.other))
        found.cut(head, nodes.address, lambda _: nodes.stop(nodes.head), NOT_RUN)
    with cluster(folder / "another") as nodes:
        found.resume(head, nodes.address)
    return found.wrong


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
