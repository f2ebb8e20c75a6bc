"""Large images are subsampled before a cloud is made of them."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from gensim2.perception import Camera, ObservationSpec
from gensim2.robots import robot
from gensim2_robot.devices import CameraFrame
from gensim2_robot.eyes import PIXELS, CameraPoseError, Eyes, SensorSnapshot, require_robot, thinned
from gensim2_robot.simulated import simulated_cameras, sized

CAMERAS = simulated_cameras(robot("panda"), 320, 240)


def rays(camera: Camera) -> npt.NDArray[np.float64]:
    """Return directions through the centres of all pixels, (H, W, 3)."""
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    return np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(camera.intrinsic).T


@pytest.mark.parametrize(
    ("width", "height", "step"), [(64, 48, 1), (320, 240, 1), (424, 240, 1), (640, 480, 2), (1279, 719, 3)]
)
def test_each_pixel_that_stays_looks_where_it_looked(width: int, height: int, step: int) -> None:
    camera = sized(CAMERAS, width, height)[0]
    fewer, found = thinned(camera)
    assert found == step
    assert fewer.width * fewer.height >= min(PIXELS, width * height)
    np.testing.assert_allclose(rays(fewer), rays(camera)[::step, ::step], atol=1e-12)
    assert fewer.name == camera.name


def test_depth_that_was_corrected_is_corrected_once() -> None:
    profile = robot("panda")
    camera = replace(sized(CAMERAS, 64, 48)[0], depth_scale=1.01, depth_bias=0.005)
    eyes = Eyes(ObservationSpec(cameras=(camera.name,), modalities=("depth",)), profile, (camera,), "shut it")
    measured = np.full((48, 64), 300, np.uint16)  # in front of the robot, hiding it
    q = np.array(profile.reset_qpos)
    frame = CameraFrame(camera.name, 0, 0.0, measured, np.zeros((48, 64, 3), np.uint8))
    observation = eyes.observe(SensorSnapshot(0, q, 0.0 * q, 1.0, (frame,), {camera.name: q}))
    seen = observation.cameras[camera.name]
    depth = np.asarray(observation[f"depth_{camera.name}"])
    np.testing.assert_allclose(seen.metres(depth), camera.metres(measured), atol=6e-4)


@pytest.mark.parametrize(("width", "shift", "is_wrong"), [(6, 2, False), (60, 2, False), (60, 60, True)])
def test_only_a_large_shift_of_the_robot_is_a_moved_camera(width: int, shift: int, is_wrong: bool) -> None:
    """The robot appears as a stripe. A calibration error shifts the stripe by two pixels, which is a third of a narrow
    stripe; a moved camera shifts it out of its place.
    """
    expected, measured = np.full((240, 320), 2.0, np.float32), np.full((240, 320), 2.0, np.float32)
    expected[:, 100 : 100 + width] = measured[:, 100 + shift : 100 + shift + width] = 1.0
    ids = np.where(expected < 2.0, 1, 0).astype(np.int16)
    with pytest.raises(CameraPoseError) if is_wrong else contextlib.nullcontext():
        require_robot(CAMERAS[0], measured, expected, ids)
