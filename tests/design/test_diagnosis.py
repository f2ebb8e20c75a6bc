"""Failures of candidates in sentences with measured values."""

from __future__ import annotations

import pytest

from gensim2.design.base import Candidate
from gensim2.design.diagnosis import diagnoses

REASON = "panda_link7 and table overlap by 5.7 mm on the way to actuation, at (0.5, 0, 0)"


@pytest.mark.parametrize(
    ("distance", "said"),
    [(-0.0057, "overlap by 6 mm"), (-1e-4, "overlap by less than 1 mm"), (0.03, "come within 30 mm")],
)
def test_an_overlap_is_no_negative_distance(distance: float, said: str) -> None:
    collision = {"bodies": ["hand", "table"], "distance": distance, "toward": "pre_0"}
    (found,) = diagnoses([("collision", {"step": "open", "plan": {"collisions": [collision]}})])
    assert found.words == f"step 'open': collision; hand and table {said} on the way to pre_0"


def test_of_a_permitted_early_contact_it_is_said_that_the_plan_is_complete() -> None:
    (found,) = diagnoses([("object did not move", {"step": "open", "plan": {"touches": REASON}})])
    assert "the plan is complete, but it lets the hand touch its target before the actuation pose" in found.words
    assert found.words.endswith(f"without this contact planning fails: {REASON}")
    (found,) = diagnoses([("collision", {"step": "open", "plan": {"touches": REASON, "unreached": "post_0"}})])
    assert "the plan is complete" not in found.words


def test_failures_name_strategies_as_the_table_of_candidates_does() -> None:
    failures = [("object did not move", {"step": "open", "strategy": name}) for name in ("designed_1", "lift")]
    labels = {"designed_1": "push at head"}
    alone = Candidate("push at head", {}, {}, labels)
    team = Candidate("push at head or else lift", {}, {}, labels)
    assert diagnoses(failures[:1], alone.described)[0].words == "step 'open': object did not move"
    assert [each.words for each in diagnoses(failures, team.described)] == [
        "step 'open' by 'push at head': object did not move",
        "step 'open' by 'lift': object did not move",
    ]
