"""Fuse depth images into one point cloud of fixed size in the robot's base frame."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error, InputError, near
from gensim2.perception.camera import View
from gensim2.perception.noise import DepthNoise

Points = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]

_TREE_HEIGHT = 5
"""Height of fpsample's tree, which is fastest for 2,000 to 8,000 points; the result does not depend on it."""


def uniform_stride(count: int, wanted: int) -> Indices:
    """Return at most ``wanted`` indices below ``count``, evenly spaced."""
    if count <= wanted:
        return np.arange(count)
    middles = (np.arange(wanted) + 0.5) * (count / wanted)
    return np.asarray(np.floor(middles), dtype=np.int64)


def farthest_points(points: Points, wanted: int) -> Indices:
    """Sample points by farthest point sampling, and return their sorted indices (wanted,).

    If there are fewer points than ``wanted``, the points are repeated until there are enough.

    Args:
        points: (N, 3) finite points, N at least 1.
        wanted: number of points to sample.
    """
    if len(points) <= wanted:
        return np.sort(np.arange(wanted) % len(points))
    import fpsample

    height = min(_TREE_HEIGHT, int(np.log2(len(points))))  # The tree must not have more leaves than there are points.
    chosen = fpsample.bucket_fps_kdline_sampling(points, wanted, h=height, start_idx=0)
    return np.sort(chosen.astype(np.int64))


def inlier_mask(points: Points, neighbors: int, deviations: float) -> npt.NDArray[np.bool_]:
    """Return a mask (N,) of the points that are not outliers.

    For each point, the mean distance to its ``neighbors`` nearest points is computed. A point is an outlier if its mean
    distance exceeds the average of the mean distances of all points by more than ``deviations`` standard deviations.
    """
    from scipy.spatial import cKDTree

    if len(points) <= neighbors:
        return np.ones(len(points), dtype=bool)
    # + 1, because the nearest neighbour of a point is the point itself
    distances, _ = cKDTree(points).query(points, k=neighbors + 1)
    mean = distances[:, 1:].mean(axis=1)
    kept: npt.NDArray[np.bool_] = mean <= mean.mean() + deviations * mean.std()
    return kept


ROBOT_PARTS = ("gripper", "all", "none")
SOURCES = ("depth", "keypoints")
LOW, HIGH = (0.15, -0.62, 0.01), (1.15, 0.62, 1.0)
"""Corners of the workspace in front of a Panda, m in its base frame."""
MAX_POINTS = 49152

RESOLUTION = np.float32(1e-4)
"""Resolution of coordinates, m. With it, 16-bit integers can store coordinates up to 3.2 m exactly."""
FARTHEST = 3.2


class EmptyCloudError(GenSim2Error):
    """The point cloud is empty, because the cameras see no point in the workspace."""


@dataclass(frozen=True)
class RobotSegments:
    """Segmentation ids of the robot's links: the hand with its fingers, and all other links."""

    gripper: frozenset[int]
    arm: frozenset[int]


def candidates_for(points: int) -> int:
    """Return the default number of pixels from which ``points`` points of a cloud are sampled: four pixels for each
    point, but at least 4,096. If this number exceeds ``MAX_POINTS``, return 0, which selects all pixels.
    """
    wanted = max(4 * points, 4096)
    return wanted if wanted <= MAX_POINTS else 0


@dataclass(frozen=True)
class CloudSettings:
    """Settings of a point cloud; lengths are in m, and corners are in the base frame.

    Attributes:
        points: number of points.
        low, high: corners of the workspace to which the cloud is cropped. The default contains the objects on the table
            in front of a Panda, but not the table's surface.
        robot: part of the robot that the cloud contains: ``"gripper"``, ``"all"`` or ``"none"``. This needs images with
            segmentation ids.
        candidates: number of pixels that are sampled evenly from the images, before farthest point sampling selects the
            points; 0: all pixels.
        outliers: maximum distance of a point from its neighbours, in standard deviations above the average of all
            points. :func:`inlier_mask` drops points with a larger distance. None: no point is dropped.
        neighbors: number of nearest points whose mean distance :func:`inlier_mask` computes for each point.
        noise: noise of the depth images; None: exact images.
        source: origin of the points. With ``"depth"`` they come from depth images. With ``"keypoints"`` they are the
            true positions of keypoints and bounding box corners, in a fixed order
            (:mod:`gensim2.perception.raycast.observer`). Only a simulator knows these positions, so a policy that uses
            them serves as a baseline with privileged information. With ``"keypoints"``, all settings other than
            ``points`` have fixed values.
    """

    points: int = 1024
    low: tuple[float, float, float] = LOW
    high: tuple[float, float, float] = HIGH
    robot: Literal["gripper", "all", "none"] = "gripper"
    candidates: int = 4096
    outliers: float | None = None
    neighbors: int = 16
    noise: DepthNoise | None = field(default=None)
    source: Literal["depth", "keypoints"] = "depth"

    def __post_init__(self) -> None:
        if self.source not in SOURCES:
            raise InputError(f"must be one of {', '.join(SOURCES)}, got {reprlib.repr(self.source)}", field="source")
        if self.source != "depth":
            self._keep_points_alone()
        _check_count(self.points, "points", 1)
        _check_count(self.candidates, "candidates", 0)
        _check_count(self.neighbors, "neighbors", 1)
        if 0 < self.candidates < self.points:
            raise InputError(f"must be 0, or at least {self.points} (the value of 'points')", field="candidates")
        if self.robot not in ROBOT_PARTS:
            raise InputError(f"must be one of {', '.join(ROBOT_PARTS)}, got {reprlib.repr(self.robot)}", field="robot")
        low, high = (np.asarray(corner, dtype=np.float64) for corner in (self.low, self.high))
        if low.shape != (3,) or high.shape != (3,) or not (low < high).all():
            wrong = "must be three numbers each, and each number in low must be smaller than its counterpart in high"
            raise InputError(wrong, field="low, high")
        if max(np.abs(low).max(), np.abs(high).max()) > FARTHEST:
            raise InputError(f"must lie within {FARTHEST} m of the base", field="low, high")
        if self.outliers is not None and not self.outliers > 0:
            raise InputError("must be positive", field="outliers")

    def _keep_points_alone(self) -> None:
        """Replace the values of all settings that a cloud of keypoints does not use by fixed values, so that settings
        of equal clouds compare equal.
        """
        for name in ("noise", "outliers"):
            if getattr(self, name) is not None:
                message = "is of depth pictures, and the cloud is made of keypoints"
                raise InputError(message, field=name, remedy="leave it out")
        for name, value in {"low": LOW, "high": HIGH, "robot": "none", "candidates": 0, "neighbors": 16}.items():
            object.__setattr__(self, name, value)

    @staticmethod
    def of(values: Mapping[str, Any]) -> CloudSettings:
        """Return settings from plain data, as returned by :meth:`to_dict`.

        Raises:
            InputError: a setting is unknown or invalid.
        """
        given = dict(values)
        known = [each.name for each in fields(CloudSettings)]
        for name in given:
            if name not in known:
                raise InputError(f"there is no setting {name!r}", field="observation", remedy=near(name, known))
        for corner in ("low", "high"):
            if corner in given:
                given[corner] = _corner(given[corner], corner)
        if not (given.get("outliers") is None or _is_number(given["outliers"])):
            raise InputError(f"must be a number, got {reprlib.repr(given['outliers'])}", field="outliers")
        noise = given.get("noise")
        if not isinstance(noise, Mapping | DepthNoise | None):
            raise InputError(f"must be a mapping, got {reprlib.repr(noise)}", field="noise")
        if isinstance(noise, Mapping):
            try:
                given["noise"] = DepthNoise(**noise)
            except TypeError as error:
                raise InputError(str(error), field="observation: noise") from error
        return CloudSettings(**given)

    def to_dict(self) -> dict[str, Any]:
        """Return the settings as plain data. The field ``source`` is omitted for its default ``"depth"``, because files
        of earlier versions lack this field.
        """
        told = {**asdict(self), "low": list(self.low), "high": list(self.high)}
        if self.source == "depth":
            del told["source"]
        return told


@dataclass(frozen=True, eq=False)
class PointCloud:
    """A point cloud of N points.

    Attributes:
        xyz: (N, 3) positions in the robot's base frame, m, multiples of ``RESOLUTION``.
        rgb: (N, 3) colours, 0 to 255.
        segmentation: (N,) segmentation ids; None if unknown.
    """

    xyz: npt.NDArray[np.float32]
    rgb: npt.NDArray[np.uint8]
    segmentation: npt.NDArray[np.int16] | None


def point_cloud(views: Sequence[View], settings: CloudSettings, robot: RobotSegments | None = None) -> PointCloud:
    """Fuse several images into one point cloud.

    The function keeps the pixels in the workspace, samples them evenly, drops outliers, and selects the points by
    farthest point sampling. Equal inputs give equal clouds.

    Args:
        views: images taken at the same instant; their depth may contain noise.
        settings: settings of the cloud.
        robot: segmentation ids of the robot; None: the robot is not distinguished from objects.

    Raises:
        EmptyCloudError: no point is in the workspace.

    Example:
        ```python
        cloud = point_cloud(views, CloudSettings(points=1024))
        print(cloud.xyz.shape, cloud.rgb.shape)    # (1024, 3) (1024, 3)
        ```
    """
    kept = [_inside(view, settings, robot) for view in views]
    counts = np.cumsum([0, *(len(pixels) for pixels in kept)])
    if counts[-1] == 0:
        raise EmptyCloudError("the cameras see no point in the workspace")
    chosen = uniform_stride(int(counts[-1]), settings.candidates or int(counts[-1]))
    parts = [
        pixels[chosen[(chosen >= first) & (chosen < last)] - first]
        for pixels, first, last in zip(kept, counts[:-1], counts[1:], strict=True)
    ]
    points = np.concatenate([_points(view, part) for view, part in zip(views, parts, strict=True)])
    rows = np.arange(len(points))
    if settings.outliers is not None:
        rows = rows[inlier_mask(points, settings.neighbors, settings.outliers)]
    rows = rows[farthest_points(points[rows], settings.points)]
    return _gather(views, parts, points, rows)


def _inside(view: View, settings: CloudSettings, robot: RobotSegments | None) -> npt.NDArray[np.int64]:
    """Return the indices of an image's pixels that show a point in the workspace. Pixels that show a part of the robot
    are left out if ``settings.robot`` excludes this part.
    """
    depth, camera = view.depth, view.camera
    inside = depth > 0
    for axis in range(3):
        along = depth * camera.rays[:, :, axis] + camera.position[axis]
        inside &= (along > settings.low[axis]) & (along < settings.high[axis])
    segmentation = view.segmentation
    if robot is not None and segmentation is not None and settings.robot != "all":
        dropped = robot.arm if settings.robot == "gripper" else robot.arm | robot.gripper
        inside &= ~_is_one_of(segmentation, dropped)
    return np.flatnonzero(inside)


def _is_one_of(segmentation: npt.NDArray[np.int16], ids: frozenset[int]) -> npt.NDArray[np.bool_]:
    table = np.zeros(max(int(segmentation.max()), *ids, 0) + 1, dtype=bool)
    table[list(ids)] = True
    found: npt.NDArray[np.bool_] = table[segmentation]
    return found


def _points(view: View, pixels: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
    """Return the points (k, 3) of pixels, m in the base frame."""
    camera = view.camera
    found: npt.NDArray[np.float32] = (
        camera.position + view.depth.reshape(-1)[pixels, None] * camera.rays.reshape(-1, 3)[pixels]
    )
    return found


def _gather(
    views: Sequence[View],
    parts: Sequence[npt.NDArray[np.int64]],
    points: npt.NDArray[np.float32],
    rows: npt.NDArray[np.int64],
) -> PointCloud:
    """Select points by their ascending indices ``rows``, and return the selected points as a cloud with colours and
    segmentation ids. ``parts`` contains the pixel indices of each view; the points of all these pixels are concatenated
    in ``points``.
    """
    starts = np.cumsum([0, *(len(part) for part in parts)])
    colors, ids = [], []
    for view, part, first, last in zip(views, parts, starts[:-1], starts[1:], strict=True):
        pixels = part[rows[(rows >= first) & (rows < last)] - first]
        colors.append(view.colors_at(pixels))
        if view.segmentation is not None:
            ids.append(view.segmentation.reshape(-1)[pixels])
    segmentation = np.concatenate(ids) if len(ids) == len(views) else None
    return PointCloud(from_steps(to_steps(points[rows])), np.concatenate(colors), segmentation)


def to_steps(xyz: npt.NDArray[np.float32]) -> npt.NDArray[np.int16]:
    """Return coordinates (m) as integer multiples of ``RESOLUTION``."""
    return np.asarray(np.rint(xyz / RESOLUTION), dtype=np.int16)


def from_steps(steps: npt.NDArray[np.int16]) -> npt.NDArray[np.float32]:
    """Return coordinates in m; the exact inverse of :func:`to_steps`."""
    return steps * RESOLUTION


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _corner(values: Any, name: str) -> tuple[float, ...]:
    numbers = tuple(values) if isinstance(values, Sequence) and not isinstance(values, str) else ()
    if len(numbers) != 3 or not all(_is_number(each) and abs(each) <= FARTHEST for each in numbers):
        message = f"must be three numbers from -{FARTHEST} to {FARTHEST} (coordinates in the base frame, m)"
        raise InputError(message, field=name)
    return numbers


def _check_count(value: Any, name: str, least: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= MAX_POINTS:
        raise InputError(f"must be a whole number from {least} to {MAX_POINTS}, got {reprlib.repr(value)}", field=name)
