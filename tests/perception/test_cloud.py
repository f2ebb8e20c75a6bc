"""Point clouds of hand-made images: where points are, which are kept, and how many."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gensim2.core.errors import InputError
from gensim2.perception import Camera, CloudSettings, DepthNoise, EmptyCloudError, Picture, RobotSegments, point_cloud
from gensim2.perception.cloud import farthest_points, from_steps, inlier_mask, to_steps, uniform_stride

GRIPPER, ARM, THING = 1, 2, 3
ROBOT = RobotSegments(gripper=frozenset({GRIPPER}), arm=frozenset({ARM}))
Points = npt.NDArray[np.float32]


def camera(name: str = "above", eye: tuple[float, float, float] = (0.6, 0.05, 1.0)) -> Camera:
    return Camera.looking(name, eye, (0.6, 0.0, 0.1), width=64, height=48, fov=1.0)


def plane_at(height: float, seen: Camera) -> npt.NDArray[np.float32]:
    """Return the depth image of a level plane."""
    depth = (height - seen.position[2]) / seen.rays[:, :, 2]
    return np.where(depth > 0, depth, 0.0).astype(np.float32)


def test_a_camera_projects_where_its_rays_look() -> None:
    seen = camera()
    assert seen.rays.shape == (48, 64, 3)
    points = seen.position + 0.7 * seen.rays.reshape(-1, 3)
    pixels = np.column_stack([points, np.ones(len(points))]) @ seen.projection.T
    assert np.allclose(pixels[:, 2], 0.7, atol=1e-6)  # depth is along the optical axis
    columns, rows = (pixels[:, :2] / pixels[:, 2:]).T
    assert np.allclose(columns.reshape(48, 64), np.arange(64) + 0.5, atol=1e-3)
    assert np.allclose(rows.reshape(48, 64).T, np.arange(48) + 0.5, atol=1e-3)
    middle = seen.T_base_camera[:3, 2]
    assert np.allclose(np.array([0.6, 0.0, 0.1]) - seen.position, np.linalg.norm([0, 0.05, 0.9]) * middle, atol=1e-6)
    assert seen.T_base_camera[2, 1] < 0, "down in the picture is down"


def test_clouds_of_several_cameras_lie_in_the_base_frame() -> None:
    views = [Picture(seen, plane_at(0.2, seen)) for seen in (camera(), camera("beside", (0.9, 0.3, 0.8)))]
    cloud = point_cloud(views, CloudSettings(points=500, candidates=2000))
    assert cloud.xyz.shape == (500, 3)
    assert cloud.segmentation is None
    assert np.abs(cloud.xyz[:, 2] - 0.2).max() < 1e-4
    assert np.ptp(cloud.xyz[:, 0]) > 0.4
    again = point_cloud(views, CloudSettings(points=500, candidates=2000))
    assert cloud.xyz.tobytes() == again.xyz.tobytes()
    assert np.array_equal(from_steps(to_steps(cloud.xyz)), cloud.xyz), "a stored cloud is the seen one"


@pytest.mark.parametrize(
    ("robot", "kept"), [("gripper", {GRIPPER, THING}), ("all", {GRIPPER, ARM, THING}), ("none", {THING})]
)
def test_the_workspace_and_the_gripper_are_kept(robot: str, kept: set[int]) -> None:
    seen = camera()
    ids = np.full((48, 64), THING, dtype=np.int16)
    ids[:, :20], ids[:, 20:40] = GRIPPER, ARM
    colors = np.repeat(ids[:, :, None], 3, axis=2).astype(np.uint8)
    view = Picture(seen, plane_at(0.2, seen), ids, colors)
    settings = CloudSettings(points=300, candidates=0, low=(0.3, -0.1, 0.0), high=(0.9, 0.1, 0.5), robot=robot)  # type: ignore[arg-type]
    cloud = point_cloud([view], settings, ROBOT)
    assert cloud.segmentation is not None
    assert set(cloud.segmentation.tolist()) == kept
    assert np.array_equal(cloud.rgb[:, 0], cloud.segmentation), "colours and ids stay with their points"
    assert (cloud.xyz >= [0.2999, -0.1001, 0]).all()
    assert (cloud.xyz <= [0.9001, 0.1001, 0.5]).all()


def test_nothing_in_the_workspace_is_said() -> None:
    seen = camera()
    with pytest.raises(EmptyCloudError, match="workspace"):
        point_cloud([Picture(seen, np.zeros((48, 64), dtype=np.float32))], CloudSettings())


def test_too_few_points_are_repeated() -> None:
    seen = camera()
    depth = np.zeros((48, 64), dtype=np.float32)
    depth[24, 30:33] = 0.8
    cloud = point_cloud([Picture(seen, depth)], CloudSettings(points=7, candidates=10))
    assert cloud.xyz.shape == (7, 3)
    assert len(np.unique(cloud.xyz, axis=0)) == 3


@pytest.mark.parametrize(("count", "wanted"), [(5, 8), (8, 8), (100, 7), (12345, 4096)])
def test_even_samples_are_even(count: int, wanted: int) -> None:
    chosen = uniform_stride(count, wanted)
    assert len(chosen) == min(count, wanted)
    gaps = np.diff(chosen)
    assert gaps.min() >= 1
    assert gaps.max() - gaps.min() <= 1
    assert chosen[0] >= 0
    assert chosen[-1] < count


@pytest.mark.parametrize("count", [40, 300, 2500])
def test_farthest_points_cover_as_well_as_they_keep_apart(count: int) -> None:
    """A farthest point sampling: no point is farther from the set than the set's points are from each other."""
    wanted = 32
    points: Points = np.random.default_rng(count).uniform(-1, 1, (count, 3)).astype(np.float32)
    chosen = farthest_points(points, wanted)
    assert len(set(chosen.tolist())) == wanted
    between = np.linalg.norm(points[chosen][:, None] - points[chosen], axis=2)
    apart = np.where(between > 0, between, np.inf).min()
    covered = np.linalg.norm(points[:, None] - points[chosen], axis=2).min(axis=1).max()
    assert covered <= apart + 1e-6
    assert np.array_equal(chosen, farthest_points(points, wanted))


def test_points_that_stand_alone_are_dropped() -> None:
    points = np.random.default_rng(0).normal(0, 0.05, (400, 3)).astype(np.float32)
    points[:3] += 1.0 + np.arange(3, dtype=np.float32)[:, None]
    kept = inlier_mask(points, neighbors=16, deviations=2.0)
    assert not kept[:3].any()
    assert kept[3:].mean() > 0.97


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"points": 0}, "points"),
        ({"points": 2.5}, "points"),
        ({"candidates": 10}, "candidates"),
        ({"robot": "arm"}, "robot"),
        ({"low": [1.0, 0.0, 0.0], "high": [0.5, 1.0, 1.0]}, "low"),
        ({"high": [9.0, 1.0, 1.0]}, "from -3.2 to 3.2"),
        ({"outliers": 0.0}, "outliers"),
        ({"colour": True}, "colour"),
        ({"noise": {"lost": -0.1}}, "noise.lost"),
        ({"noise": {"snow": 1.0}}, "snow"),
    ],
)
def test_settings_that_cannot_be_are_refused(values: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        CloudSettings.of(values)


def test_settings_come_back_from_json() -> None:
    settings = CloudSettings(points=256, noise=DepthNoise(lost=0.1), outliers=2.0)
    assert CloudSettings.of(settings.to_dict()) == settings
