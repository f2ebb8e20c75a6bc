"""Memory of ``gensim2 policy serve`` and the delay of its loop while four strangers send the most that they can.

``python benchmarks/policy_server_strangers.py [--seconds 20] [--json OUT]`` serves a controller that stands still, asks
it for ten actions a second, and lets four strangers attack meanwhile: each sends messages of 16 MiB, empty fragments,
pings, or opens connections, again and again.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.perception import Observation, ObservationSpec
from gensim2.perception.observation import STATE, VELOCITY
from gensim2.policy.remote.client import RemoteController
from gensim2.policy.remote.protocol import MAX_BYTES, TOKEN

STRANGERS = 4
PERIOD = 0.1
HANDSHAKE = (
    b"GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


def frame(opcode: int, data: bytes, final: bool = True) -> bytes:
    """Return one masked frame; the mask is zero."""
    head = bytes([(0x80 if final else 0) | opcode])
    if len(data) < 126:
        head += bytes([0x80 | len(data)])
    else:
        head += bytes([0xFF]) + len(data).to_bytes(8, "big")
    return head + bytes(4) + data


LARGE = frame(2, b"\xdd" + (MAX_BYTES - 5).to_bytes(4, "big") + b"\x80" * (MAX_BYTES - 5))
PARTS = frame(2, b"", final=False) + frame(0, b"", final=False) * 10_000
PINGS = frame(9, b"x" * 125) * 1000
ATTACKS = {"large": LARGE, "fragments": PARTS, "pings": PINGS, "connections": b""}


def attack(host: str, port: int, data: bytes) -> None:
    """Connect and send, again and again; a closed connection is opened anew."""
    while True:
        with contextlib.suppress(OSError), socket.create_connection((host, port), timeout=5.0) as peer:
            peer.sendall(HANDSHAKE)
            if data:
                peer.recv(4096)
                while True:
                    peer.sendall(data)


def measure(seconds: float, which: list[str]) -> dict[str, float]:
    """Return the memory of the server, MB, and the delays of its loop, ms."""
    os.environ[TOKEN] = "a token of no worth"
    words = ["policy", "serve", f"{Path(__file__).resolve()}:Still", "--port", "0"]
    server = subprocess.Popen([sys.executable, "-u", "-m", "gensim2", *words], stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    for line in server.stdout:
        if found := re.search(r"ws://([\d.]+):(\d+)", line):
            break
    threading.Thread(target=server.stdout.read, daemon=True).start()
    host, port = found[1], int(found[2])  # type: ignore[index]
    controller = RemoteController(f"ws://{host}:{port}", deadline=60.0)
    seen = Observation(0, 0.0, "", {STATE: np.zeros(9, "f4"), VELOCITY: np.zeros(9, "f4")}, None, {})
    controller.reset(seen, 0)
    before = memory(server.pid)
    attackers: list[subprocess.Popen[Any]] = [
        subprocess.Popen([sys.executable, __file__, "--attack", which[number % len(which)], host, str(port)])
        for number in range(STRANGERS if which else 0)
    ]
    delays, until = [], time.monotonic() + seconds
    try:
        time.sleep(2.0)  # the attackers start
        while time.monotonic() < until:
            begun = time.monotonic()
            controller.act(seen)
            delays.append(1e3 * (time.monotonic() - begun))
            time.sleep(max(0.0, begun + PERIOD - time.monotonic()))
        peak = memory(server.pid)
    finally:
        for each in (*attackers, server):
            each.kill()
            each.wait()
    return {
        "before_mb": before,
        "peak_mb": peak,
        "requests": len(delays),
        "median_ms": float(np.median(delays)),
        "worst_ms": max(delays),
        "over_150_ms": sum(each > 150.0 for each in delays),
    }


def memory(pid: int) -> float:
    """Return the highest memory of a process, MB."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(re.search(r"VmHWM:\s+(\d+)", status)[1]) / 1000.0  # type: ignore[index]


class Still:
    """A controller that does nothing."""

    observation_spec = ObservationSpec(modalities=())

    def reset(self, observation: Observation, seed: int) -> None:
        """Begin an episode."""

    def act(self, observation: Observation) -> np.ndarray:
        """Return the same action always."""
        return np.zeros(8, np.float32)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--attack", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.attack:
        kind, host, port = options.attack
        os.nice(19)  # on machines of their own they would take no time of this one
        attack(host, int(port), ATTACKS[kind])
    found = {}
    for name, kinds in {"nobody": [], **{kind: [kind] for kind in ATTACKS}, "all": list(ATTACKS)}.items():
        found[name] = measure(options.seconds, kinds)
        print(name, json.dumps(found[name]), flush=True)
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
