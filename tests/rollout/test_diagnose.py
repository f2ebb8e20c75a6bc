"""One made-up course of events for each cause; the diagnosis names it with its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scripted import AWAY, OPEN_DRAWER, PUT_BALL_AWAY, ScriptedController, ScriptedWorld, glide, instant

from gensim2.rollout.controller import ACTUATION, Event
from gensim2.rollout.record import Cause, Episode, PlanRecord, StepRecord
from gensim2.rollout.run import run
from gensim2.tasks.criteria import DistanceGripperRigid
from gensim2.tasks.measurement import Measurement

HANDLE = (0.2, 0.0, 0.1)


def _plan(status: str, ran: int = 0, **detail: Any) -> PlanRecord:
    return PlanRecord("pull", status, f"it is {status}", 0, "start", ran, detail)


def _open(
    course: Sequence[Measurement], plans: list[PlanRecord] | None = None, events: Sequence[Event] = ()
) -> Episode:
    """Return an episode in which the drawer is to be opened."""
    history = [StepRecord("open", plans or [_plan("solved", 30)], False, False)]
    steps = 0 if plans and not any(plan.ran for plan in plans) else 30
    controller = ScriptedController(steps, (("open", 0),), history, events)
    return run(ScriptedWorld(OPEN_DRAWER, course), controller, seed=0).episode


REACH = (0, {"openness": 0.0, "hand": AWAY, "opening": 0.08})
GRIP = (10, {"openness": 0.0, "hand": HANDLE, "opening": 0.02})


@pytest.mark.parametrize(
    ("plan", "cause"),
    [
        (_plan("invalid"), Cause.INVALID_PROBLEM),
        (_plan("actuation_infeasible", residuals=[{"name": "p2p", "residual": 0.2, "tolerance": 0.001}]),
         Cause.NO_ACTUATION_POSE),
        (_plan("unreachable", unreached="pre_1"), Cause.KEYFRAME_OUT_OF_REACH),
        (_plan("collision", collisions=[{"bodies": ["panda_link5", "table"]}]), Cause.COLLISION_ON_THE_WAY),
        (_plan("not_found"), Cause.NO_MOTION_FOUND),
        (_plan("too_fast"), Cause.NO_MOTION_FOUND),
        (_plan("no_grasp"), Cause.NO_GRASP),
        (_plan("partial", 30, unreached="post_0"), Cause.KEYFRAME_OUT_OF_REACH),
        (_plan("partial", 30, unreached="post_0", collisions=[{"bodies": ["hand", "table"]}]),
         Cause.COLLISION_ON_THE_WAY),
        (_plan("partial", 30), Cause.NO_MOTION_FOUND),
    ],
)  # fmt: skip
def test_what_a_plan_lacks(plan: PlanRecord, cause: Cause) -> None:
    course = glide(REACH, GRIP, (25, {"openness": 0.3, "hand": (0.14, 0.0, 0.1), "opening": 0.02}))
    episode = _open(course, [plan])
    assert episode.cause is cause
    assert episode.diagnosis["status"] == plan.status
    assert episode.diagnosis["step"] == "open"
    assert episode.diagnosis.get("plan", {}) == plan.detail
    assert (episode.control_steps == 0) == (plan.ran == 0)


def test_room_that_was_made_in_vain_is_not_to_blame() -> None:
    plans = [_plan("no_grasp"), _plan("solved", 30, makes_room=True), _plan("no_grasp")]
    assert _open(glide(REACH, GRIP), plans).cause is Cause.NO_GRASP


def test_a_later_strategy_makes_good_what_an_earlier_lacked() -> None:
    """The first strategy has no pose; the second one is executed and responsible for the result."""
    plans = [_plan("actuation_infeasible"), _plan("solved", 30)]
    episode = _open(glide(REACH, GRIP, (25, {"openness": 0.3, "hand": (0.14, 0.0, 0.1), "opening": 0.02})), plans)
    assert episode.cause is Cause.STOPPED_SHORT
    assert episode.diagnosis["travelled"] == pytest.approx(0.3)


COURSES: dict[Cause, list[Measurement]] = {
    Cause.NO_CONTACT: glide(REACH, (20, {"openness": 0.0, "hand": (0.2, 0.1, 0.1), "opening": 0.02})),
    Cause.WRONG_WAY: [
        instant(openness=max(0.0, 0.5 - 0.02 * step), hand=(0.1 + 0.004 * step, 0.0, 0.1)) for step in range(30)
    ],
    Cause.STOPPED_SHORT: glide(
        REACH,
        GRIP,
        (20, {"openness": 0.6, "hand": (0.08, 0.0, 0.1), "opening": 0.02}),
        (25, {"openness": 0.6, "hand": (0.02, 0.0, 0.1), "opening": 0.08}),  # it releases and retreats
    ),
    Cause.CONTACT_SLIPPED: glide(
        REACH,
        GRIP,
        (18, {"openness": 0.4, "hand": (0.12, 0.0, 0.1), "opening": 0.02}),
        (30, {"openness": 0.4, "hand": (0.0, 0.0, 0.1), "opening": 0.0}),
    ),
    Cause.GOAL_UNDONE: glide(
        REACH,
        GRIP,
        (20, {"openness": 0.9, "hand": (0.02, 0.0, 0.1), "opening": 0.02}),
        (25, {"openness": 0.9, "hand": AWAY, "opening": 0.08}),
        (30, {"openness": 0.5, "hand": AWAY, "opening": 0.08}),
    ),
}


@pytest.mark.parametrize("cause", COURSES)
def test_what_became_of_a_joint(cause: Cause) -> None:
    episode = _open(COURSES[cause])
    assert not episode.held
    assert episode.cause is cause


def test_no_contact_states_the_distance_to_the_surface_of_the_object() -> None:
    """The hand stops 2 cm above the floor of the tray, 7 cm below its nearest keypoint; then inside a wall."""
    tray = instant().keypoints["drawer"]["inside"] - [0.0, 0.0, 0.1]
    episode = _open([instant(hand=AWAY), *[instant(hand=np.add(tray, [0.0, 0.0, 0.03]))] * 30])
    assert episode.cause is Cause.NO_CONTACT
    assert episode.diagnosis["nearest"] == pytest.approx(0.02, abs=1e-6)
    inside = _open([instant(hand=AWAY), *[instant(hand=np.add(tray, [0.095, 0.0, 0.05]))] * 30])
    assert inside.diagnosis["nearest"] == 0.0


def test_a_controller_that_is_never_done() -> None:
    course = glide(REACH, GRIP)
    controller = ScriptedController(1000, (("open", 0),), [StepRecord("open", [], False, False)])
    episode = run(ScriptedWorld(OPEN_DRAWER, course), controller, seed=0).episode
    assert episode.cause is Cause.NO_CONTACT  # there was enough time
    late = [instant()] * 95 + [instant(openness=0.9)]
    episode = run(ScriptedWorld(OPEN_DRAWER, late), ScriptedController(1000), seed=0).episode
    assert episode.paper
    assert episode.cause is Cause.TIME_OVER


def test_a_goal_that_comes_about_by_itself() -> None:
    course = glide(REACH, (20, {"openness": 0.9, "hand": AWAY, "opening": 0.08}))
    world = ScriptedWorld(OPEN_DRAWER, course, alone=course)
    episode = run(world, ScriptedController(30), seed=0).episode
    assert episode.still
    assert episode.cause is Cause.HAPPENS_BY_ITSELF


# --- a ball and a drawer

THERE = {"openness": 1.0, "ball": (0.0, -0.4, 0.02), "hand": (0.0, -0.4, 0.02), "opening": 0.08}
SHUT = {**THERE, "opening": 0.04}
UP = {**SHUT, "ball": (0.0, -0.4, 0.2), "hand": (0.0, -0.4, 0.2)}
OVER = {**SHUT, "ball": (-0.1, 0.0, 0.15), "hand": (-0.1, 0.0, 0.15)}


def _put(
    *waypoints: tuple[int, dict[str, Any]],
    events: Sequence[Event] = (),
    turns: Sequence[tuple[str, int]] = (("grasp", 0), ("place", 20)),
) -> Episode:
    """Return an episode in which the ball is grasped until control step 20 and placed until 50."""
    history = [StepRecord(name, [_plan("solved", 20)], False, False) for name in dict(turns)]
    controller = ScriptedController(50, turns, history, events)
    return run(ScriptedWorld(PUT_BALL_AWAY, glide(*waypoints)), controller, seed=0).episode


def test_a_grasp_that_closes_on_nothing() -> None:
    rolled = {**THERE, "ball": (0.05, -0.4, 0.02)}
    closed = {**rolled, "opening": 0.0}
    carried = {**closed, "hand": (-0.1, 0.0, 0.15)}
    episode = _put((0, rolled), (10, closed), (20, closed), (40, carried))
    assert episode.cause is Cause.GRASP_MISSED
    assert episode.diagnosis["step"] == "grasp"
    assert episode.diagnosis["distance"] == pytest.approx(0.05)


def test_a_grasp_that_leaves_the_object_behind() -> None:
    """Something is between the fingers, but the ball stays on the table while the hand rises."""
    left = {**SHUT, "hand": (0.0, -0.4, 0.2)}
    episode = _put((0, THERE), (10, SHUT), (20, left), (40, {**left, "hand": (-0.1, 0.0, 0.15)}))
    assert episode.cause is Cause.GRASP_MISSED
    assert episode.diagnosis["distance"] == pytest.approx(0.18)


def test_a_grasp_that_is_lost_on_the_way() -> None:
    fallen = {**OVER, "ball": (-0.05, -0.2, 0.02), "opening": 0.0}
    half = {**OVER, "ball": (-0.05, -0.2, 0.17), "hand": (-0.05, -0.2, 0.17)}
    episode = _put((0, THERE), (10, SHUT), (20, UP), (30, half), (35, fallen), (45, {**fallen, "opening": 0.08}))
    assert episode.cause is Cause.GRASP_LOST
    assert episode.diagnosis["step"] == "place"


def test_an_object_that_is_put_down_beside_its_goal() -> None:
    beside = {**OVER, "ball": (-0.1, 0.2, 0.15), "hand": (-0.1, 0.2, 0.15)}
    released = {**beside, "ball": (-0.1, 0.2, 0.02), "opening": 0.08}
    episode = _put((0, THERE), (10, SHUT), (20, UP), (40, beside), (41, {**beside, "opening": 0.08}), (45, released))
    assert episode.cause is Cause.PLACED_BESIDE
    assert episode.diagnosis["distance"] == pytest.approx(0.2)


def test_an_object_that_rolls_out_again() -> None:
    """It was in the drawer when the hand released it."""
    inside = {**OVER, "ball": (-0.1, 0.0, 0.05), "hand": (-0.1, 0.0, 0.05)}
    rolled = {**inside, "ball": (-0.1, 0.2, 0.02), "opening": 0.08}
    episode = _put((0, THERE), (10, SHUT), (20, UP), (40, inside), (41, {**inside, "opening": 0.08}), (45, rolled))
    assert episode.cause is Cause.GOAL_UNDONE
    assert episode.diagnosis["failing"] == ["distance_articulated_rigidbody"]


def test_an_object_that_is_bumped_before_the_hand_is_there() -> None:
    """The controller noticed it without a remedy; or it noticed nothing, and the measurements show it."""
    bumped = {**THERE, "ball": (0.0, -0.3, 0.02)}
    noticed = [Event(5, "grasp", Cause.OBJECT_DRIFTED, {"distance": 0.1})]
    episode = _put((0, THERE), (5, bumped), (20, bumped), events=noticed, turns=(("grasp", 0),))
    assert episode.cause is Cause.OBJECT_DRIFTED
    assert episode.diagnosis["distance"] == 0.1
    assert episode.diagnosis["deviations"] == [
        {"at_step": 5, "step": "grasp", "what": "object drifted", "detail": {"distance": 0.1}}
    ]
    moved = [instant(openness=0.0, ball=(0.0, -0.4 + 0.01 * min(step, 8), 0.02)) for step in range(30)]
    reach = PUT_BALL_AWAY.model_copy(
        update={
            "steps": (
                PUT_BALL_AWAY.steps[0].model_copy(
                    update={"done": (DistanceGripperRigid(rigid="ball"),)},
                ),
            ),
            "goal": None,
        }
    )
    told = [Event(20, "grasp", ACTUATION)]
    controller = ScriptedController(30, (("grasp", 0),), [StepRecord("grasp", [], False, False)], told)
    episode = run(ScriptedWorld(reach, moved), controller, seed=0).episode
    assert episode.cause is Cause.OBJECT_DRIFTED
    assert episode.diagnosis["distance"] == pytest.approx(0.08)


def test_a_deviation_that_was_made_good_is_not_to_blame() -> None:
    """The ball was bumped and grasped nevertheless; then it was placed beside the drawer."""
    noticed = [Event(5, "grasp", Cause.OBJECT_DRIFTED)]
    beside = {**OVER, "ball": (-0.1, 0.2, 0.15), "hand": (-0.1, 0.2, 0.15)}
    released = {**beside, "ball": (-0.1, 0.2, 0.02), "opening": 0.08}
    course = ((0, THERE), (10, SHUT), (20, UP), (40, beside), (41, {**beside, "opening": 0.08}), (45, released))
    episode = _put(*course, events=noticed)
    assert episode.cause is Cause.PLACED_BESIDE
    assert len(episode.diagnosis["deviations"]) == 1
