"""Sampling of strategies that learns from diagnoses: failing choices are drawn later, and working ones earlier."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from gensim2.design import Affordance, CandidateResult, StageResult, steering
from gensim2.design.base import Candidate
from gensim2.design.diagnosis import diagnoses
from gensim2.design.joint_search import OPENED, alignments
from gensim2.design.manipulation import Manipulation


def hits(body: str) -> dict[str, Any]:
    """Return a plan that ends with the given result."""
    return {"unreached": "pre_0", "collisions": [{"bodies": ["panda_hand", body], "distance": 0.0, "toward": "pre_0"}]}


IN_TABLE, IN_DOOR = hits("table"), hits("door/link_1")
ROLL_MISSES = {"residuals": [{"name": "frame_axis_orthogonal(a, b)", "residual": 0.5, "tolerance": 0.15}]}
STOPS = {"unreached": "post_0"}


@cache
def pool() -> list[Manipulation]:
    """Every alignment of a door with two keypoints."""
    points = {"articulated_object_head": 0.3, "articulated_object_inside": 0.2}
    thing = Affordance(
        asset_class="door",
        kind="articulated",
        noun="door",
        description="",
        size=(0.3, 0.3, 0.3),
        mass=1.0,
        keypoints=dict.fromkeys(points, ""),
        lever_arms=points,
        joint_type="revolute",
        joint_range=(0.0, 1.5),
    )
    return list(alignments(thing, True, OPENED))


def planned(one: Manipulation, plan: dict[str, Any] | None) -> CandidateResult:
    """Return the planning result in one scene."""
    failed = [] if plan is None else [("collision", {"step": "open", "plan": plan})]
    stage = StageResult("plan", 1, float(plan is None), {}, 0.0, diagnoses(failed))
    return CandidateResult(Candidate("", {"open": {"designed": {}}}, one.provenance()), (stage,))


def tried(one: Manipulation, cause: str | None) -> CandidateResult:
    """Return the result of one episode."""
    failed = [] if cause is None else [(cause, {"step": "open"})]
    stage = StageResult("physics", 1, float(cause is None), {}, 0.0, diagnoses(failed))
    return CandidateResult(Candidate("", {"open": {"designed": {}}}, one.provenance()), (stage,))


def estimate(result: CandidateResult, one: Manipulation, **parts: Any) -> float:
    """Return the estimated success of an alignment that differs from ``one`` in ``parts``; the first estimate is 1."""
    (other,) = [
        each
        for each in pool()
        if all(getattr(each, name) == parts.get(name, value) for name, value in vars(one).items())
    ]
    before, after = (float(steering.estimates([other], tried)[0]) for tried in ([], [(one, result)]))
    return after / before


def grasp() -> Manipulation:
    """Return one of the grasp alignments."""
    return next(each for each in pool() if each.gripper == "grasp" and each.roll == "z" and each.inset == 0.0)


def test_a_failure_speaks_against_what_was_to_blame_and_nothing_else() -> None:
    one = grasp()
    in_table, in_door = planned(one, IN_TABLE), planned(one, IN_DOOR)
    assert estimate(in_table, one, roll="y", inset=0.015) == estimate(in_table, one) == 0.5
    assert estimate(in_door, one) == 0.5 < estimate(in_door, one, inset=0.015) < 1.0
    assert estimate(in_table, one, keypoint="articulated_object_inside") == 1.0
    rolled = planned(one, ROLL_MISSES)
    assert estimate(rolled, one, keypoint="articulated_object_inside") == 0.5
    assert estimate(rolled, one, roll="y") == 1.0
    push = next(each for each in pool() if each.gripper == "closed" and each.motion == "follow_joint_to")
    stopped = planned(push, STOPS)
    assert estimate(stopped, push) < 1.0 < estimate(stopped, push, motion="trace_joint_to"), "it got there"
    missed = tried(push, "object did not move")
    assert estimate(missed, push) < estimate(missed, push, behind=0.03)


def test_what_worked_draws_its_like() -> None:
    one = grasp()
    assert estimate(tried(one, None), one, roll="y", inset=0.015) > 2.0


def test_who_works_is_found_sooner() -> None:
    """In a world in which the arm can come from one side only and only a grasp across z moves the part."""

    def world(one: Manipulation) -> CandidateResult:
        if one.approach.vector[0] < 0.7 or one.approach.frame != "joint":
            return planned(one, IN_TABLE)
        return tried(one, None if one.roll == "z" and one.inset else "object did not move")

    def found_after(told: bool, seed: int) -> int:
        generator, results = np.random.default_rng(seed), []
        for number in range(1, len(pool()) + 1):
            (one,) = steering.draw(pool(), results, 1, generator) if told else [pool()[orders[seed][number - 1]]]
            results.append(world(one))
            if results[-1].held:
                return number
        raise AssertionError("nobody works")

    orders = {seed: np.random.default_rng(seed).permutation(len(pool())) for seed in range(12)}
    blindly, told = (np.median([found_after(way, seed) for seed in orders]) for way in (False, True))
    assert told < 0.6 * blindly


def test_nothing_is_drawn_twice_and_the_draw_is_seeded() -> None:
    results = [planned(each, IN_TABLE) for each in pool()[:50]]
    first, second = (steering.draw(pool(), results, 30, np.random.default_rng(1)) for _ in range(2))
    assert first == second
    assert len(set(first)) == 30
    assert not set(first) & set(pool()[:50])
    assert steering.draw(pool()[:50], results, 30, np.random.default_rng(1)) == []


@pytest.mark.parametrize(("travelled", "said"), [(-0.001, " 0% "), (-0.25, " -25% "), (0.994, " 99% ")])
def test_a_small_negative_travel_has_no_sign(travelled: float, said: str) -> None:
    (found,) = diagnoses([("object did not move", {"travelled": travelled})])
    assert f"went{said}of its range" in found.words
