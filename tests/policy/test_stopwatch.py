"""Times of stages agree with the clocks."""

from __future__ import annotations

import time

import pytest

from gensim2.policy.latency import Stopwatch


def test_stages_and_their_sum_are_told_without_the_first_passes_and_those_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wall = iter([0.0, 9.0, 99.0, 1.0, 1.25, 2.0, 5.0, 7.0, 3.0, 3.5, 4.5])
    cpu = iter([0.0, 9.0, 99.0, 1.0, 1.125, 1.5, 5.0, 7.0, 3.0, 3.25, 3.5])

    monkeypatch.setattr(time, "perf_counter", lambda: next(wall))
    monkeypatch.setattr(time, "process_time", lambda: next(cpu))
    watch = Stopwatch("look", "think")
    for marks, kept in ((2, True), (2, True), (1, False), (2, True)):
        watch.begin()
        for _ in range(marks):
            watch.mark()
        if kept:
            watch.keep()
    assert len(watch) == 3
    assert watch.percentiles(warm_up=2) == {
        "p50": {"look": 500.0, "think": 1000.0, "total": 1500.0},
        "p95": {"look": 500.0, "think": 1000.0, "total": 1500.0},
        "cpu": {"look": 250.0, "think": 250.0, "total": 500.0},
    }
    assert watch.percentiles(warm_up=1)["p50"] == {"look": 375.0, "think": 875.0, "total": 1250.0}
