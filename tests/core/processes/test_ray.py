"""The Ray pool behaves like the local one; all tests of this file share a small cluster."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import process_jobs as jobs
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "kill"))

import fake_world
import kill_runs

from gensim2.cli.main import BAD_INPUT, run
from gensim2.core.errors import InputError, NotRunError
from gensim2.core.processes import Job, WorkerPool, enumerated, execution, results
from gensim2.evaluation import evaluating
from gensim2.rollout import worker

pytest.importorskip("ray")

from gensim2.core.processes import executor as executors
from gensim2.core.processes import ray as ray_pools
from gensim2.core.processes.ray import Head, RayPool, check_address

CONTROLLERS = Path(__file__).parents[2] / "rollout" / "controllers.py"


@pytest.fixture(scope="module")
def pool() -> Iterator[RayPool]:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FAKE_EPISODE_SECONDS", "0")  # read by the fake world in the actors
        # An actor takes one or two seconds of CPU to start, so few are replaced.
        with RayPool("local", 2, time_limit=60.0, jobs_per_worker=12) as found:
            assert signal.getsignal(signal.SIGTERM) is before  # Ray would set its own handler
            yield found


def test_every_job_has_the_outcome_that_it_has_on_this_machine(pool: RayPool) -> None:
    given = [(value, 0.0) for value in range(8)]
    with WorkerPool(0) as here:
        expected = {o.index: o.unwrap() for o in here.map_unordered(jobs.square, enumerated(given))}
    assert {o.index: o.unwrap() for o in pool.map_unordered(jobs.square, enumerated(given))} == expected


SMALL = ["--assets", "builtin", "--seed", "3"]


@pytest.mark.parametrize(
    "words",
    [
        ["collect", "OpenDrawer", "CloseBox", "--episodes", "3"],
        ["benchmark", "OpenDrawer", "--runs", "2", "--episodes", "2"],
        ["evaluate", "OpenDrawer", "--controller", f"{CONTROLLERS}:Rest", "--episodes", "3"],
        ["run-pipeline", "--num-tasks", "1", "--verify", "5", "--episodes", "1", "--videos", "0", "--library", "none"],
    ],
    ids=lambda words: words[0],
)
def test_commands_leave_the_bytes_that_they_leave_on_this_machine(
    words: Sequence[str], pool: RayPool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in fake_world.REPLACED:
        monkeypatch.setattr(worker, name, getattr(worker, name))
    fake_world.install()
    monkeypatch.setattr(fake_world, "EPISODE_SECONDS", 0.0)
    monkeypatch.setattr(evaluating, "_episode", jobs.evaluated)
    monkeypatch.setattr(execution, "WorkerPool", lambda _, **given: WorkerPool(0, **given))
    asked: list[tuple[Any, ...]] = []
    monkeypatch.setattr(ray_pools, "RayPool", lambda *where, **_: asked.append(where) or pool)
    monkeypatch.setattr(pool, "close", lambda: None)
    monkeypatch.setattr(pool, "_jobs_per_worker", 1000)
    here, there = tmp_path / "here", tmp_path / "there"
    assert run([*words, *SMALL, "--workers", "1", "--out", str(here)]) == 0
    assert asked == []
    assert run([*words, *SMALL, "--ray", "local", "--out", str(there)]) == 0
    assert asked == [("local", None)]
    ours, theirs = kill_runs.contents(there), kill_runs.contents(here)
    if words[0] != "collect":  # run.json of collect has no results
        said = [contents["run.json"]["arguments"] for contents in (ours, theirs)]
        assert [(each.pop("workers"), each.pop("ray")) for each in said] == [(None, "local"), (1, None)]
    assert list(kill_runs.differences(ours, theirs)) == []
    assert len(ours) > 1


def test_jobs_run_in_processes_that_are_renewed(pool: RayPool) -> None:
    pids = [o.unwrap() for o in pool.map_unordered(jobs.process_id, enumerated((n, 0.0) for n in range(20)))]
    assert os.getpid() not in pids
    assert max(pids.count(pid) for pid in pids) <= 12
    assert len(set(pids)) > 2  # 28 jobs so far


def test_an_error_on_purpose_is_an_answer(pool: RayPool) -> None:
    (outcome,) = pool.map_unordered(jobs.fail, [Job(5, (3,))])
    assert isinstance(outcome.error, InputError)
    assert str(outcome.error) == "numbers.txt: 3: is odd (give an even one)"
    with pytest.raises(InputError):
        list(results(pool.map_unordered(jobs.fail, [Job(5, (3,))]), "numbers"))


def test_a_bug_is_no_result_and_leaves_its_traceback(pool: RayPool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "TRIES", 2)  # each try starts a process
    (outcome,) = pool.map_unordered(jobs.fail_by_a_bug, [Job(5, (3,))])
    assert [failure.number for failure in outcome.failures] == [1, 2]
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


def test_a_job_that_hangs_is_ended(pool: RayPool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "TRIES", 1)
    monkeypatch.setattr(pool, "_time_limit", 1.0)
    (outcome,) = pool.map_unordered(jobs.hang, [Job(0, (1,))])
    assert outcome.failures[0].reason == "took longer than 1 s"


def test_a_caller_may_stop_early_and_go_on_with_other_jobs(pool: RayPool) -> None:
    given = enumerated([(1, 0.0), (2, 900.0)])
    begin = time.monotonic()
    for outcome in pool.map_unordered(jobs.square, given):
        assert outcome.unwrap() == 1
        break
    (last,) = pool.map_unordered(jobs.square, [Job(0, (3,))])
    assert last.unwrap() == 9
    assert time.monotonic() < begin + 600


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
    monkeypatch.setattr(ray_pools, "GONE_SECONDS", 0.1)
    gone = Head("127.0.0.1:1")
    deadline = time.monotonic() + 30
    while not gone.is_gone and time.monotonic() < deadline:
        time.sleep(0.05)
    monkeypatch.setattr(pool, "_head", gone)
    with pytest.raises(NotRunError, match=r"jobs on Ray: could not be run: 7 .*127.0.0.1:1, does not answer.*--resume"):
        list(pool.map_unordered(jobs.square, [Job(7, (3, 0.0))]))


def test_addresses_are_checked_before_anything_starts(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for command in ("collect", "benchmark", "evaluate", "run-pipeline"):
        words = ["--episodes", "1", "--out", str(tmp_path / "out"), "--ray", "nowhere"]
        about = ["OpenDrawer", "--controller", f"{CONTROLLERS}:Rest"] if command == "evaluate" else []
        assert run([command, *about, *words]) == BAD_INPUT
        assert capfd.readouterr().err == (
            "gensim2: --ray: 'nowhere' is not a Ray address (local, auto, or HOST:PORT of the head node)\n"
        )
    assert not (tmp_path / "out").exists()
    for address in ("", "nowhere", "host", "host:port", "ray://host:1", "a b:1"):
        with pytest.raises(InputError, match=r"--ray: .* is not a Ray address"):
            check_address(address)
    for address in ("local", "auto", "10.0.0.1:6379", "head.example:6379"):
        check_address(address)
