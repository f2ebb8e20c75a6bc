"""The picture of a plan: keypoints are where they are seen, frames and residuals stand on it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

pytest.importorskip("embreex")

from gensim2.perception.raycast.drawing import OVERSAMPLING, Drawing
from gensim2.perception.raycast.shapes import Surface, read_links
from gensim2.planning import picture
from gensim2.planning.picture import SIZE, TARGET, plan_picture
from gensim2.planning.scene import Scene, SceneBody, SceneObject
from gensim2.robots import robot

GREEN = "#2f9e44"


def colored(picture: np.ndarray, color: str) -> np.ndarray:
    """Rows and columns (N, 2) of the pixels of one colour."""
    wanted = [int(color[at : at + 2], 16) for at in (1, 3, 5)]
    return np.argwhere(np.abs(picture.astype(int) - wanted).sum(axis=-1) < 20)


def test_a_point_is_a_disc_or_a_ring_behind_something() -> None:
    wall = Surface.box((0.0, 0.0, 0.0), (0.01, 0.3, 0.3), (200, 200, 200))
    pictures = []
    for x in (-0.2, 0.2):  # the camera looks along x
        drawing = Drawing([(wall, np.eye(4))], (-1.5, 0.0, 0.0), (0.0, 0.0, 0.0), 160)
        drawing.point((x, 0.0, 0.0), GREEN)
        pictures.append(np.asarray(drawing.picture()))
    disc, ring = (colored(each, GREEN) for each in pictures)
    assert np.abs(disc.mean(axis=0) - 79.5).max() < 1.5
    assert len(ring) < 0.8 * len(disc)


def test_labels_do_not_cover_each_other_and_points_behind_the_camera_are_not_drawn() -> None:
    box = Surface.box((0.0, 0.0, 0.0), (0.1, 0.1, 0.1), (200, 200, 200))
    drawing = Drawing([(box, np.eye(4))], (-1.5, 0.0, 0.0), (0.0, 0.0, 0.0), 200)
    for color in ("#ff0000", "#0000ff"):
        drawing.point((-0.2, 0.0, 0.0), color, "a keypoint")
    drawing.point((-5.0, 0.0, 0.0), GREEN, "behind")
    drawing.frame(np.array([[1.0, 0, 0, -5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]), 0.1, "behind")
    picture = np.asarray(drawing.picture())
    red, blue = (colored(picture, color) for color in ("#ff0000", "#0000ff"))
    words = [each[each[:, 1] > 112] for each in (red, blue)]
    assert min(len(each) for each in words) > 10
    assert words[0][:, 0].max() < words[1][:, 0].min()
    assert not len(colored(picture, GREEN))


@pytest.fixture
def scene() -> Scene:
    """A cube of 20 cm in front of the arm, which is stretched upwards."""
    profile = robot("panda")
    corners = np.array(np.meshgrid([-0.1, 0.1], [-0.1, 0.1], [0.0, 0.2])).T.reshape(-1, 3)
    T = np.eye(4)
    T[:3, 3] = (0.5, 0.0, 0.0)
    thing = SceneObject(
        "chest", (SceneBody("chest", (corners,), T),), T, {"rigidbody_object_top": np.array([0.5, 0, 0.2])}
    )
    rest = np.zeros(len(profile.model.joint_names))
    return Scene(rest, rest, profile.T_world_base, {"chest": thing})


def test_a_scene_without_a_plan_shows_the_arm_the_object_and_its_keypoints(scene: Scene) -> None:
    profile = robot("panda")
    sheet = np.asarray(plan_picture(scene, None, profile, title="Lift, step lift: no_grasp", reason="it is too wide"))
    assert sheet.shape[1] == 2 * SIZE + 4
    assert sheet.shape[0] > SIZE
    assert len(colored(sheet[:SIZE, :SIZE], "#c2410c")) > 30
    assert (sheet[SIZE:] < 128).any(), "the text"
    assert not len(colored(sheet, TARGET))
    for far, number in ((0.1, 1), (0.001, 0)):  # a target at a keypoint is not marked by itself
        aim = np.array([0.5, 0.0, 0.2 + far])
        sheet = np.asarray(plan_picture(scene, None, profile, title="Lift", targets=[aim]))
        assert (len(colored(sheet[:SIZE, :SIZE], TARGET)) > 30) == bool(number)


@pytest.mark.parametrize("away", [(0.0, 1.2, 0.0), (0.0, -1.2, 0.0), (1.2, 0.0, 0.6)])
def test_both_views_show_the_whole_hand_and_a_target_out_of_reach(
    scene: Scene, away: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    profile, drawn = robot("panda"), []

    class Kept(Drawing):
        def __init__(self, solids: Sequence[tuple[Surface, np.ndarray]], *args: Any) -> None:
            super().__init__(solids, *args)
            drawn.append(self)

    monkeypatch.setattr(picture, "Drawing", Kept)
    target = np.array([0.5, 0.0, 0.2]) + away
    views = np.asarray(plan_picture(scene, None, profile, title="Lift", targets=[target]))[:SIZE]
    for view in (views[:, :SIZE], views[:, -SIZE:]):
        assert len(colored(view, TARGET)) > 30
    T = profile.model.forward_kinematics(scene.q)
    hand = T[:3, 3] + read_links(profile.urdf)["panda_hand"].vertices @ T[:3, :3].T
    for each in drawn:
        pixels = np.array([each._project(point)[:2] for point in hand])
        assert 0 <= pixels.min() <= pixels.max() <= OVERSAMPLING * SIZE


def test_the_edges_of_a_white_box_are_drawn() -> None:
    box = Surface.box((0.0, 0.0, 0.0), (0.1, 0.1, 0.1), (255, 255, 255))
    # The camera looks at the middle of one vertical edge, whose two faces have the same angle to the camera.
    picture = np.asarray(Drawing([(box, np.eye(4))], (0.6, 0.6, 0.0), (0.0, 0.0, 0.0), 101).picture()).mean(axis=2)
    row = picture[50]
    left, right = row[35:45].mean(), row[56:66].mean()
    assert row[49:52].min() < 0.8 * min(left, right)
    assert np.ptp(row[35:45]) < 8.0
