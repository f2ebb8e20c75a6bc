"""Several attempts from one start: which are made, when they end, and which one counts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from fake_world import episode_of

from gensim2.rollout.controller_spec import ControllerSpec
from gensim2.rollout.record import Cause, Episode
from gensim2.rollout.recording import EpisodeResult
from gensim2.rollout.run import NUM_SEEDS, Attempt, attempted
from gensim2.tasks.library import load_task

TASK = load_task("PlaceGolfBallIntoDrawer")
SINGLE = load_task("OpenDrawer")


def _failed(step: str | None = None, **changes: Any) -> Episode:
    given: dict[str, Any] = {"diagnosis": {} if step is None else {"step": step}, **changes}
    return replace(episode_of(SINGLE, 7, held=False), **given)


def _make(*episodes: Episode, max_attempts: int = 8) -> tuple[Episode, list[Attempt]]:
    """Run attempts that end like ``episodes``; return the episode that counts, and the attempts."""
    asked: list[Attempt] = []

    def run(attempt: Attempt) -> EpisodeResult:
        asked.append(attempt)
        return EpisodeResult(episodes[min(len(asked), len(episodes)) - 1])

    return attempted(TASK, run, max_attempts).episode, asked


def test_one_attempt_is_an_episode_as_it_is() -> None:
    failed = _failed("place")
    found, asked = _make(failed, max_attempts=1)
    assert found is failed
    assert asked == [Attempt()]


def test_the_step_to_blame_begins_with_its_next_strategy_and_the_solver_with_its_next_seed() -> None:
    found, asked = _make(_failed("place"), _failed("open"), _failed("place"), _failed("grasp"), max_attempts=5)
    ways = {step.name: step.strategies for step in TASK.steps}
    assert [attempt.seed for attempt in asked] == [0, 1, 2, 3, 4]
    assert [attempt.first for attempt in asked] == [
        {},
        {"place": ways["place"][1]},
        {"place": ways["place"][1], "open": ways["open"][1]},
        {"place": ways["place"][2], "open": ways["open"][1]},
        {"place": ways["place"][2], "open": ways["open"][1], "grasp": ways["grasp"][0]},
    ]
    assert [(record.seed, record.first) for record in found.attempts] == [(each.seed, each.first) for each in asked]
    steps = {step.name: step.strategies for step in asked[2].task(TASK).steps}
    assert steps["place"] == (ways["place"][1], ways["place"][0], *ways["place"][2:])
    assert steps["close"] == ways["close"]
    assert asked[0].task(TASK) == TASK


def test_the_solvers_options_change_with_the_seed() -> None:
    spec = ControllerSpec("module:Class", {"strategies": {}})
    assert Attempt().controller(spec) == spec
    options = Attempt(3).controller(spec).arguments["options"]
    assert options == {"allow_partial": True, "seed": 3, "num_seeds": NUM_SEEDS}


def test_attempts_end_with_the_first_that_holds() -> None:
    held = episode_of(SINGLE, 7, held=True)
    found, asked = _make(_failed("open", cause=Cause.GRASP_MISSED), _failed("open", paper=True), held)
    assert len(asked) == 3
    assert replace(found, attempts=[]) == held
    assert [(record.held, record.paper, record.cause) for record in found.attempts] == [
        (False, False, Cause.GRASP_MISSED),
        (False, True, Cause.NO_CONTACT),
        (True, True, None),
    ]


@pytest.mark.parametrize("paper", [[False, False, False], [False, True, True], [True, False, True]])
def test_where_none_holds_the_first_that_the_paper_counts_does(paper: list[bool]) -> None:
    episodes = [_failed("open", paper=each, control_steps=number) for number, each in enumerate(paper)]
    found, asked = _make(*episodes, max_attempts=3)
    assert len(asked) == 3
    assert found.control_steps == (paper.index(True) if any(paper) else 0)
    assert (found.paper, found.held) == (any(paper), False)


def test_a_goal_that_comes_about_by_itself_is_not_attempted_again() -> None:
    found, asked = _make(_failed(cause=Cause.HAPPENS_BY_ITSELF))
    assert len(asked) == len(found.attempts) == 1


def test_where_nothing_is_to_blame_it_is_the_step_that_was_begun_last() -> None:
    begun = _failed()
    steps = [replace(begun.steps[0], name=name) for name in ("open", "grasp")]
    assert Attempt().after(replace(begun, steps=steps), TASK).first == {"grasp": "grasp"}
    assert Attempt().after(replace(begun, steps=[]), TASK).first == {"open": TASK.steps[0].strategies[1]}
