"""Ray's pool keeps the promises of the one on this machine; one small cluster for all tests of this file."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import process_jobs as jobs
import pytest

from gensim2.errors import InputError, NotRunError
from gensim2.processes import Job, WorkerPool, enumerated, results

pytest.importorskip("ray")

from gensim2.processes.ray import RayPool, check_address
from gensim2.processes.ray_head import GONE_SECONDS, Head


@pytest.fixture(scope="module")
def pool() -> Iterator[RayPool]:
    before = signal.getsignal(signal.SIGTERM)
    with RayPool("local", 2, time_limit=20.0, jobs_per_worker=12) as found:
        assert signal.getsignal(signal.SIGTERM) is before  # Ray would have its own
        yield found


def test_every_job_has_the_outcome_that_it_has_on_this_machine(pool: RayPool) -> None:
    given = [(value, 0.0) for value in range(30)]  # more than two actors are for
    with WorkerPool(0) as here:
        expected = {o.index: o.unwrap() for o in here.map_unordered(jobs.square, enumerated(given))}
    assert {o.index: o.unwrap() for o in pool.map_unordered(jobs.square, enumerated(given))} == expected


def test_jobs_run_in_processes_that_are_renewed(pool: RayPool) -> None:
    pids = [o.unwrap() for o in pool.map_unordered(jobs.process_id, enumerated((n, 0.0) for n in range(40)))]
    assert os.getpid() not in pids
    assert max(pids.count(pid) for pid in pids) <= 12


def test_an_error_on_purpose_is_an_answer(pool: RayPool) -> None:
    (outcome,) = pool.map_unordered(jobs.fail, [Job(5, (3,))])
    assert isinstance(outcome.error, InputError)
    assert str(outcome.error) == "numbers.txt: 3: is odd (give an even one)"
    with pytest.raises(InputError):
        list(results(pool.map_unordered(jobs.fail, [Job(5, (3,))]), "numbers"))


def test_a_bug_is_no_result_and_leaves_its_traceback(pool: RayPool) -> None:
    (outcome,) = pool.map_unordered(jobs.fail_by_a_bug, [Job(5, (3,))])
    assert [failure.number for failure in outcome.failures] == [1, 2, 3]
    assert outcome.failures[0].reason.startswith("ZeroDivisionError")
    assert "fail_by_a_bug" in str(outcome.failures[0].traceback)
    with pytest.raises(NotRunError):
        outcome.unwrap()


def test_a_killed_job_is_run_again_in_a_fresh_process(pool: RayPool, tmp_path: Path) -> None:
    told: list[object] = []
    pool._on_failure = told.append
    outcomes = list(pool.map_unordered(jobs.die_at_first, [Job(0, (7, str(tmp_path / "tries"), 2))]))
    assert outcomes[0].unwrap() == (7, 2)
    assert len(set((tmp_path / "tries").read_text().split())) == 2
    assert len(told) == 1


def test_a_job_that_hangs_is_ended(pool: RayPool) -> None:
    pool._time_limit = 1.0
    try:
        (outcome,) = pool.map_unordered(jobs.hang, [Job(0, (1,))])
    finally:
        pool._time_limit = 20.0
    assert outcome.failures[0].reason == "took longer than 1 s"


def test_a_caller_may_stop_early_and_go_on_with_other_jobs(pool: RayPool) -> None:
    given = enumerated([(1, 0.0), (2, 60.0)])
    begin = time.monotonic()
    for outcome in pool.map_unordered(jobs.square, given):
        assert outcome.unwrap() == 1
        break
    (last,) = pool.map_unordered(jobs.square, [Job(0, (3,))])
    assert last.unwrap() == 9
    assert time.monotonic() < begin + 55


def test_what_is_submitted_may_depend_on_what_came_before(pool: RayPool) -> None:
    found: list[int] = []

    def wanted() -> Iterator[Job | None]:
        for index in range(4):
            while len(found) < index:
                yield None
            yield Job(index, (index,))

    for outcome in pool.map_unordered(jobs.square, wanted()):
        found.append(outcome.unwrap())
    assert found == [0, 1, 4, 9]


def test_environments_have_one_thread_each_and_our_variables(pool: RayPool) -> None:
    (outcome,) = pool.map_unordered(os.getenv, [Job(0, ("RAYON_NUM_THREADS",))])
    assert outcome.unwrap() == "1"


def test_a_head_that_is_gone_ends_the_jobs_before_ray_ends_the_process(
    pool: RayPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = Head("127.0.0.1:1")
    monkeypatch.setattr(gone, "_answered", time.monotonic() - GONE_SECONDS - 1)
    monkeypatch.setattr(pool, "_head", gone)
    with pytest.raises(NotRunError, match=r"jobs on Ray: could not be run: 7 .*127.0.0.1:1, does not answer.*--resume"):
        list(pool.map_unordered(jobs.square, [Job(7, (3, 0.0))]))


def test_addresses_are_checked_before_anything_starts() -> None:
    for address in ("", "nowhere", "host", "host:port", "ray://host:1", "a b:1"):
        with pytest.raises(InputError, match=r"--ray: .* is no address of Ray"):
            check_address(address)
    for address in ("local", "auto", "10.0.0.1:6379", "head.example:6379"):
        check_address(address)
