"""Ctrl-C while the fork server still imports: no traceback, the program gets the signal, and both end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

PROGRAM = """
import multiprocessing, time
from gensim2.core.processes.fork_server import start_fork_server
multiprocessing.set_forkserver_preload(["slow_import"])
start_fork_server()
print("started", flush=True)
try:
    time.sleep(60)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


def test_ctrl_c_while_modules_are_imported_leaves_no_traceback_and_no_server(tmp_path: Path) -> None:
    (tmp_path / "slow_import.py").write_text(
        f"import time\nopen({str(tmp_path / 'begun')!r}, 'w').close()\ntime.sleep(600)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        while not (tmp_path / "begun").exists():
            assert program.poll() is None
            time.sleep(0.02)
        os.killpg(program.pid, signal.SIGINT)
        out, err = program.communicate(timeout=120)  # waits for the server too, which has the pipes open
    finally:
        program.kill()
    assert out.split() == ["started", "interrupted"]
    assert err == ""


def test_a_script_that_comes_through_a_pipe_has_workers(tmp_path: Path) -> None:
    script = """
from gensim2.core.processes import WorkerPool, enumerated
if __name__ == "__main__":
    with WorkerPool(1) as pool:
        print([outcome.unwrap() for outcome in pool.map_unordered(abs, enumerated([(-3,)]))])
"""
    done = subprocess.run(
        [sys.executable, "-"], input=script, capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.stdout, done.returncode) == ("[3]\n", 0), done.stderr
