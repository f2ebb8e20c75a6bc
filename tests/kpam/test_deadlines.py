"""Deadline and cancellation end every search, and the answer says so."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from constraints import point_to_point

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, problem

#: The arm turned by a quarter, behind a wall.
TURNED = Q_START + np.array([1.57] + [0.0] * 8)


def walls(*, shut: bool = False) -> list[kpam.Body]:
    """Return a wall from the arm's base outwards at 45 degrees, and a ceiling, which block the straight path.

    If ``shut``, a second wall in the opposite direction leaves only narrow paths beside the base.
    """
    c = np.sqrt(0.5)
    pose = np.eye(4)
    pose[:3, :3] = [[c, -c, 0], [c, c, 0], [0, 0, 1]]
    pose[:3, 3] = [1.2 * c, 1.2 * c, 0.5]
    over, back = np.eye(4), pose.copy()
    over[2, 3] = 0.95
    back[:2, 3] *= -1
    behind = [kpam.Body("behind", "rigid", [kpam.Shape.box([1.05, 0.005, 1.2])], back)] if shut else []
    return [
        *behind,
        kpam.Body("wall", "rigid", [kpam.Shape.box([1.05, 0.005, 1.2])], pose),
        kpam.Body("ceiling", "rigid", [kpam.Shape.box([1.5, 1.5, 0.005])], over),
    ]


def behind_the_wall(panda: kpam.Robot, *, shut: bool = False, **options: Any) -> kpam.KeypointProblem:
    """Return a problem whose pose is behind the wall."""
    at = panda.forward_kinematics(TURNED) @ np.array([0.0, 0.0, 0.1034, 1.0])
    config = {"constraint_list": [point_to_point("tool_head", "goal", 1e-3)]}
    return problem(
        panda,
        config=config,
        tool_keypoints={"tool_head": np.array([0.0, 0.0, 0.1034])},
        object_keypoints={"goal": at[:3]},
        joint=None,
        bodies=walls(shut=shut),
        options=options,
    )


def test_a_deadline_ends_a_motions_search(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda, walls())
    late = scene.plan_to(Q_START, TURNED, deadline_ms=0.0)
    assert (late.status, late.trajectory) == ("late", None)
    assert "deadline" in late.reason
    # Without a deadline, the number of samples ends the search.
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
    scene = kpam.Scene(panda, walls())
    cancel = kpam.Cancel()
    cancel.cancel()
    ended = scene.plan_to(Q_START, TURNED, cancel=cancel)
    assert (ended.status, ended.trajectory) == ("cancelled", None)


def test_a_deadline_ends_a_plan(panda: kpam.Robot) -> None:
    question = behind_the_wall(panda)
    plan = kpam.plan(question, deadline_ms=0.0)
    assert (plan.status, plan.trajectory) == ("not_found", None)
    assert "the time is up" in plan.reason


def test_a_cancel_ends_a_plan(panda: kpam.Robot) -> None:
    cancel = kpam.Cancel()
    cancel.cancel()
    ended = kpam.plan(behind_the_wall(panda), cancel=cancel)
    assert (ended.status, ended.trajectory) == ("cancelled", None)


@pytest.mark.parametrize("question", ["motion", "plan"])
def test_a_cancel_amidst_a_search_ends_it(panda: kpam.Robot, question: str) -> None:
    # The only path leads through the gap between the walls and the base; the search takes 0.3 s of CPU to find it.
    cancel, answers = kpam.Cancel(), []
    ask: Callable[[], Any]
    if question == "motion":
        scene = kpam.Scene(panda, walls(shut=True))
        scene.plan_to(Q_START, TURNED, samples=20)
        ask = lambda: scene.plan_to(Q_START, TURNED, samples=1_000_000_000, cancel=cancel)  # noqa: E731
    else:
        asked = behind_the_wall(panda, shut=True, samples=1_000_000)
        ask = lambda: kpam.plan(asked, cancel=cancel)  # noqa: E731
    thread = threading.Thread(target=lambda: answers.append(ask()))
    thread.start()
    thread.join(0.03)
    assert thread.is_alive()
    cancel.cancel()
    thread.join(60)
    (ended,) = answers
    assert (ended.status, ended.trajectory) == ("cancelled", None)
