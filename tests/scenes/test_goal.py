"""A goal that the initial scene already meets, or that cannot be reached, is refused at the first reset."""

from __future__ import annotations

from typing import Any

import pytest

from gensim2.scenes.goal import GoalError
from gensim2.scenes.sampler import SceneSampler

DRAWER = {"class": "drawer", "randomization": {"openness_mean": 0.5, "openness_spread": 0.15}}
BALL = {"class": "golf_ball", "place": {"at": [-0.2, -0.45]}}


def sampler(*goal: dict[str, Any], **objects: dict[str, Any]) -> SceneSampler:
    things = objects or {"drawer": DRAWER, "ball": BALL}
    step = {"name": "move", "object": next(iter(things)), "strategies": ["any"]}
    task = {"name": "Odd", "description": "do it", "objects": things, "steps": [step], "goal": list(goal)}
    return SceneSampler(task, assets="builtin")


@pytest.mark.parametrize(
    ("goal", "expected"),
    [
        ([{"type": "articulated_open", "object": "drawer", "threshold": 0.3}], "is already reached at the start"),
        (
            [{"type": "articulated_between", "object": "drawer", "low": 0.1, "high": 0.9}],
            "is already reached at the start",
        ),
        (
            [{"type": "articulated_open", "object": "drawer"}, {"type": "articulated_closed", "object": "drawer"}],
            "require the openness of drawer to be above 0.8 and below 0.2 at the same time",
        ),
        ([{"type": "articulated_open", "object": "ball"}], "does not apply to 'ball', which is a rigid object"),
        (
            [{"type": "rigidbody_lifted", "rigid": "drawer"}],
            "does not apply to 'drawer', which is an articulated object",
        ),
        (
            [{"type": "rigidbody_moved", "rigid": "ball", "direction": "away", "distance": 0.9}],
            r"requires ball to be at a position 0\.\d\d m beyond the robot's reach of 0.75 m",
        ),
    ],
)
def test_a_goal_that_tells_nothing_is_refused(goal: list[dict[str, Any]], expected: str) -> None:
    with pytest.raises(GoalError, match=expected) as caught:
        sampler(*goal).sample(0)
    assert str(caught.value).startswith("Odd: goal: ")
    assert "\n" not in str(caught.value)


def test_a_start_that_the_caller_gave_is_the_callers() -> None:
    drawn = sampler({"type": "articulated_open", "object": "drawer"})
    assert drawn.sample(0, {"openness": {"drawer": 1.0}}).objects["drawer"].openness == 1.0
    far = sampler({"type": "rigidbody_moved", "rigid": "ball", "direction": "away", "distance": 0.1})
    far.sample(0, {"pose": {"ball": [2.0, 0, 0.1, 1, 0, 0, 0]}})


def test_scenes_are_as_without_the_check(monkeypatch: pytest.MonkeyPatch) -> None:
    checked = sampler({"type": "articulated_open", "object": "drawer", "threshold": 0.5})
    plain = sampler({"type": "articulated_open", "object": "drawer", "threshold": 0.5})
    plain._goal_is_checked = True
    assert [repr(checked.sample(seed)) for seed in (3, 1)] == [repr(plain.sample(seed)) for seed in (3, 1)]
