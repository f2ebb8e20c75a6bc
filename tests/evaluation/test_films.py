"""Videos by ray casting: near surfaces hide far ones, inclined ones are darker, and points are drawn where they are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gensim2.evaluation.films import AMBIENT, DOT, PAPER, SKY, dotted, film_index, film_path, shaded
from gensim2.perception import Camera

CAMERA = Camera.looking("film", (0, 0, 2), (0.001, 0, 0), width=32, height=32, fov=1.0)


@dataclass
class MadeUpView:
    """An image of one colour with given depths."""

    depth: npt.NDArray[np.float32]
    camera: Camera = CAMERA
    segmentation: npt.NDArray[np.int16] | None = None

    def colors_at(self, pixels: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
        return np.full((len(pixels), 3), 200, np.uint8)


def test_points_are_drawn_where_the_camera_sees_them_and_near_ones_hide_far_ones() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 5.0]])  # the last one is behind the camera
    colours = np.array([[0, 0, 0], [255, 0, 0], [0, 255, 0]], np.uint8)
    picture = dotted(points, colours, CAMERA)
    assert picture[16, 16].tolist() == [254, 96, 96]
    drawn = (picture != PAPER).any(axis=-1)
    assert drawn.sum() == (2 * DOT - 1) ** 2
    assert (dotted(points[:0], colours[:0], CAMERA) == PAPER).all()


def test_a_surface_is_darker_the_more_it_turns_away_and_nothing_is_sky() -> None:
    flat = np.full((32, 32), 2.0, np.float32)  # a plane perpendicular to the view
    floor = shaded(MadeUpView(flat))  # type: ignore[arg-type]
    expected = 200 * (AMBIENT + (1 - AMBIENT) * 0.8 / np.linalg.norm((0.3, -0.5, 0.8)))
    assert np.abs(floor[5:20, 5:20].astype(float) - expected).max() < 3
    ramp = np.linspace(0, 8, 32, dtype=np.float32)[None]
    sides = [shaded(MadeUpView(flat + each))[5:20, 5:20].mean() for each in (ramp, ramp[:, ::-1])]  # type: ignore[arg-type]
    assert min(sides) < floor[5:20, 5:20].mean() < max(sides)
    assert shaded(MadeUpView(np.zeros((32, 32), np.float32)))[3, 3].tolist() == list(SKY)  # type: ignore[arg-type]


def test_a_film_is_known_by_its_episode() -> None:
    assert film_index(film_path(Path("somewhere"), 17)) == 17
