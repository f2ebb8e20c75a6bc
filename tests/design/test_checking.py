"""The remedy for success criteria that a joint meets near its start."""

from __future__ import annotations

import re
from typing import Any

import pytest

from gensim2.design.checking import CHANGE_GOAL, remedy_for
from gensim2.rollout.checker_result import CheckerResult, Mutation, WorldCount
from gensim2.rollout.mutated import judge
from gensim2.scenes.config import SceneOptions
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.spec import TaskSpec

SCENE = SceneOptions("builtin")


def task(criterion: dict[str, Any], randomization: dict[str, Any] | None = None) -> TaskSpec:
    thing = {"class": "drawer", "randomization": randomization or {}}
    step = {"name": "move", "object": "chest", "done": [{**criterion, "object": "chest"}]}
    return TaskSpec.model_validate(
        {"name": "Mine", "description": "mine", "objects": {"chest": thing}, "steps": [step]}
    )


def check(spec: TaskSpec) -> CheckerResult:
    env = HeadlessEnv(spec, assets="builtin")
    return CheckerResult.of([judge(env, seed) for seed in range(4)])


@pytest.mark.parametrize(
    ("kind", "threshold", "safe", "remedy"),
    [
        (
            "articulated_open",
            0.6,
            0.8,
            "raise the threshold of articulated_open to 0.8, or let the object start closed with "
            "randomization: {openness_mean: 0.05, openness_spread: 0.05}",
        ),
        (
            "articulated_closed",
            0.4,
            0.2,
            "lower the threshold of articulated_closed to 0.2, or let the object start open with "
            "randomization: {openness_mean: 0.95, openness_spread: 0.05}",
        ),
    ],
)
def test_the_remedy_names_the_start_and_each_of_its_changes_is_enough(
    kind: str, threshold: float, safe: float, remedy: str
) -> None:
    refused = task({"type": kind, "threshold": threshold})
    found = check(refused)
    assert not found.passes
    assert remedy_for(refused, found, SCENE) == f"'chest' starts at openness 0.35 to 0.65; {remedy}"
    assert check(task({"type": kind, "threshold": safe})).passes
    mean = 0.05 if kind == "articulated_open" else 0.95
    assert check(task({"type": kind, "threshold": threshold}, {"openness_mean": mean, "openness_spread": 0.05})).passes


def refused(mutation: Mutation) -> CheckerResult:
    return CheckerResult.of([[WorldCount(None, str(mutation), "chest", ("articulated_open",), 4, 1)]])


def test_a_change_that_does_not_help_is_not_proposed() -> None:
    low = task({"type": "articulated_open", "threshold": 0.2})
    assert remedy_for(low, refused(Mutation.A_LITTLE), SCENE).endswith(
        "; raise the threshold of articulated_open to 0.8"
    )
    wide_open = task({"type": "articulated_open"}, {"openness_mean": 0.9})
    found = remedy_for(wide_open, refused(Mutation.NOTHING), SCENE)
    assert found.startswith("'chest' starts at openness 0.75 to 1.00; let the object start closed")
    ajar = task({"type": "articulated_between"})
    assert "so that the start lies outside the goal" in remedy_for(ajar, refused(Mutation.NOTHING), SCENE)


def test_the_range_of_the_start_is_that_of_the_preset() -> None:
    spec = task({"type": "articulated_open", "threshold": 0.6})
    found = remedy_for(spec, refused(Mutation.NOTHING), SceneOptions("builtin", randomization="paper-half"))
    assert re.match(r"'chest' starts at openness 0\.4[23] to 0\.5[78];", found)


def test_criteria_that_are_wrong_for_another_reason_get_the_general_remedy() -> None:
    spec = task({"type": "articulated_open", "threshold": 0.6})
    assert remedy_for(spec, refused(Mutation.WRONG_WAY), SCENE) == CHANGE_GOAL
    far = task({"type": "articulated_open", "threshold": 0.9})
    assert remedy_for(far, refused(Mutation.A_LITTLE), SCENE) == CHANGE_GOAL
