"""Questions come to meet pictures, whatever the phase in which the two began."""

from __future__ import annotations

import numpy as np
import pytest

from gensim2.deploy.arm_limits import CYCLE
from gensim2.deploy.line import FRESH_CYCLES, PERIOD_CYCLES, phase_shift


@pytest.mark.parametrize("phase", range(PERIOD_CYCLES))
def test_questions_end_up_right_after_pictures_and_stay_there(phase: int) -> None:
    question, waits = PERIOD_CYCLES, []
    for _ in range(2 * PERIOD_CYCLES):
        waited = (question - phase) % PERIOD_CYCLES
        waits.append(waited)
        question += PERIOD_CYCLES + phase_shift(waited)
    assert max(waits[PERIOD_CYCLES:]) <= FRESH_CYCLES
    assert len(set(waits[PERIOD_CYCLES:])) == 1


@pytest.mark.parametrize("phase", range(PERIOD_CYCLES))
def test_pictures_that_come_late_are_met_without_growing_too_old(phase: int) -> None:
    latency, most = 0.06, 0.15
    question, ages = PERIOD_CYCLES, []
    for _ in range(2 * PERIOD_CYCLES):
        waited = (question - phase) % PERIOD_CYCLES
        ages.append(latency + CYCLE * waited)
        question += PERIOD_CYCLES + phase_shift(waited, latency, most)
    assert (np.diff(ages) <= 1e-9).all(), "no picture is older at a question than at the first one"
    assert ages[-1] <= latency + CYCLE * FRESH_CYCLES + 1e-9


@pytest.mark.parametrize("waited", [PERIOD_CYCLES + 1, 1000])
def test_nothing_is_followed_where_no_pictures_come(waited: int) -> None:
    assert phase_shift(waited) == 0
