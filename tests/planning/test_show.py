"""A plan's page is served, and moves: no browser takes part, the page's own protocol is spoken."""

from __future__ import annotations

import urllib.request

import numpy as np
import pytest
from gensim2.planning.problem import SceneProblems

import gensim2_kpam as kpam
from gensim2.planning.scene import JointState, Scene, SceneBody

pytest.importorskip("viser")
pytest.importorskip("yourdfpy")
pytest.importorskip("mani_skill")

CONFIG = {
    "constraint_list": [
        {
            "type": "point2point_constraint",
            "keypoint_name": "tool_head",
            "target_keypoint_name": "articulated_object_head",
            "tolerance": 0.001,
        }
    ],
    "post_actuation_motions": ["move-up"],
}


@pytest.fixture
def scene() -> Scene:
    corners = np.array([[x, y, z] for x in (-0.6, 0.6) for y in (-0.6, 0.6) for z in (-0.05, 0.0)])
    table = SceneBody("table", "table", (corners,), np.eye(4))
    joint = JointState("revolute", np.array([0.5, 0.3, 0.1]), np.array([1.0, 0.0, 0.0]), 0.1, 0.0, 1.0)
    q = np.array([0.0, -0.32, 0.0, -2.618, 0.0, 2.23, 0.785, 0.04, 0.04])
    keypoints = {"articulated_object_head": np.array([0.5, 0.1, 0.3])}
    return Scene(q, np.eye(4), np.eye(4), keypoints, joint, 0.0, (table,))


@pytest.mark.parametrize("reach", [0.5, 5.0])
def test_the_page_of_a_plan(scene: Scene, reach: float) -> None:
    from gensim2.planning.show import show

    scene.object_keypoints["articulated_object_head"][0] = reach
    plan = kpam.plan(SceneProblems(scene).problem(kpam.SolverConfig(CONFIG)))
    assert (plan.trajectory is not None) == (reach < 1.0)
    server = show(scene, plan, port=18080)
    try:
        address = f"http://{server.get_host()}:{server.get_port()}"
        with urllib.request.urlopen(address, timeout=20) as answer:
            assert b"<html" in answer.read(4000).lower()
    finally:
        server.stop()
