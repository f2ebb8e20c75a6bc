"""Requests follow the images' timing, whatever the initial phase."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from gensim2.robots import robot
from gensim2_robot.arm import LimitedArm
from gensim2_robot.arm_limits import CYCLE, ArmLimits
from gensim2_robot.clocks import SimulatedClock
from gensim2_robot.devices import CameraFrame
from gensim2_robot.line import FRESH_CYCLES, PERIOD_CYCLES, Line, phase_shift
from gensim2_robot.log import Journals
from gensim2_robot.simulated import simulated_cameras
from gensim2_robot.watch import Watch


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


class Still:
    """An arm without output, and a controller without requests."""

    profile, is_alive = robot("panda"), True

    def poll(self) -> list[Any]:
        return []


class Given:
    """Cameras whose next images are given by the test."""

    cameras = simulated_cameras(Still.profile, 8, 6)[:2]
    serials: Mapping[str, str] = {}

    def __init__(self) -> None:
        self.next: list[CameraFrame] = []

    def poll(self) -> list[CameraFrame]:
        found, self.next = self.next, []
        return found

    def give(self, which: int) -> None:
        name = self.cameras[which].name
        self.next.append(CameraFrame(name, 0, 0.0, np.ones((6, 8), np.uint16), np.zeros((6, 8, 3), np.uint8)))


def test_pictures_of_a_set_that_was_not_complete_are_forgotten_with_their_episode() -> None:
    cameras, still = Given(), Still()
    arm = LimitedArm(still, ArmLimits.of(Still.profile))  # type: ignore[arg-type]
    line = Line(arm, cameras, still, Watch(), SimulatedClock(), Journals(), pace=20.0)  # type: ignore[arg-type]
    cameras.give(0)
    line.cycle()
    line.forget()
    cameras.give(1)
    line.cycle()
    assert set(line.frames) == {Given.cameras[1].name}
