"""The longest possible part of a motion ends like the whole one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import pytest

import gensim2_kpam as kpam
from gensim2.planning.steps import LEFT_OUT, shortened


@dataclass
class Part:
    """The part of a plan's result that says how far it goes."""

    reached_fraction: float
    status: str = "partial"


def cut(motions: list[Any], fraction: float, openness: float | None = 0.5, **config: Any) -> list[Any] | None:
    given = {"post_actuation_motions": motions, "let_go": 0.06, **config}
    found = shortened(given, cast(kpam.Plan, Part(fraction)), openness)
    return None if found is None else list(found["post_actuation_motions"])


def test_a_motion_to_an_openness_ends_at_a_smaller_one() -> None:
    # Half of two paths, the last of which releases: all of the first except what is left out.
    [[name, value]] = cut([["trace_joint_to", 1.0]], 0.5 * 0.8) or []
    assert (name, value) == ("trace_joint_to", pytest.approx(0.5 + (0.8 - LEFT_OUT) * 0.5))
    [[_, closing]] = cut([["follow_joint_to", -0.1]], 0.25) or []
    assert closing == pytest.approx(0.5 - (0.5 - LEFT_OUT) * 0.6)


def test_motions_before_the_cut_stay_and_later_ones_go() -> None:
    motions = [["follow_joint_to", 0.8], ["follow_joint_to", 1.0], ["translate_z", -0.1]]
    kept = cut(motions, 1.5 / 4) or []
    assert kept[0] == ["follow_joint_to", 0.8]
    assert kept[1] == ["follow_joint_to", pytest.approx(0.8 + (0.5 - LEFT_OUT) * 0.2)]
    assert len(kept) == 2
    assert cut([["translate_x", 0.2]], 0.25) == [["translate_x", pytest.approx((0.5 - LEFT_OUT) * 0.2)]]
    assert cut(["move-up", "move-up"], 0.5) == ["move-up"]
    assert cut([["follow_joint", 0.3], ["follow_joint_to", 1.0]], 0.5) == [["follow_joint", 0.3]]


def test_what_ends_before_it_begins_or_keeps_hold_stays_as_it_is() -> None:
    assert cut([["follow_joint_to", 1.0]], 0.01) is None
    assert cut([["follow_joint_to", 1.0]], 0.4, let_go=None) is None
    assert cut([["follow_joint_to", 1.0]], 0.4, openness=None) is None
    whole = Part(1.0, "solved")
    config = {"post_actuation_motions": [["follow_joint_to", 1.0]], "let_go": 0.06}
    assert shortened(config, cast(kpam.Plan, whole), 0.5) is None
