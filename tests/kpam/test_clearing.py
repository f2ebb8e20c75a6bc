"""Poses that are moved out of overlaps: slots in which few poses of the constraints fit."""

from __future__ import annotations

import numpy as np
import pytest

import gensim2_kpam as kpam
from gensim2.planning.reaching import reach

from .kpam_scenes import config, problem, table

MIDDLE = np.array([0.5, 0.1, 0.14])


def slot(yaw: float, half_width: float) -> list[kpam.Body]:
    """Two walls, as high as the hand is long, on both sides of the fingertips' target."""
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    walls = []
    for side in (-1, 1):
        pose = np.eye(4)
        pose[:3, :3] = turn
        pose[:3, 3] = MIDDLE + side * (half_width + 0.01) * turn[:, 0]
        walls.append(kpam.Body(f"wall {side}", "object_body", [kpam.Shape.box([0.01, 0.2, 0.14])], pose))
    return walls


def into_slot(panda: kpam.Robot, yaw: float, half_width: float, **options: object) -> kpam.KeypointProblem:
    loose = config(gripper="closed", post_actuation_motions=[])
    loose["constraint_list"][0]["tolerance"] = 0.03
    for axis in loose["constraint_list"][1:]:
        axis["tolerance"] = 0.5
    bodies = [table(), *slot(yaw, half_width)]
    return problem(panda, config=loose, bodies=bodies, joint=None, options={"finger_width": 0.0, **options})


def planned(panda: kpam.Robot, yaw: float, half_width: float, explain: bool = False) -> kpam.Plan:
    return kpam.plan(into_slot(panda, yaw, half_width), explain=explain)


@pytest.mark.parametrize("yaw", [0.3, 0.6])
@pytest.mark.parametrize("half_width", [0.034, 0.036, 0.04])
def test_a_hand_gets_into_a_slot_that_is_hardly_wider(panda: kpam.Robot, yaw: float, half_width: float) -> None:
    plan = planned(panda, yaw, half_width)
    assert plan.status == "solved", plan.reason
    assert plan.trajectory is not None
    assert all(residual["satisfied"] for residual in plan.residuals)
    q = np.array([plan.trajectory.sample(t)[0] for t in np.linspace(0.0, plan.trajectory.duration, 200)])
    walls = kpam.Scene(panda, slot(yaw, half_width))
    assert np.asarray(walls.distance(q, 0.05)).min() > 0.0
    assert planned(panda, yaw, half_width).q_plan == pytest.approx(plan.q_plan, abs=0.0)
    assert planned(panda, yaw, half_width, explain=True).q_plan == pytest.approx(plan.q_plan, abs=0.0)


def test_what_reaches_for_nothing_touches_nothing_early_however_it_got_in(panda: kpam.Robot) -> None:
    assert kpam.plan(into_slot(panda, 0.3, 0.036, clearings=0, extra_seeds=0)).status == "collision"
    found = reach(lambda options: into_slot(panda, 0.3, 0.036, **options), (None,))
    assert (found.plan.status, found.touches) == ("solved", None)
    gentle = reach(lambda options: into_slot(panda, 0.3, 0.036, **options), (0.003, None))
    assert (gentle.plan.status, gentle.clearance, gentle.touches) == ("solved", 0.003, None)


def test_a_slot_that_is_narrower_than_the_hand_is_none(panda: kpam.Robot) -> None:
    plan = planned(panda, 0.3, 0.02)
    assert plan.status == "collision"
    assert "wall" in plan.reason
