"""The pool: every job is run even if processes die, no job waits for a slow one, and processes end cleanly."""

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
from functools import partial
from pathlib import Path

import process_jobs as jobs
import pytest

from gensim2.core.errors import InputError, NotRunError
from gensim2.core.processes import Failure, Job, WorkerPool, enumerated, in_order, results


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_every_job_has_its_outcome(workers: int) -> None:
    with WorkerPool(workers) as pool:
        given = enumerated([(3, 0.5), (4, 0.0), (5, 0.0), (6, 0.0), (7, 0.0)])
        outcomes = {outcome.index: outcome.unwrap() for outcome in pool.map_unordered(jobs.square, given)}
    assert outcomes == {0: 9, 1: 16, 2: 25, 3: 36, 4: 49}


def test_a_slow_job_holds_up_no_other() -> None:
    with WorkerPool(2) as pool:
        given = enumerated([(0, 3.0), *((value, 0.0) for value in range(1, 20))])
        order = [outcome.index for outcome in pool.map_unordered(jobs.square, given)]
        assert order[-1] == 0  # all others end while the first one runs
        ordered = [o.index for o in in_order(pool.map_unordered(jobs.square, enumerated([(0, 0.5), (1, 0.0)])))]
    assert ordered == [0, 1]


def test_jobs_run_in_other_processes() -> None:
    with WorkerPool(1) as pool:
        (outcome,) = pool.map_unordered(jobs.process_id, [Job(0, (0,))])
    assert outcome.unwrap() != os.getpid()


@pytest.mark.parametrize("workers", [pytest.param(0, marks=pytest.mark.fast), 1])
def test_an_error_on_purpose_is_an_answer(workers: int) -> None:
    failures: list[Failure] = []
    with WorkerPool(workers, on_failure=failures.append) as pool:
        (outcome,) = pool.map_unordered(jobs.fail, [Job(0, (3,))])
    assert isinstance(outcome.error, InputError)
    assert str(outcome.error) == "numbers.txt: 3: is odd (give an even one)"
    assert not failures  # it ran once
    with pytest.raises(InputError):
        outcome.unwrap()


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        (jobs.fail_by_a_bug, "ZeroDivisionError"),
        (jobs.fail_oddly, "LocalError: 3 and 4"),
        (jobs.panic, "BaseException"),
    ],
)
def test_a_bug_is_no_result_and_leaves_its_traceback(function: object, reason: str) -> None:
    failures: list[Failure] = []
    with WorkerPool(1, on_failure=failures.append) as pool:
        (outcome,) = pool.map_unordered(function, [Job(7, (3,))])  # type: ignore[arg-type]
    assert outcome.failures == tuple(failures)
    assert [failure.number for failure in failures] == [1, 2, 3]
    assert all(reason in failure.reason and "process_jobs.py" in str(failure.traceback) for failure in failures)
    with pytest.raises(NotRunError, match="7"):
        outcome.unwrap()


@pytest.mark.parametrize("needed", [2, 3])
def test_a_killed_job_is_run_again_in_a_fresh_process(tmp_path: Path, needed: int) -> None:
    tries = tmp_path / "tries"
    with WorkerPool(2) as pool:
        given = [Job(0, (0, str(tries), needed)), *(Job(n, (n, str(tmp_path / f"{n}"), 1)) for n in (1, 2, 3))]
        found = dict(results(pool.map_unordered(jobs.die_at_first, given), "numbers"))
    assert found == {0: (0, needed), 1: (1, 1), 2: (2, 1), 3: (3, 1)}
    assert len(set(tries.read_text().split())) == needed


def test_what_cannot_be_run_is_named_when_all_others_are_done(tmp_path: Path) -> None:
    with WorkerPool(2) as pool:
        first, last = (Job(n, (n, str(tmp_path / f"{n}"), 99)) for n in (2, 5))
        others = [Job(n, (n, str(tmp_path / f"{n}"), 1)) for n in (1, 3, 4, 6)]
        outcomes = pool.map_unordered(jobs.die_at_first, [first, last, *others])
        run = results(outcomes, "numbers", Path("/x.log"))
        found = [next(run)[0] for _ in others]
        with pytest.raises(NotRunError, match=r"numbers: could not be run: 2, 5 .*SIGKILL.*/x\.log.*--resume"):
            next(run)
    assert sorted(found) == [1, 3, 4, 6]


def test_where_nothing_can_be_run_not_everything_is_tried() -> None:
    failures: list[Failure] = []
    with WorkerPool(1, on_failure=failures.append) as pool:
        outcomes = list(pool.map_unordered(jobs.die, enumerated((n,) for n in range(50))))
    assert len(outcomes) == 50
    assert len(failures) == 9
    assert "not tried" in outcomes[-1].failures[0].reason


def test_a_job_that_hangs_is_ended() -> None:
    begin = time.monotonic()
    with WorkerPool(1, time_limit=1.0) as pool:
        (outcome,) = pool.map_unordered(jobs.hang, [Job(0, (0,))])
    assert "longer than 1 s" in outcome.failures[-1].reason
    assert time.monotonic() - begin < 120


def test_workers_are_renewed() -> None:
    with WorkerPool(1, jobs_per_worker=2) as pool:
        pids = [o.unwrap() for o in pool.map_unordered(jobs.process_id, enumerated((n,) for n in range(6)))]
    assert pids[0] == pids[1]
    assert pids[2] == pids[3]
    assert len(set(pids)) == 3


def test_a_process_is_prepared_once_before_its_jobs_and_not_on_their_account() -> None:
    with WorkerPool(2, prepare=partial(jobs.prepare_at_length, 7), jobs_per_worker=2) as pool:
        outcomes = list(pool.map_unordered(jobs.prepared, enumerated((n,) for n in range(6))))
        assert [outcome.unwrap() for outcome in outcomes] == [[7]] * 6
        assert sum(outcome.cpu_s for outcome in outcomes) < 0.25
        (outcome,) = pool.map_unordered(jobs.spin, [Job(0, (0.3,))])
        assert 0.3 <= outcome.cpu_s < 0.5


def test_what_cannot_be_prepared_is_left_to_the_jobs() -> None:
    with WorkerPool(1, prepare=partial(jobs.fail_by_a_bug, 1)) as pool:
        (outcome,) = pool.map_unordered(jobs.square, [Job(0, (3,))])
        assert outcome.unwrap() == 9


@pytest.mark.parametrize("workers", [0, 1, 3])
def test_what_is_submitted_may_depend_on_what_came_before(workers: int) -> None:
    done: set[int] = set()

    def one_after_the_other() -> Iterator[Job | None]:
        for value in range(4):
            while len(done) < value:
                yield None
            yield Job(value, (value, 0.0))
        while True:  # no job: the end if none is running
            yield None

    with WorkerPool(workers) as pool:
        for outcome in pool.map_unordered(jobs.square, one_after_the_other()):
            done.add(outcome.index)
            assert done == set(range(outcome.index + 1))
    assert len(done) == 4


def test_a_caller_may_stop_early_and_go_on_with_other_jobs() -> None:
    taken: list[int] = []

    def endless() -> Iterator[Job]:
        while True:
            taken.append(len(taken))
            yield Job(taken[-1], (taken[-1], 0.05))

    with WorkerPool(2) as pool:
        for outcome in pool.map_unordered(jobs.square, endless()):
            if outcome.unwrap() == 9:
                break
        assert len(taken) <= 4 + 4
        again = sorted(o.unwrap() for o in pool.map_unordered(jobs.square, enumerated([(10, 0.0), (11, 0.0)])))
    assert again == [100, 121]  # no results of earlier jobs


def test_a_job_that_does_not_pickle_is_refused_at_once() -> None:
    with WorkerPool(1) as pool, pytest.raises((pickle.PicklingError, AttributeError)):
        list(pool.map_unordered(lambda value: value, [Job(0, (1,))]))


def _runs(pid: int) -> bool:
    """Return whether a process is alive; a zombie is not."""
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
            from gensim2.core.processes import WorkerPool, enumerated
            import process_jobs as jobs
            if __name__ == "__main__":
                with WorkerPool(2) as pool:
                    two = enumerated([(0, 1.0), (1, 1.0)])
                    pids = [outcome.unwrap() for outcome in pool.map_unordered(jobs.process_id, two)]
                    print(*pids, flush=True)
                    list(pool.map_unordered(jobs.hang, enumerated([(0,), (1,)])))
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


@pytest.mark.parametrize("first", ["", "Execution(1), open('output', 'x')"])
def test_a_script_without_a_guard_is_told_so(tmp_path: Path, first: str) -> None:
    script = tmp_path / "unguarded.py"
    script.write_text(
        textwrap.dedent(
            f"""
            import sys
            sys.path.insert(0, {str(Path(jobs.__file__).parent)!r})
            import process_jobs as jobs
            from gensim2.core.processes import Execution, Job, WorkerPool

            {first}
            with WorkerPool(1) as pool:
                list(pool.map_unordered(jobs.square, [Job(0, (3, 0.0))]))
            """
        )
    )
    result = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=120, check=False, cwd=tmp_path
    )
    assert result.returncode != 0
    assert result.stderr.count("Traceback") == 1, "the worker process prints nothing"
    assert "WorkerStartError" in result.stderr.splitlines()[-1]
    assert '__name__ == "__main__"' in result.stderr
