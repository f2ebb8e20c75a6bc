"""The three success criteria: each failure of the strict one, and the step during which a criterion became true."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scripted import AWAY, OPEN_DRAWER, PUT_BALL_AWAY, ScriptedController, ScriptedWorld, glide, instant

from gensim2.robots import robot
from gensim2.rollout.controller import ACTUATION, Event
from gensim2.rollout.motion import LASTING_SECONDS, SETTLE_SECONDS
from gensim2.rollout.record import Cause, Episode, StepRecord, StrictMiss
from gensim2.rollout.run import run

PLACED = {"openness": 1.0, "ball": (-0.1, 0.0, 0.04), "hand": AWAY, "opening": 0.08}
"""The ball is in the open drawer and the hand is away."""
BEFORE = {"openness": 1.0, "ball": (0.0, -0.4, 0.02), "hand": (0.0, -0.4, 0.02), "opening": 0.04}
TURNS = (("grasp", 0), ("place", 10))
ACTUATED = (Event(5, "grasp", ACTUATION),)


def _put(world: ScriptedWorld | None = None, events: tuple[Event, ...] = ACTUATED, **end: Any) -> Episode:
    """Return an episode in which the ball is carried into the drawer; ``end`` changes its last instant."""
    course = glide((0, BEFORE), (10, BEFORE), (30, {**PLACED, "opening": 0.04}), (31, PLACED), (40, PLACED))
    course.append(instant(**{**PLACED, **end}))
    world = world or ScriptedWorld(PUT_BALL_AWAY, course)
    return run(world, ScriptedController(40, TURNS, events=events), seed=0).episode


def test_a_ball_in_the_drawer_with_the_hand_away_meets_all_three() -> None:
    episode = _put()
    assert (episode.paper, episode.held, episode.strict, episode.strict_misses) == (True, True, True, [])
    assert episode.cause is None
    assert [step.name for step in episode.steps] == ["grasp", "place"]


MISSES: dict[str, tuple[StrictMiss, dict[str, Any]]] = {
    "beside the hand": (StrictMiss.NOT_RETREATED, {"hand": (-0.1, -0.048, 0.04)}),
    "in the floor of the drawer": (StrictMiss.PRESSED_IN, {"ball": (-0.1, 0.0, 0.0285)}),
    "the cup was shoved": (StrictMiss.OTHERS_MOVED, {"cup": (0.35, 0.4, 0.05, 1.0, 0.0, 0.0, 0.0)}),
    "the cup fell over": (
        StrictMiss.OTHERS_MOVED,
        {"cup": (0.3, 0.4, 0.05, math.cos(0.2), math.sin(0.2), 0.0, 0.0)},
    ),
}


@pytest.mark.parametrize("case", MISSES)
def test_each_thing_that_is_missing_is_named(case: str) -> None:
    miss, end = MISSES[case]
    episode = _put(**end)
    assert episode.held
    assert not episode.strict
    assert episode.strict_misses == [miss]
    assert miss.value in episode.diagnosis


@pytest.mark.parametrize(
    "end",
    [
        {"hand": (-0.1, -0.052, 0.04)},
        {"ball": (-0.1, 0.0, 0.085)},
        {"ball": (-0.1, 0.0, 0.0295)},  # half a millimetre in the floor
        {"cup": (0.325, 0.4, 0.05, 1.0, 0.0, 0.0, 0.0)},
        {"cup": (0.3, 0.4, 0.05, math.cos(0.3), 0.0, 0.0, math.sin(0.3))},  # turned about the vertical
        {"speed": (0.009, 0.04)},
        {"joint_speed": 0.049},
    ],
)
def test_a_little_of_it_is_let_pass(end: dict[str, Any]) -> None:
    assert _put(**end).strict_misses == []


def _moves(rolls: float = 0.0, spins: float = 0.0, slides: float = 0.0) -> Episode:
    """Return an episode after whose end the ball or the drawer moves at the given speed (m/s, rad/s, openness/s)."""
    course = glide((0, BEFORE), (10, BEFORE), (30, {**PLACED, "opening": 0.04}), (31, PLACED), (40, PLACED))
    course += course[-1:] * robot("panda").steps(SETTLE_SECONDS)
    for step in range(robot("panda").steps(LASTING_SECONDS)):
        time = step / robot("panda").control_hz
        turned = (math.cos(0.5 * spins * time), 0.0, math.sin(0.5 * spins * time), 0.0)
        ball = (-0.1, rolls * time, 0.04, *turned)
        course.append(instant(**{**PLACED, "openness": 1.0 - slides * time, "ball": ball}))
    return run(ScriptedWorld(PUT_BALL_AWAY, course), ScriptedController(40, TURNS, events=ACTUATED), seed=0).episode


@pytest.mark.parametrize(
    ("fast", "name", "slow"),
    [
        ({"spins": 0.06}, "ball", {"spins": 0.04}),
        ({"rolls": 0.011}, "ball", {"rolls": 0.009}),
        ({"slides": 0.051}, "drawer", {"slides": 0.049}),
    ],
)
def test_what_moves_a_second_later_is_named(fast: dict[str, float], name: str, slow: dict[str, float]) -> None:
    episode = _moves(**fast)
    assert episode.held
    assert episode.strict_misses == [StrictMiss.MOVING]
    (speed,) = fast.values()
    metres = 0.2 if "slides" in fast else 1.0  # metres per unit of openness
    assert episode.diagnosis[StrictMiss.MOVING] == {"speeds": {name: pytest.approx(metres * speed, rel=1e-6)}}
    assert _moves(**slow).strict_misses == []


def test_what_does_not_move_is_at_rest_whatever_speed_physics_reports() -> None:
    """PhysX's solver reports speeds of 0.1 rad/s and 25 cm/s for bodies at rest, even asleep ones."""
    assert _put(speed=(0.3, 2.0), joint_speed=1.7).strict_misses == []


@pytest.mark.parametrize("height", [0.2, 0.12], ids=["too high", "on the rim"])
def test_a_ball_above_the_drawer_is_not_inside(height: float) -> None:
    """For the paper only the horizontal distance counts."""
    episode = _put(ball=(-0.1, 0.0, height))
    assert (episode.paper, episode.held, episode.strict_misses) == (True, False, [StrictMiss.NOT_HELD])
    assert episode.cause is not None


def test_a_hand_that_still_holds_the_ball_has_not_let_go() -> None:
    course = glide((0, BEFORE), (10, BEFORE), (30, {**PLACED, "opening": 0.04}), (31, PLACED))
    episode = _put(ScriptedWorld(PUT_BALL_AWAY, course, touches=frozenset({"ball", "cup"})))
    assert episode.held
    assert episode.strict_misses == [StrictMiss.NOT_LET_GO]
    assert episode.diagnosis[StrictMiss.NOT_LET_GO] == {"touches": ["ball"]}


def test_what_moves_before_the_actuation_pose_is_named() -> None:
    shifted = {**BEFORE, "ball": (0.0, -0.394, 0.02)}
    for first, misses in ((BEFORE, [StrictMiss.DISTURBED]), (shifted, [])):
        course = glide((0, first), (4, shifted), (10, shifted), (30, {**PLACED, "opening": 0.04}), (31, PLACED))
        episode = _put(ScriptedWorld(PUT_BALL_AWAY, course))
        assert episode.held
        assert episode.strict_misses == misses
    # Without an event of the actuation pose, nothing counts as too early.
    course = glide((0, BEFORE), (4, shifted), (10, shifted), (30, {**PLACED, "opening": 0.04}), (31, PLACED))
    assert _put(ScriptedWorld(PUT_BALL_AWAY, course), events=()).strict


def test_a_goal_that_is_gone_a_second_after_the_last_command_was_held_and_is_not_strict() -> None:
    """The success is judged half a second after the last command; later states are checked and not recorded."""
    lasting = robot("panda").steps(LASTING_SECONDS)
    for undone, strict in ((40 + lasting - 1, False), (40 + lasting + 5, True)):
        course = glide((0, BEFORE), (10, BEFORE), (30, {**PLACED, "opening": 0.04}), (31, PLACED), (undone, PLACED))
        course.append(instant(**{**PLACED, "ball": (-0.1, 0.3, 0.02)}))
        episode = _put(ScriptedWorld(PUT_BALL_AWAY, course))
        assert episode.held
        assert episode.control_steps == 40 + robot("panda").steps(SETTLE_SECONDS)
        assert episode.strict is strict
        assert (StrictMiss.NOT_LASTING in episode.strict_misses) is not strict


def test_a_scene_that_does_not_come_to_rest_is_not_held() -> None:
    course = [instant(openness=0.5 + 0.004 * step) for step in range(200)]
    episode = run(ScriptedWorld(OPEN_DRAWER, course), ScriptedController(60), seed=0).episode
    assert episode.paper
    assert not episode.settled
    assert not episode.held
    assert episode.strict_misses == [StrictMiss.NOT_HELD]
    assert episode.cause is Cause.STILL_MOVING


def test_paper_asks_for_each_step_in_its_own_turn() -> None:
    """The ball is over the drawer while it is grasped, and gone when it should be placed."""
    over, gone = instant(**PLACED), instant(**{**PLACED, "ball": (0.3, 0.3, 0.02)})
    early = ScriptedWorld(PUT_BALL_AWAY, [over] * 10 + [gone] * 2)
    assert not run(early, ScriptedController(20, (("grasp", 0), ("place", 10))), seed=0).episode.paper
    in_turn = ScriptedWorld(PUT_BALL_AWAY, [gone] * 10 + [over, over, gone])
    episode = run(in_turn, ScriptedController(20, (("grasp", 0), ("place", 10))), seed=0).episode
    assert episode.paper
    assert not episode.held
    assert [(step.paper, step.done) for step in episode.steps] == [(True, True), (True, False)]
    never_begun = run(in_turn, ScriptedController(20, (("grasp", 0),)), seed=0).episode
    assert not never_begun.paper


def test_a_step_may_have_its_turn_again() -> None:
    over, gone = instant(**PLACED), instant(**{**PLACED, "ball": (0.3, 0.3, 0.02)})
    turns = (("grasp", 0), ("place", 4), ("grasp", 8), ("place", 12))
    history = [StepRecord("grasp", [], False, False), StepRecord("place", [], False, False)]
    world = ScriptedWorld(PUT_BALL_AWAY, [gone] * 14 + [over])
    episode = run(world, ScriptedController(20, turns, history), seed=0).episode
    assert episode.paper
    assert [(step.name, step.paper, step.done) for step in episode.steps] == [
        ("grasp", True, True),
        ("place", True, True),
    ]


def test_a_controller_that_knows_no_steps_moves_on_where_a_criterion_comes_true() -> None:
    over, gone = instant(**PLACED), instant(**{**PLACED, "ball": (0.3, 0.3, 0.02)})
    for course, paper in (([gone] * 5 + [over], True), ([gone], False)):
        episode = run(ScriptedWorld(PUT_BALL_AWAY, course), ScriptedController(20), seed=0).episode
        assert episode.paper is paper
        assert [step.name for step in episode.steps] == ["grasp", "place"]


def test_physics_without_numbers_is_no_success() -> None:
    nowhere = instant(**{**PLACED, "ball": (np.nan, np.nan, np.nan)})
    course = [*glide((0, BEFORE), (30, PLACED)), nowhere]
    episode = run(ScriptedWorld(PUT_BALL_AWAY, course), ScriptedController(40, TURNS), seed=0).episode
    assert episode.cause is Cause.UNSTABLE
    assert (episode.paper, episode.held, episode.strict) == (False, False, False)
    assert episode.objects["ball"].pose_end is None
