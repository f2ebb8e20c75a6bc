"""Plans as references and as drive commands, for a made-up plan whose joint values are step numbers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gensim2.planning.actions import (
    CLOSED,
    GRAVITY,
    LEAST_GRIP_FORCE,
    LEAST_GRIP_WEIGHTS,
    MAX_GRIP_WEIGHTS,
    OPEN,
    Acts,
    Schedule,
    grip_force,
    grip_on,
    schedule,
)
from gensim2.robots import JointDrive, RobotProfile, robot

pytest.importorskip("mani_skill")

STEPS = 20
ACTUATION = 8
POST = 14
LAG, FINGERS, HOLD = 2, 12, 4


@pytest.fixture(scope="module")
def panda() -> RobotProfile:
    return robot("panda")


def plan(steps: int = STEPS, let_go: bool = False, reached: int = STEPS) -> Any:
    """Joint 0 counts the control steps; the actuation pose is reached at step ``ACTUATION``."""

    def sample_every(seconds: float) -> Any:
        assert seconds == pytest.approx(0.05)
        return np.column_stack([np.arange(steps), np.full((steps, 8), 0.5)])

    times = {"pre_0": 4, "actuation": ACTUATION, "post_0": POST} | ({"let_go": STEPS - 1} if let_go else {})
    keyframes = [
        {"label": label, "time": step / 20 if step < reached else None, "reached": step < reached}
        for label, step in times.items()
    ]
    return SimpleNamespace(trajectory=SimpleNamespace(sample_every=sample_every), keyframes=keyframes, reason="")


def targets(rows: Schedule, profile: RobotProfile) -> Any:
    """Return targets (N,) of joint 0 in the simulation."""
    return profile.simulated_targets(rows.reference[:, 0], rows.ends)[:, 0]


@pytest.mark.parametrize("fingers", ["open", "closed", "grasp", "hold", "release"])
@pytest.mark.parametrize("let_go", [False, True])
def test_every_target_is_sent_and_the_last_one_is_held(panda: RobotProfile, fingers: Any, let_go: bool) -> None:
    rows = schedule(plan(let_go=let_go), Acts(fingers, CLOSED, lets_go=let_go), panda)
    meant, sent = rows.reference[:, 0, 0], targets(rows, panda)
    assert rows.reference.dtype == rows.commands.dtype == sent.dtype == np.float32
    assert (meant == np.round(rows.times * panda.control_hz)).all()
    assert (sent[-HOLD - LAG :] == STEPS - 1).all()
    assert ((sent >= meant) & (sent <= meant + LAG)).all()
    assert (np.diff(sent) >= 0).all()
    assert np.diff(sent).max() <= LAG + 1
    assert (np.diff(rows.times) >= 0).all()
    assert rows.times[rows.contact] == pytest.approx(4 / 20)
    assert rows.times[rows.actuation] == pytest.approx(ACTUATION / 20)


def test_open_fingers_stay_open_and_targets_are_ahead_by_the_lag(panda: RobotProfile) -> None:
    rows = schedule(plan(), Acts("open", OPEN), panda)
    assert len(rows) == STEPS + HOLD
    assert (rows.commands == OPEN).all()
    assert targets(rows, panda)[0] == LAG
    assert rows.gripped is None
    assert rows.released is None


def test_the_plan_is_the_same_whatever_drives_the_arm(panda: RobotProfile) -> None:
    """The drives change only the time that the arm gets to arrive; their delay appears in the targets only."""
    soft, stiff = JointDrive(1e3, 2e2, 100.0), JointDrive(1e4, 1e2, 100.0)
    late = replace(panda, simulation=replace(panda.simulation, arm=(soft, stiff, *[soft] * 5)))
    prompt = replace(panda, simulation=replace(panda.simulation, arm=stiff))
    acts = Acts("open", OPEN)
    rows, others = schedule(plan(), acts, prompt), schedule(plan(), acts, late)
    assert rows.reference.tobytes() == others.reference.tobytes()
    assert np.array_equal(prompt.simulated_targets(rows.reference[:, 0], rows.ends), rows.reference[:, 0])
    assert late.lag_steps == (4, 0, 4, 4, 4, 4, 4)
    assert targets(others, late)[0] == 4
    assert [prompt.arrival_steps, late.arrival_steps] == [0, 4]


def test_fingers_that_must_change_do_so_before_the_arm_moves(panda: RobotProfile) -> None:
    rows = schedule(plan(), Acts("closed", CLOSED, before=True), panda)
    assert (rows.commands == CLOSED).all()
    assert (targets(rows, panda)[:FINGERS] == 0).all()
    assert targets(rows, panda)[FINGERS] == LAG


def test_a_grasp_closes_at_the_actuation_pose_and_stays_closed(panda: RobotProfile) -> None:
    rows = schedule(plan(), Acts("grasp", OPEN), panda)
    closed = rows.commands == CLOSED
    first = int(closed.argmax())
    assert closed[first:].all()
    assert (targets(rows, panda)[first - LAG : first + FINGERS] == ACTUATION).all()
    assert (targets(rows, panda)[:first] <= ACTUATION).all()
    assert rows.gripped == first + FINGERS


def test_what_can_be_pushed_away_is_closed_on_slowly_from_the_opening(panda: RobotProfile) -> None:
    rows = schedule(plan(), Acts("grasp", 0.2, opening=0.2, gently=True), panda)
    commands = rows.commands
    assert commands[0] == pytest.approx(0.2)
    meters = 0.5 * (panda.gripper.open - panda.gripper.closed) * -np.diff(commands)
    assert 0 < meters.max() <= 0.06 / 20 + 1e-6
    assert rows.gripped is not None
    assert (commands[rows.gripped - LAG :] == CLOSED).all()


def test_a_release_opens_at_the_actuation_pose(panda: RobotProfile) -> None:
    rows = schedule(plan(), Acts("release", CLOSED), panda)
    opens = rows.commands == OPEN
    first = int(opens.argmax())
    assert opens[first:].all()
    assert rows.released == first
    assert (targets(rows, panda)[first - LAG : first + FINGERS] == ACTUATION).all()


@pytest.mark.parametrize("fingers", ["grasp", "hold"])
def test_letting_go_opens_before_the_hand_backs_off(panda: RobotProfile, fingers: Any) -> None:
    rows = schedule(plan(let_go=True), Acts(fingers, CLOSED if fingers == "hold" else OPEN, lets_go=True), panda)
    assert rows.released is not None
    assert (targets(rows, panda)[rows.released - LAG : rows.released + FINGERS] == POST).all()
    assert (rows.commands[rows.released :] == OPEN).all()
    assert rows.commands[rows.released - 1] == CLOSED


def test_what_was_taken_up_is_pressed_gently(panda: RobotProfile) -> None:
    gripper, width = panda.gripper, 0.033
    command = grip_on(width, 2.0, panda)
    finger = 0.5 * (gripper.open + gripper.closed) + 0.5 * (gripper.open - gripper.closed) * command
    assert (width / 2 - finger) * panda.finger_drive.stiffness == pytest.approx(2.0)
    rows = schedule(plan(), Acts("grasp", OPEN, grip=command, gently=True), panda)
    assert rows.commands.min() == pytest.approx(command)
    assert rows.commands[-1] == pytest.approx(command)


def test_closed_fingers_back_off_closed(panda: RobotProfile) -> None:
    rows = schedule(plan(let_go=True), Acts("closed", CLOSED, lets_go=True), panda)
    assert (rows.commands == CLOSED).all()
    assert rows.released is None


def test_a_part_of_a_motion_that_ends_before_letting_go_keeps_its_grasp(panda: RobotProfile) -> None:
    rows = schedule(plan(steps=12, let_go=True, reached=12), Acts("grasp", OPEN, lets_go=True), panda)
    assert rows.released is None
    assert rows.commands[-1] == CLOSED


def test_a_plan_without_a_trajectory_is_refused(panda: RobotProfile) -> None:
    with pytest.raises(ValueError, match="no trajectory: out of reach"):
        schedule(SimpleNamespace(trajectory=None, reason="out of reach"), Acts("open", OPEN), panda)  # type: ignore[arg-type]


def test_what_weighs_more_is_pressed_harder() -> None:
    """A gold bar of 256 g slips from fingers whose force suits a ball of a few grams, and its force would crush the
    ball.
    """
    assert grip_force(0.0) == grip_force(0.004) == LEAST_GRIP_FORCE
    assert grip_force(0.256) == pytest.approx(LEAST_GRIP_WEIGHTS * 0.256 * GRAVITY)


def test_sloping_faces_are_pressed_harder() -> None:
    parallel, sloping, steep = (grip_force(0.256, margin) for margin in (0.5, 0.12, 0.001))
    assert parallel < sloping < steep == pytest.approx(MAX_GRIP_WEIGHTS * 0.256 * GRAVITY)


def test_what_is_held_beside_its_centre_of_mass_is_pressed_harder() -> None:
    assert grip_force(0.02, 0.28, lever=0.03) > grip_force(0.02, 0.28)
