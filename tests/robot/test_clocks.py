"""Cycles of a control loop that runs by the machine's clock."""

from __future__ import annotations

import gc
import os
import sys
import threading

import pytest

from gensim2_robot import clocks
from gensim2_robot.clocks import MachineClock

linux = pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="a kernel without such policies")


def policy() -> int:
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK


@linux
def test_the_loop_goes_first_and_what_it_begins_does_not() -> None:
    began: list[int] = []
    interval = sys.getswitchinterval()
    with MachineClock().punctual() as scheduling:
        assert policy() == (os.SCHED_FIFO if scheduling == "fifo" else os.SCHED_OTHER)
        assert sys.getswitchinterval() == pytest.approx(clocks.SWITCH_INTERVAL)
        assert gc.get_freeze_count() > 0
        thread = threading.Thread(target=lambda: began.append(policy()))
        thread.start()
        thread.join()
    assert began == [os.SCHED_OTHER]
    assert policy() == os.SCHED_OTHER
    assert sys.getswitchinterval() == pytest.approx(interval)
    assert gc.get_freeze_count() == 0


@linux
def test_a_loop_that_may_not_go_first_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with MachineClock().punctual() as scheduling:
        assert scheduling == "other"
        assert policy() == os.SCHED_OTHER
