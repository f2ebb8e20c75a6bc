"""Videos by ray casting: near surfaces hide far ones, inclined ones are darker, and points are drawn where they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from gensim2.data.close_up import TEXT, CloseUp
from gensim2.data.films import DOT, PAPER, dotted, film_index, film_path
from gensim2.perception import Camera
from gensim2.perception.raycast.drawing import AMBIENT, SKY, Drawing
from gensim2.perception.raycast.shapes import Surface
from gensim2.rollout.recording import Recorder
from gensim2.sim.headless import HeadlessEnv

CAMERA = Camera.looking("film", (0, 0, 2), (0.001, 0, 0), width=32, height=32, fov=1.0)


@dataclass
class MadeUpView:
    """An image with given depths."""

    depth: npt.NDArray[np.float32]
    camera: Camera = CAMERA
    segmentation: npt.NDArray[np.int16] | None = None


def test_points_are_drawn_where_the_camera_sees_them_and_near_ones_hide_far_ones() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 5.0]])  # the last one is behind the camera
    colours = np.array([[0, 0, 0], [255, 0, 0], [0, 255, 0]], np.uint8)
    picture = dotted(points, colours, CAMERA)
    assert picture[16, 16].tolist() == [254, 96, 96]
    drawn = (picture != PAPER).any(axis=-1)
    assert drawn.sum() == (2 * DOT - 1) ** 2
    assert (dotted(points[:0], colours[:0], CAMERA) == PAPER).all()


def test_a_surface_is_darker_the_more_it_turns_away_and_nothing_is_sky() -> None:
    cube = Surface.box((0, 0, 0), (0.1, 0.1, 0.1), (200, 200, 200))
    for flipped in (cube, replace(cube, faces=cube.faces[:, ::-1].copy())):  # whatever side its triangles face
        above, below = (
            np.asarray(Drawing([(flipped, np.eye(4))], (-0.5, -0.5, z), (0, 0, 0), 64).picture()) for z in (0.5, -0.5)
        )
        top, bottom = above[25, 32].mean(), below[38, 32].mean()
        assert 195 < top <= 202
        assert bottom == pytest.approx(200 * AMBIENT, abs=2)
        assert above[3, 3].tolist() == list(SKY)
        sides = above[38, 26].mean(), above[38, 38].mean()
        assert bottom < min(sides) + 5 < max(sides) < top


def test_the_close_up_shows_the_fingertips_from_the_side_where_nothing_hides_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    env = HeadlessEnv("OpenDrawer", assets="builtin")
    env.reset(seed=3)
    recorder = Recorder(env)
    recorder.add(env.profile.rest_action, env.measure())
    states = recorder.finish().env_states
    first = {kind: {name: rows[:1] for name, rows in group.items()} for kind, group in states.items()}
    models = {name: thing.model for name, thing in env.initial_state.objects.items()}
    close_up = CloseUp(env.profile, models, 200)
    black = np.zeros((200, 300, 3), np.uint8)
    drawn = close_up.onto(black, first)
    assert not black.any(), "the given picture is not changed"
    assert not drawn[:-62].any()
    assert not drawn[:, :-62].any()
    assert len(np.unique(drawn[-60:, -60:].reshape(-1, 3), axis=0)) > 50
    assert (drawn[-60:-44, -60:] == TEXT).all(axis=-1).any(), "the close-up has a title"
    tips = close_up._scene.see(close_up._scene.poses(first)[0], {env.profile.hand_link: np.eye(4)})[0].camera
    assert tips.T_base_camera[:3, 1] @ [0, 0, 1] > 0.8, "the fingers point down in the picture"

    monkeypatch.setattr("gensim2.data.close_up.shaded", lambda view: black[:30, :30])
    wall, free = np.full((30, 30), 0.1, np.float32), np.full((30, 30), 2.0, np.float32)
    for depths, side in (((wall, free), 1), ((wall, wall), 1), ((free, wall), 0), ((free, free), 0)):
        views = tuple(MadeUpView(depth, replace(CAMERA, width=30, height=30)) for depth in depths)
        monkeypatch.setattr(close_up._scene, "see", lambda *_, views=views: views)
        monkeypatch.setattr(close_up, "_size", 30)
        close_up.onto(black, first)
        assert close_up._side == side


def test_a_film_is_known_by_its_episode() -> None:
    assert film_index(film_path(Path("somewhere"), 17)) == 17
