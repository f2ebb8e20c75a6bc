"""The page of a scene and a motion is served; no browser takes part."""

from __future__ import annotations

import sys
import urllib.request

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gensim2_kpam as kpam
from gensim2_kpam import show as page

from .kpam_scenes import Q_START, table


def test_quaternions_are_scipys() -> None:
    turns = Rotation.random(200, rng=3)
    for turn in [*turns, Rotation.from_rotvec([np.pi, 0, 0]), Rotation.from_rotvec([0, np.pi, 0]), Rotation.identity()]:
        ours = page._quaternion(turn.as_matrix())
        theirs = turn.as_quat(scalar_first=True)
        assert min(np.abs(ours - theirs).max(), np.abs(ours + theirs).max()) < 1e-9


def test_surfaces_are_those_of_the_shapes(panda: kpam.Robot) -> None:
    pose = np.eye(4)
    cloud = kpam.Shape.point_cloud(np.arange(12.0).reshape(4, 3), 0.01)
    box = kpam.Shape.box([0.1, 0.2, 0.3])
    triangles, balls = kpam.Body("both", "rigid", [box, cloud], pose).surface()
    a, b, c = (triangles[:, k] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert volume == pytest.approx(0.2 * 0.4 * 0.6)
    np.testing.assert_allclose(balls, np.column_stack([np.arange(12.0).reshape(4, 3), np.full(4, 0.01)]))
    assert len(panda.surface("panda_hand")[0]) > 3
    with pytest.raises(kpam.ProblemError, match="nowhere"):
        panda.surface("nowhere")


def test_the_page_of_a_motion_is_served(panda: kpam.Robot) -> None:
    pytest.importorskip("viser")
    held = kpam.Body("held", "attached", [kpam.Shape.sphere(0.02)], np.eye(4))
    scene = kpam.Scene(panda, [table(), held])
    goal = Q_START + np.append(np.full(7, 0.2), [0, 0])
    for motion in (scene.plan_to(Q_START, goal, margin=0.0), None):
        server = page.show(scene, motion, port=18180)
        try:
            address = f"http://{server.get_host()}:{server.get_port()}"
            with urllib.request.urlopen(address, timeout=20) as answer:
                assert b"<html" in answer.read(4000).lower()
        finally:
            server.stop()


def test_a_missing_viewer_names_the_extra(panda: kpam.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(page.MissingViewerError, match=r"gensim2-kpam\[viz\]"):
        page.show(kpam.Scene(panda))
