"""The pool's promises: order, isolation of crashes, no hang, clean Ctrl-C."""

from __future__ import annotations

import importlib.util
import os
import pickle
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import jobs
import pytest

from gensim2.demos.pool import JobError, WorkerPool
from gensim2.errors import InputError


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_results_come_in_order_of_the_jobs(workers: int) -> None:
    square = jobs.square
    with WorkerPool(workers) as pool:
        # The first job is the slowest: order does not come from finishing first.
        outcomes = list(pool.map(square, [(3, 0.5), (4, 0.0), (5, 0.0), (6, 0.0), (7, 0.0)]))
    assert [outcome.index for outcome in outcomes] == [0, 1, 2, 3, 4]
    assert [outcome.unwrap() for outcome in outcomes] == [9, 16, 25, 36, 49]


def test_jobs_run_in_other_processes() -> None:
    with WorkerPool(1) as pool:
        (outcome,) = pool.map(jobs.process_id, [(0,)])
    assert outcome.unwrap() != os.getpid()


@pytest.mark.parametrize("workers", [0, 1])
def test_an_error_reaches_the_caller_with_its_type_and_words(workers: int) -> None:
    with WorkerPool(workers) as pool:
        (outcome,) = pool.map(jobs.fail, [(3,)])
    assert isinstance(outcome.error, InputError)
    assert str(outcome.error) == "numbers.txt: 3: is odd (give an even one)"
    assert outcome.traceback is not None
    assert "jobs.py" in outcome.traceback
    with pytest.raises(InputError):
        outcome.unwrap()


def test_an_error_that_cannot_be_pickled_keeps_its_words() -> None:
    with WorkerPool(1) as pool:
        (outcome,) = pool.map(jobs.fail_oddly, [(3,)])
    assert isinstance(outcome.error, JobError)
    assert "LocalError: 3 and 4" in str(outcome.error)


def test_a_crash_is_the_error_of_its_job_only() -> None:
    with WorkerPool(2) as pool:
        crashed = list(pool.map(jobs.die, [(0,), (1,)]))
        after = [outcome.unwrap() for outcome in pool.map(jobs.square, [(2,), (3,)])]
    assert all(isinstance(outcome.error, JobError) for outcome in crashed)
    assert "exit code 7" in str(crashed[0].error)
    assert after == [4, 9]


def test_a_job_that_hangs_is_ended() -> None:
    begin = time.monotonic()
    with WorkerPool(1, timeout=1.5) as pool:
        (outcome,) = pool.map(jobs.hang, [(0,)])
    assert isinstance(outcome.error, JobError)
    assert "longer than" in str(outcome.error)
    assert time.monotonic() - begin < 120


def test_a_caller_may_stop_early_and_go_on_with_other_jobs() -> None:
    square = jobs.square
    taken: list[int] = []

    def endless() -> Iterator[tuple[int, float]]:
        value = 0
        while True:
            taken.append(value)
            yield value, 0.05
            value += 1

    with WorkerPool(2) as pool:
        for outcome in pool.map(square, endless()):
            if outcome.unwrap() == 9:
                break
        assert len(taken) <= 4 + 4  # at most two a worker ahead
        again = [outcome.unwrap() for outcome in pool.map(square, [(10, 0.0), (11, 0.0)])]
    assert again == [100, 121]  # nothing left over from before


def test_a_job_that_does_not_pickle_is_refused_at_once() -> None:
    with WorkerPool(1) as pool, pytest.raises((pickle.PicklingError, AttributeError)):
        list(pool.map(lambda value: value, [(1,)]))


def _runs(pid: int) -> bool:
    """Whether the process still does something: a zombie that nobody reaped does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
@pytest.mark.parametrize("ending", ["Ctrl-C to the group", "SIGTERM to the parent", "SIGKILL to the parent"])
def test_workers_end_with_the_parent(tmp_path: Path, ending: str) -> None:
    script = tmp_path / "endless.py"
    script.write_text(
        textwrap.dedent(
            f"""
            import sys
            sys.path.insert(0, {str(Path(__file__).parent)!r})
            from gensim2.demos.pool import WorkerPool
            import jobs
            if __name__ == "__main__":
                with WorkerPool(2) as pool:
                    pids = [outcome.unwrap() for outcome in pool.map(jobs.process_id, [(0,), (1,)])]
                    print(*pids, flush=True)
                    list(pool.map(jobs.hang, [(0,), (1,)]))
            """
        )
    )
    package = Path(importlib.util.find_spec("gensim2").origin).parents[1]  # type: ignore[union-attr, arg-type]
    process = subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(package)},
    )
    assert process.stdout is not None
    workers = [int(pid) for pid in process.stdout.readline().split()]
    time.sleep(0.3)
    if ending.startswith("Ctrl-C"):
        os.killpg(process.pid, signal.SIGINT)
    else:
        os.kill(process.pid, signal.Signals[ending.split()[0]])
    assert process.wait(timeout=120) != 0
    assert workers
    deadline = time.monotonic() + 60
    while any(_runs(pid) for pid in workers) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(_runs(pid) for pid in workers)


def test_a_script_without_a_guard_is_told_so(tmp_path: Path) -> None:
    script = tmp_path / "unguarded.py"
    script.write_text(
        textwrap.dedent(
            f"""
            import sys
            sys.path.insert(0, {str(Path(jobs.__file__).parent)!r})
            import jobs
            from gensim2.demos.pool import WorkerPool

            with WorkerPool(1) as pool:
                list(pool.map(jobs.square, [(3, 0.0)]))
            """
        )
    )
    result = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120, check=False)
    assert result.returncode != 0
    assert "WorkerStartError" in result.stderr
    assert '__name__ == "__main__"' in result.stderr
