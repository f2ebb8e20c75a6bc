"""From timed targets to commands: on time, within the limits, at rest when targets end."""

from __future__ import annotations

import numpy as np
import pytest

from gensim2.robots import robot
from gensim2_robot.arm import Streamer
from gensim2_robot.arm_limits import CYCLE, ArmLimits
from gensim2_robot.audit import limits_passed
from gensim2_robot.limits import Sent, begin, limit

HOME = np.array(robot("panda").reset_qpos[:7])
WAY = np.array([0.1, -0.05, 0.08, 0.1, 0.0, 0.06, 0.1])


@pytest.fixture(scope="module")
def limits() -> ArmLimits:
    return ArmLimits.of(robot("panda"), speed=0.5)


def at(time: float) -> np.ndarray:
    """Return a smooth motion that keeps the limits."""
    return HOME + WAY * (1.0 - np.cos(np.pi * time))


def stream(limits: ArmLimits, seconds: float, until: float) -> tuple[Streamer, Sent, list[np.ndarray], set[str]]:
    """Request two targets, 0.1 s ahead, every 0.1 s; none arrive after ``until``."""
    streamer, sent, found, clips = Streamer(limits), begin(HOME, limits), [], set[str]()
    for cycle in range(round(seconds / CYCLE)):
        now = cycle * CYCLE
        if cycle % 10 == 0 and now < until:
            stamps = [now + 0.15, now + 0.2]
            streamer.add([(stamp, at(max(stamp - 0.1, 0.0))) for stamp in stamps], sent, now)
        sent = limit(sent, streamer.at(now + CYCLE, sent), limits)
        found.append(sent.q)
        clips |= set(sent.clips)
    return streamer, sent, found, clips


def test_a_smooth_motion_is_followed_in_time_without_a_clip(limits: ArmLimits) -> None:
    _, _, found, clips = stream(limits, 3.0, 9.0)
    assert clips == set()
    times = CYCLE * (np.arange(len(found)) + 1)
    wanted = np.array([at(max(time - 0.1, 0.0)) for time in times])
    # The shortest durations of the segments add up to about 20 ms of delay.
    assert np.abs(np.array(found) - wanted)[20:].max() < 0.01


def test_where_no_more_targets_come_the_arm_rests_by_itself(limits: ArmLimits) -> None:
    _, sent, found, clips = stream(limits, 2.0, 0.75)
    assert clips == set()
    assert sent.is_at_rest
    assert np.abs(np.array(found)[95:] - found[-1]).max() < 1e-9


def test_braking_keeps_to_the_path(limits: ArmLimits) -> None:
    streamer, sent, _, _ = stream(limits, 0.75, 9.0)
    now = 0.75
    path = np.array([streamer.at(time, sent) for time in np.arange(now, now + 0.3, 1e-4)])
    seconds = streamer.brake(now)
    cycles = 0
    while not sent.is_at_rest:
        now, cycles = now + CYCLE, cycles + 1
        sent = limit(sent, streamer.at(now, sent), limits)
        assert sent.clips == ()
        assert np.linalg.norm(path - sent.q, axis=1).min() < 1e-3
    assert cycles * CYCLE <= 0.3
    # The commands are three cycles late, and a stop takes whole cycles.
    assert seconds <= cycles * CYCLE <= (np.ceil(seconds / CYCLE) + 3.0) * CYCLE + 1e-9


def test_the_research_3_slows_down_towards_the_end_of_its_range_by_itself() -> None:
    """The motion keeps the velocity limits of each position, so nothing is clipped afterwards."""
    limits = ArmLimits.of(robot("fr3"), speed=0.1)
    streamer, sent, found = Streamer(limits), begin(HOME, limits), [HOME]
    target = np.append(HOME[:6], 2.9)
    for cycle in range(1000):
        now = cycle * CYCLE
        if cycle % 10 == 0:
            streamer.add([(now + 0.15, target), (now + 0.2, target)], sent, now)
        sent = limit(sent, streamer.at(now + CYCLE, sent), limits)
        assert sent.clips == ()
        found.append(sent.q)
    assert sent.q[6] == pytest.approx(2.9, abs=1e-6)
    assert np.diff(np.array(found)[:, 6]).max() / CYCLE == pytest.approx(0.526, rel=2e-3), "away from the end"
    assert limits_passed(found, limits) == 0


def test_late_targets_are_dropped_and_counted(limits: ArmLimits) -> None:
    streamer, sent = Streamer(limits), begin(HOME, limits)
    streamer.add([(0.9, HOME + 0.1), (1.0, HOME + 0.1), (1.3, HOME + 0.02)], sent, 1.0)
    assert streamer.late == 2
    np.testing.assert_allclose(streamer.at(5.0, sent), HOME + 0.02, atol=0.01)


def test_standing_targets_are_no_motion(limits: ArmLimits) -> None:
    streamer, sent = Streamer(limits), begin(HOME, limits)
    streamer.add([(0.1, HOME), (0.2, HOME)], sent, 0.0)
    np.testing.assert_array_equal(streamer.at(0.15, sent), HOME)


@pytest.mark.parametrize("late", [0, 3, 7])
def test_an_arm_stays_at_a_repeated_target(limits: ArmLimits, late: int) -> None:
    """One target is repeated every 0.1 s; with ``late`` above 0, its time is only a few cycles away."""
    streamer, sent, target, found = Streamer(limits), begin(HOME, limits), HOME + 0.05, [HOME]
    for cycle in range(400):
        now = cycle * CYCLE
        if cycle % 10 == 0:
            streamer.add([(now + 0.1 - late * CYCLE, target)], sent, now)
        sent = limit(sent, streamer.at(now + CYCLE, sent), limits)
        found.append(sent.q)
    assert np.abs(np.array(found)[100:] - target).max() < 1e-6
    assert np.array(found)[:100].max(axis=0) == pytest.approx(target, abs=2e-3), "no joint passes its target by far"
