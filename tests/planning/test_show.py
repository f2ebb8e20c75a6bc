"""A plan's page is served and animated; the test uses the page's protocol instead of a browser."""

from __future__ import annotations

import urllib.request
from typing import Any

import numpy as np
import pytest
from constraints import point_to_point

from gensim2.planning.scene import JointState, Scene, SceneBody, SceneObject
from gensim2.planning.steps import StepPlanner
from gensim2.planning.strategies import KeypointStrategy
from gensim2.robots import robot
from gensim2.tasks.spec import Step

pytest.importorskip("viser")
pytest.importorskip("yourdfpy")
pytest.importorskip("mani_skill")

CONFIG = {
    "constraint_list": [point_to_point("tool_head", "articulated_object_head", 0.001)],
    "post_actuation_motions": ["move-up"],
}


CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


def at(*xyz: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = xyz
    return pose


def scene(reach: float, held: str | None) -> Scene:
    """A lid, and a cube beside it or in the hand."""
    profile = robot("panda")
    q = np.array(profile.reset_qpos)
    table = SceneBody("table", (0.6 * CORNERS,), at(0.0, 0.0, -0.61))
    joint = JointState("revolute", np.array([0.5, 0.3, 0.1]), np.array([1.0, 0.0, 0.0]), 0.1, 0.0, 1.0, ("lid/top",))
    top = SceneBody("lid/top", (0.02 * CORNERS,), at(0.7, 0.4, 0.1))
    lid = SceneObject("lid", (top,), np.eye(4), {"articulated_object_head": np.array([reach, 0.1, 0.3])}, joint)
    place = profile.model.forward_kinematics(q) @ at(0.0, 0.0, 0.12) if held else at(0.3, 0.5, 0.02)
    cube = SceneObject("cube", (SceneBody("cube", (0.02 * CORNERS,), place),), place, {"center": place[:3, 3]})
    return Scene(q, np.zeros(9), np.eye(4), {"lid": lid, "cube": cube}, (table,), held)


@pytest.mark.parametrize(("reach", "held"), [(0.5, None), (0.5, "cube"), (5.0, None)])
def test_the_page_of_a_plan(reach: float, held: str | None) -> None:
    from gensim2.planning.show import show

    profile = robot("panda")
    stands = scene(reach, held)
    step = Step(name="reach", object="lid", strategies=("reach",))
    plan = StepPlanner(profile).plan(stands, step, KeypointStrategy(CONFIG)).plan
    assert plan is not None
    assert (plan.trajectory is not None) == (reach < 1.0)
    server = show(stands, plan, profile, port=18080)
    try:
        address = f"http://{server.get_host()}:{server.get_port()}"
        with urllib.request.urlopen(address, timeout=20) as answer:
            assert b"<html" in answer.read(4000).lower()
    finally:
        server.stop()


def test_labels_of_one_place_share_a_line() -> None:
    from gensim2.planning.show import APART, draw_plans

    class Page:
        """Records labels and ignores everything else."""

        def __init__(self) -> None:
            self.scene, self.labels = self, {}

        def add_label(self, name: str, text: str, position: np.ndarray, anchor: str) -> None:
            self.labels[name] = text, position

        def add_frame(self, name: str, **_: Any) -> None: ...

        def add_line_segments(self, name: str, *_: Any, **__: Any) -> None: ...

    profile, stands = robot("panda"), scene(0.5, None)
    step = Step(name="reach", object="lid", strategies=("reach",))
    plan = StepPlanner(profile).plan(stands, step, KeypointStrategy(CONFIG)).plan
    assert plan is not None
    page = Page()
    draw_plans(page, {"1 reach": plan, "2 reach again": plan}, profile)
    texts = [text for text, _ in page.labels.values()]
    assert any("1: actuation" in text and "2: actuation" in text for text in texts)
    assert sum(text.count("actuation") for text in texts) == 2
    places = np.array([place for _, place in page.labels.values()])
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)[~np.eye(len(places), dtype=bool)]
    assert (apart >= APART).all()
