"""A deadline and a cancel end every search, and the answer says that they did."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, problem

#: The arm turned by a quarter, beyond a wall that it cannot pass.
TURNED = Q_START + np.array([1.57] + [0.0] * 8)
#: Longer than any of these searches takes to notice (s).
SOON = 10.0


def wall() -> kpam.Body:
    """A wall from the arm's foot outwards at 45 degrees, higher than it reaches; the first joint has no whole turn."""
    c = np.sqrt(0.5)
    pose = np.eye(4)
    pose[:3, :3] = [[c, -c, 0], [c, c, 0], [0, 0, 1]]
    pose[:3, 3] = [1.2 * c, 1.2 * c, 0.5]
    return kpam.Body("wall", "rigid", [kpam.Shape.box([1.05, 0.005, 1.2])], pose)


def behind_the_wall(panda: kpam.Robot) -> kpam.KeypointProblem:
    """A pose that can be had, and no way to it."""
    at = panda.forward_kinematics(TURNED) @ np.array([0.0, 0.0, 0.1034, 1.0])
    bodies = [wall()]
    config = {
        "constraint_list": [
            {
                "type": "point2point_constraint",
                "keypoint_name": "tool_head",
                "target_keypoint_name": "goal",
                "tolerance": 1e-3,
            }
        ]
    }
    return problem(
        panda,
        config=config,
        tool_keypoints={"tool_head": np.array([0.0, 0.0, 0.1034])},
        object_keypoints={"goal": at[:3]},
        joint=None,
        bodies=bodies,
        options={"samples": 10_000_000, "harvest": 100_000},
    )


def cancelled_by_another(ask: Any) -> Any:
    """The answer to a question that is cancelled while it is thought about."""
    cancel = kpam.Cancel()
    timer = threading.Timer(0.1, cancel.cancel)
    timer.start()
    begun = time.monotonic()
    answer = ask(cancel)
    assert time.monotonic() - begun < SOON
    timer.join()
    return answer


def test_a_deadline_ends_a_motions_search(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda, [wall()])
    begun = time.monotonic()
    late = scene.plan_to(Q_START, TURNED, samples=100_000_000, deadline_ms=50.0)
    assert time.monotonic() - begun < SOON
    assert (late.status, late.trajectory) == ("late", None)
    assert "time" in late.reason
    # Without one, the samples are what ends it.
    spent = scene.plan_to(Q_START, TURNED, samples=20)
    assert spent.status == "not_found"
    with pytest.raises(kpam.ProblemError, match="deadline_ms"):
        scene.plan_to(Q_START, TURNED, deadline_ms=-1.0)


def test_a_motion_found_in_time_is_the_one_without_a_deadline(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda)
    free, timed = scene.plan_to(Q_START, TURNED), scene.plan_to(Q_START, TURNED, deadline_ms=60_000.0)
    assert free.trajectory is not None
    assert timed.trajectory is not None
    np.testing.assert_array_equal(free.trajectory.positions, timed.trajectory.positions)


def test_a_cancel_ends_a_motions_search(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda, [wall()])
    cancel = kpam.Cancel()
    cancel.cancel()
    assert scene.plan_to(Q_START, TURNED, cancel=cancel).status == "cancelled"
    later = cancelled_by_another(lambda c: scene.plan_to(Q_START, TURNED, samples=100_000_000, cancel=c))
    assert (later.status, later.trajectory) == ("cancelled", None)


def test_a_deadline_ends_a_plan(panda: kpam.Robot) -> None:
    question = behind_the_wall(panda)
    begun = time.monotonic()
    plan = kpam.plan(question, deadline_ms=100.0)
    assert time.monotonic() - begun < SOON
    assert (plan.status, plan.trajectory) == ("not_found", None)
    assert "the time is up" in plan.reason


def test_a_cancel_ends_a_plan(panda: kpam.Robot) -> None:
    question = behind_the_wall(panda)
    cancel = kpam.Cancel()
    cancel.cancel()
    assert kpam.plan(question, cancel=cancel).status == "cancelled"
    later = cancelled_by_another(lambda c: kpam.plan(question, cancel=c))
    assert (later.status, later.trajectory) == ("cancelled", None)
