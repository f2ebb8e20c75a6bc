"""The function before the driver: no command exceeds a limit, by an independent check; invalid targets are refused."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import limits as judge
import numpy as np
import pytest

from gensim2.core.errors import InputError
from gensim2.robots import robot
from gensim2_robot import arm_limits
from gensim2_robot.arm_limits import CYCLE, ArmLimits
from gensim2_robot.audit import limits_passed
from gensim2_robot.limits import RefusedError, Sent, admit, begin, halt, limit

HOME = np.array(robot("panda").reset_qpos[:7])


@pytest.fixture(scope="module")
def slow() -> ArmLimits:
    return ArmLimits.of(robot("panda"))


def test_no_limit_is_passed_by_hostile_targets() -> None:
    """The first of the million of ``benchmarks/limits.py``."""
    found = judge.run(20_000, seed=0, speed=0.1)
    assert found["passed"] == 0, found["limits"]
    assert found["moved_rad"] > 100.0  # a standing arm would exceed no limit either
    assert {"velocity", "acceleration", "position", "tool speed", "clearance", "refused"} <= set(found["clips"])


def test_limits_of_one_arm_are_not_those_of_another() -> None:
    plain = ArmLimits.of(robot("panda"))
    own = {"velocity_limits": [0.5] * 9, "acceleration_limits": [1.0] * 9}
    slow = ArmLimits.of(replace(robot("panda"), solver={**robot("panda").solver, **own}), speed=0.5)
    assert (slow.velocity == 0.25).all()
    assert (slow.acceleration == 1.0).all()
    np.testing.assert_array_equal(slow.jerk, plain.jerk)
    np.testing.assert_array_equal(ArmLimits.of(robot("panda")).acceleration, plain.acceleration)


def test_no_limit_is_passed_at_full_speed() -> None:
    found = judge.run(10_000, seed=1, speed=1.0)
    assert found["passed"] == 0, found["limits"]
    assert found["moved_rad"] > 100.0


@pytest.mark.parametrize(("speed", "margin"), [(0.1, 0.1), (1.0, 0.1), (1.0, 0.0)])
def test_no_limit_of_the_research_3_is_passed(speed: float, margin: float) -> None:
    found = judge.run(6_000, seed=2, speed=speed, name="fr3", margin=margin)
    assert found["passed"] == 0, found["limits"]
    assert found["limits"]["velocity by position"]["most"] > 0.99
    assert found["moved_rad"] > 50.0


def test_judge_and_audit_see_where_a_joint_is_too_fast_for_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """As it would be if the limits did not depend on the position."""
    whole = ArmLimits.of(robot("fr3"), speed=1.0)
    monkeypatch.setattr(arm_limits, "FR3", SimpleNamespace(scaled=lambda share: None))
    q, _, _ = judge.commands(6_000, 2, 1.0, "fr3", 0.1)
    found = judge.judge(q, 1.0, 0.1, 1.7, 0.005, "fr3")
    counts = {name: each["passed"] for name, each in found.items() if each["passed"]}
    assert list(counts) == ["velocity by position"]
    assert counts["velocity by position"] > 10
    assert limits_passed(list(q), whole) == counts["velocity by position"]


def test_limits_ahead_are_those_of_where_a_joint_comes_to() -> None:
    draw = np.random.default_rng(3)
    ends = arm_limits.FR3.scaled(0.5)
    lowest, highest = ends.range()
    for _ in range(200):
        q = draw.uniform(lowest, highest)
        up, down = ends.ahead(CYCLE).fastest(q)
        np.testing.assert_allclose(up, ends.fastest(q + CYCLE * up)[0], atol=1e-12)
        np.testing.assert_allclose(down, ends.fastest(q - CYCLE * down)[1], atol=1e-12)


def test_a_joint_of_the_research_3_comes_as_near_its_end_as_its_limits_let_it() -> None:
    limits = ArmLimits.of(robot("fr3"), speed=0.5, margin=0.0)
    sent = begin(HOME, limits)
    for _ in range(600):
        sent = limit(sent, [*HOME[:6], 4.0], limits)
    assert sent.q[6] == pytest.approx(limits.upper[6], abs=1e-4)
    assert limits.upper[6] == pytest.approx(3.0196 - (1.1 * 0.35) ** 2 / 34.0)
    for _ in range(100):
        sent = limit(sent, HOME, limits)
    assert sent.q[6] < limits.upper[6] - 0.3, "and leaves it again"


def test_the_judge_sees_what_passes() -> None:
    """Commands that move straight to a pose inside the table, a little too fast."""
    way = np.array([0.0, 1.2, 0.0, 0.6, 0.0, 0.0, 0.0])
    rows = HOME + np.linspace(0.0, 1.0, 100)[:, None] * way
    found = judge.judge(rows, 0.1, 0.1, 0.17, 0.005)
    for name in ("velocity", "acceleration", "jerk", "tool speed", "clearance", "workspace"):
        assert found[name]["passed"] > 0, name
    assert judge.judge(rows - [0, 0, 0, 1.0, 0, 0, 0], 0.1, 0.1, 0.17, 0.0)["position"]["passed"] > 0


def test_what_keeps_the_limits_is_sent_as_it_is(slow: ArmLimits) -> None:
    sent = begin(HOME, slow)
    for cycle in range(400):
        target = HOME + 0.05 * (1 - np.cos(0.5 * np.pi * CYCLE * cycle)) * np.array([1, 0, 0, -1, 0, 0, 1])
        sent = limit(sent, target, slow)
        assert sent.clips == ()
        np.testing.assert_allclose(sent.q, target, atol=1e-12)


def test_a_far_target_is_reached_and_clips_are_told(slow: ArmLimits) -> None:
    sent, target = begin(HOME, slow), HOME + 0.1
    sent = limit(sent, target, slow)
    assert "velocity" in sent.clips
    for _ in range(300):
        sent = limit(sent, target, slow)
    np.testing.assert_allclose(sent.q, target, atol=1e-6)


def test_halting_comes_to_rest(slow: ArmLimits) -> None:
    sent = begin(HOME, slow)
    for _ in range(100):
        sent = limit(sent, HOME + 1.0, slow)
    assert np.abs(sent.v).max() > 0.1
    count = 0
    while not sent.is_at_rest:
        sent, count = halt(sent), count + 1
    assert count * CYCLE <= 0.1
    assert not halt(sent).v.any()


def test_the_function_is_pure(slow: ArmLimits) -> None:
    first = limit(begin(HOME, slow), HOME + 0.3, slow)
    again = [limit(first, HOME - 0.2, slow) for _ in range(2)]
    np.testing.assert_array_equal(again[0].q, again[1].q)
    assert again[0].clips == again[1].clips


def test_margins_are_kept_and_told(slow: ArmLimits) -> None:
    sent = begin(HOME, slow)
    for _ in range(3000):
        sent = limit(sent, [*HOME[:6], slow.range_upper[6]], slow)
    assert "position" in sent.clips
    assert sent.q[6] == pytest.approx(slow.range_upper[6] - 0.1, abs=1e-6)


@pytest.mark.parametrize(
    ("action", "said"),
    [
        (np.append(np.full(7, np.nan), 1.0), "NaN"),
        (np.append(HOME, np.inf), "NaN or infinity"),
        (HOME, r"must have the shape \(8,\)"),
        (np.array(["a"] * 8), "must consist of numbers"),
        ([10**400] * 8, "must consist of numbers"),
        (np.append(HOME + 5.0, 1.0), "cannot reach"),
        (np.append(HOME + 0.3, 1.0), "the first action moves"),
    ],
)
def test_nonsense_is_refused(slow: ArmLimits, action: np.ndarray, said: str) -> None:
    with pytest.raises(RefusedError, match=said):
        admit(action, slow, HOME)


def test_later_actions_may_lie_further_off(slow: ArmLimits) -> None:
    np.testing.assert_allclose(admit(np.append(HOME + 0.3, 7.0), slow), np.append(HOME + 0.3, 1.0))


def test_force_and_nonsense_targets_are_refused(slow: ArmLimits) -> None:
    sent: Sent = begin(HOME, slow)
    for force in (141.0, np.nan):
        with pytest.raises(RefusedError, match="force"):
            limit(sent, HOME, slow, force)
    with pytest.raises(RefusedError, match="NaN"):
        limit(sent, HOME * np.nan, slow)


def test_no_start_where_the_arm_may_not_be(slow: ArmLimits) -> None:
    with pytest.raises(RefusedError, match="panda_joint4"):
        begin([*HOME[:3], -3.0, *HOME[4:]], slow)
    with pytest.raises(RefusedError, match=r"workspace|nearer"):
        begin([0.0, 1.5, 0.0, -0.5, 0.0, 2.0, 0.0], slow)


@pytest.mark.parametrize("wrong", [{"speed": 0.0}, {"speed": 1.5}, {"margin": -1.0}, {"margin": 9.0}, {"force": 0.0}])
def test_limits_that_limit_nothing_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        ArmLimits.of(robot("panda"), **wrong)


def test_a_blocked_arm_is_not_pressed_on_ever_harder(slow: ArmLimits) -> None:
    sent = begin(HOME, slow)
    for _ in range(500):
        sent = limit(sent, HOME + 1.0, slow, measured=HOME)
    assert "leash" in sent.clips
    np.testing.assert_allclose(sent.q, HOME + slow.leash, atol=1e-6)


@pytest.mark.parametrize(("force", "share"), [(17.5, 0.75), (35.0, 0.5), (70.0, 0.0), (140.0, 0.0)])
def test_an_arm_that_is_pressed_on_gives_way(slow: ArmLimits, force: float, share: float) -> None:
    sent = begin(HOME, slow)
    for _ in range(500):
        sent = limit(sent, HOME + 1.0, slow, measured=HOME)
    for _ in range(500):
        sent = limit(sent, HOME + 1.0, slow, force, HOME)
    np.testing.assert_allclose(sent.q, HOME + share * slow.leash, atol=1e-6)


def test_a_moving_target_may_lead_by_the_delay_of_the_drives(slow: ArmLimits) -> None:
    standing, moving = np.zeros(slow.size), np.full(slow.size, 0.2)
    np.testing.assert_allclose(slow.leash_under(0.0, standing), slow.leash)
    np.testing.assert_allclose(slow.leash_under(0.0, -moving), slow.leash + 0.02)
    np.testing.assert_allclose(slow.leash_under(35.0, moving), 0.5 * (slow.leash + 0.02))


def test_an_arm_remembers_that_it_was_pressed_on(slow: ArmLimits) -> None:
    """The force is over, but the arm does not hit the obstacle again at once."""
    sent = begin(HOME, slow)
    for _ in range(500):
        sent = limit(sent, HOME + 1.0, slow, 0.0, HOME, recent=35.0)
    np.testing.assert_allclose(sent.q, HOME + 0.5 * slow.leash, atol=1e-6)
