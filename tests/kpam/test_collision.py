"""Plain collision checks of many configurations; tests/bench compares them with coal's."""

from __future__ import annotations

import numpy as np
import pytest

import gensim2_kpam as kpam

from . import kpam_scenes


def arm_among(panda: kpam.Robot, bodies: list[kpam.Body]) -> kpam.KeypointProblem:
    return kpam_scenes.problem(panda, bodies=bodies)


def test_a_ball_at_the_hand_is_hit_and_one_far_away_is_not(panda: kpam.Robot) -> None:
    hand = panda.forward_kinematics(kpam_scenes.Q_START)
    for offset, expected in ((0.0, True), (1.5, False)):
        pose = np.eye(4)
        pose[:3, 3] = hand[:3, 3] + [0.0, 0.0, offset]
        ball = kpam.Body("ball", "rigid", [kpam.Shape.sphere(0.03)], pose)
        assert arm_among(panda, [ball]).scene.in_collision(kpam_scenes.Q_START) is expected


def test_the_arm_hits_itself_folded_and_not_at_rest(panda: kpam.Robot) -> None:
    folded = kpam_scenes.Q_START.copy()
    folded[[1, 3]] = [1.7, -3.0]
    found = arm_among(panda, []).scene.in_collision(np.stack([kpam_scenes.Q_START, folded]))
    assert found.dtype == np.bool_
    assert found.tolist() == [False, True]


def test_a_wrong_row_is_refused(panda: kpam.Robot) -> None:
    problem = arm_among(panda, [])
    for q in (np.zeros(3), np.zeros((2, 8)), np.full(9, np.nan)):
        with pytest.raises(kpam.ProblemError, match="q"):
            problem.scene.in_collision(q)
