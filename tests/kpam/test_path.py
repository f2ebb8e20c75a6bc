"""Constraints along a motion to a goal: a glass that is carried upright."""

from __future__ import annotations

import numpy as np
import pytest
from constraints import parallel, point_to_point

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, TOOL

GOAL = np.array([1.2, -0.1, 0.0, -2.2, 0.0, 2.1, 0.9, 0.04, 0.04])


def upright(tolerance: float, **changes: object) -> kpam.SolverConfig:
    """The tool points down within a tolerance."""
    entry = parallel("tool_head", "tool_tail", [0, 0, 1], tolerance)
    return kpam.SolverConfig({"constraint_list": [{**entry, **changes}]})


def wall(height: float) -> kpam.Body:
    pose = np.eye(4)
    pose[:3, 3] = [0.45, 0.3, 0.5 * height]
    return kpam.Body("wall", "rigid", [kpam.Shape.box([0.25, 0.02, 0.5 * height])], pose)


def tilts(panda: kpam.Robot, motion: kpam.Motion) -> np.ndarray:
    """Return the angle (rad) between the tool and straight down, by samples."""
    assert motion.trajectory is not None, motion.reason
    q = motion.trajectory.sample(np.linspace(0.0, motion.trajectory.duration, 4000))[0]
    axis = panda.forward_kinematics(q)[:, :3, :3] @ (np.subtract(TOOL["tool_head"], TOOL["tool_tail"]) / 0.03)
    return np.asarray(np.arccos(np.clip(-axis[:, 2], -1.0, 1.0)))


@pytest.mark.parametrize("tolerance", [0.3, 0.1])
def test_a_glass_is_carried_upright_over_a_wall(panda: kpam.Robot, tolerance: float) -> None:
    scene = kpam.Scene(panda, [wall(0.45)])
    start = scene.ik(level(panda, Q_START), Q_START)[0]
    goal = scene.ik(level(panda, GOAL), GOAL)[0]
    free = scene.plan_to(start, goal, limits="panda")
    kept = scene.plan_to(start, goal, limits="panda", path=upright(tolerance), tool_keypoints=TOOL)
    assert kept.status == "solved", kept.reason
    assert tilts(panda, kept).max() <= tolerance + 1e-6
    assert tilts(panda, free).max() > 0.1
    assert kept.trajectory is not None
    end = kept.trajectory.sample(kept.trajectory.duration)[0]
    np.testing.assert_allclose(end, goal, atol=1e-9)
    q = kept.trajectory.sample(np.linspace(0.0, kept.trajectory.duration, 600))[0]
    # The Panda's own links are close by design, so only the wall counts.
    nearest = [pair for pair in kept.nearer if "wall" in pair]
    assert not nearest
    assert not scene.in_collision(q).any()


def level(panda: kpam.Robot, q: np.ndarray) -> np.ndarray:
    """Return the hand's pose there, turned so that the tool points straight down."""
    pose = panda.forward_kinematics(q)
    x = pose[:3, 0] * [1, 1, 0]
    x /= np.linalg.norm(x)
    pose[:3, :3] = np.column_stack([x, np.cross([0, 0, -1.0], x), [0, 0, -1.0]])
    return pose


def test_what_cannot_hold_along_a_path_is_named(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda)
    tilted = Q_START.copy()
    tilted[5] -= 0.6
    with pytest.raises(kpam.ProblemError, match=r"q_start: violates .* by"):
        scene.plan_to(tilted, GOAL, path=upright(0.1), tool_keypoints=TOOL)
    with pytest.raises(kpam.ProblemError, match=r"tool_head.*no keypoint of the tool"):
        scene.plan_to(Q_START, GOAL, path=upright(0.1))
    with pytest.raises(kpam.ProblemError, match="world"):
        scene.plan_to(Q_START, GOAL, path=upright(0.1, target_axis_frame="object"), tool_keypoints=TOOL)
    point = point_to_point("tool_head", "x", 0.1)
    with pytest.raises(kpam.ProblemError, match="only axis constraints"):
        scene.plan_to(Q_START, GOAL, path=kpam.SolverConfig({"constraint_list": [point]}), tool_keypoints=TOOL)
