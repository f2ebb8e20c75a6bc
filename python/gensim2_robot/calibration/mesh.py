"""Calibrate cameras from images of the robot.

A coarse search comes first, then a fine fit, and then a validation on held-out images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_opening
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.perception import Camera
from gensim2_robot.calibration.surfaces import ArmView, RobotSurface, RobotView, check_views, shrunk

FOCAL_BASELINE, DISPARITY_SIGMA = 21.25, 0.08
"""Expected depth error of a stereo pair, z^2 sigma / (f B): sigma (px), and f B (px m)."""


@dataclass
class Pose:
    """Fitted pose of a camera, and scale and bias of its depth."""

    T: Array
    scale: float = 1.0
    bias: float = 0.0

    def moved(self, step: Array, center: Array) -> Pose:
        """Return the pose changed by ``step`` (8,).

        A step has a rotation about ``center`` (rad), a translation (m), a depth scale and a depth bias.
        """
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        T = self.T.copy()
        T[:3, :3] = turn @ T[:3, :3]
        T[:3, 3] = turn @ (T[:3, 3] - center) + center + step[3:6]
        return Pose(T, self.scale + step[6], self.bias + step[7])


def expected_error(depth: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return depth**2 * (DISPARITY_SIGMA / FOCAL_BASELINE)


def placed_at(camera: Camera, pose: Pose) -> Camera:
    return replace(camera, T_base_camera=pose.T)


def tukey(residual: Array, scale: float) -> Array:
    """Return the weights of Tukey's biweight, which are 0 for residuals larger than 4.685 times ``scale``."""
    share = np.clip(residual / (4.685 * scale), -1.0, 1.0)
    return np.asarray((1.0 - share**2) ** 2)


COARSE_PIXELS = 96
"""Width to which images are reduced for the coarse registration, pixels."""
COARSE_POINTS = 400
"""Number of measured points of each image in the coarse registration."""
FARTHEST = 3.0
"""Maximum distance of the robot from a camera, m."""
APART = 0.04
"""Minimum distance (m) between a pixel's point and the background behind it at which the pixel counts as moved."""
LEAST_MOVED = 50
"""Minimum number of moved pixels in an image for the coarse registration."""
TURN, MAX_STARTS = 0.2, 4
"""Angle (rad) by which the guess is rotated for additional start poses, and maximum number of such start poses."""
REACHES = (0.4, 0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.035, 0.025, 0.02)
"""Maximum distance (m) between matched points in each successive round of the coarse registration."""


def moved_pixels(depths: Sequence[npt.NDArray[np.float32]]) -> list[npt.NDArray[np.bool_]]:
    """Return, for each image, a mask (H, W) of the pixels in front of the background, without isolated pixels.

    The background of a pixel is its largest depth in all images. If there are more than three images, it is the second
    largest depth.
    """
    ordered = np.sort(depths, axis=0)
    behind = ordered[-2] if len(depths) > 3 else ordered[-1]  # ignore the largest depth, which may be an outlier
    before = APART + 5.0 * expected_error(behind)
    return [
        binary_opening((depth > 0) & (depth < behind - before) & (depth < FARTHEST), np.ones((3, 3)))
        for depth in depths
    ]


class Coarse:
    """Coarse registration of a camera by matching nearest points (ICP)."""

    def __init__(
        self,
        surface: RobotSurface,
        camera: Camera,
        views: Sequence[ArmView],
        moved: Sequence[npt.NDArray[np.bool_]],
        draw: np.random.Generator,
    ) -> None:
        used = [number for number, mask in enumerate(moved) if mask.sum() >= LEAST_MOVED]
        self._surface, self._views = surface, [views[number] for number in used]
        self._small = shrunk(camera, max(1, round(camera.width / COARSE_PIXELS)))
        self._guess = Pose(camera.T_base_camera)
        rays = replace(camera, T_base_camera=np.eye(4)).rays.reshape(-1, 3).astype(np.float64)
        self._points = []
        for view, mask in ((views[number], moved[number]) for number in used):
            pixels = np.flatnonzero(mask)
            pixels = draw.choice(pixels, min(COARSE_POINTS, len(pixels)), replace=False)
            self._points.append(view.depth.reshape(-1)[pixels, None] * rays[pixels])
        depth = float(np.median(np.concatenate(self._points)[:, 2]))
        self._expected = 0.6 * depth / self._small.intrinsic[0, 0] + float(expected_error(np.array(depth)))

    def best(self) -> Pose:
        """Register from several start poses. Return the pose at which the points are closest to the surfaces."""
        found: list[tuple[float, Pose]] = []
        for start in self.start_poses():
            pose = self.register(start)
            found.append((self.cost(pose), pose))
            if found[-1][0] < self._expected:
                break
        return min(found, key=lambda each: each[0])[1]

    def start_poses(self) -> list[Pose]:
        """Return the start poses for matching, which are the initial guess and changed copies of it.

        Each copy is rotated by ``TURN`` about an axis, or not rotated, and shifted so that the means of points and
        meshes match. The copies with the lowest cost are returned.
        """
        turned = []
        for rotvec in np.concatenate([np.zeros((1, 3)), TURN * np.eye(3), -TURN * np.eye(3)]):
            T = self._guess.T.copy()
            T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec(rotvec).as_matrix()
            turned.append(self._to_middles(self._to_middles(Pose(T))))
        return [self._guess, *sorted(turned, key=self.cost)[:MAX_STARTS]]

    def _to_middles(self, pose: Pose) -> Pose:
        """Return the pose shifted so that the mean of the measured points equals the mean of the mesh points."""
        shifts = [
            surface.mean(axis=0) - (points @ pose.T[:3, :3].T + pose.T[:3, 3]).mean(axis=0)
            for points, (surface, _) in zip(self._points, self._model(pose), strict=True)
            if len(surface) > 20
        ]
        if not shifts:
            return pose
        T = pose.T.copy()
        T[:3, 3] += np.median(shifts, axis=0)
        return Pose(T)

    def register(self, start: Pose) -> Pose:
        """Return the camera pose at which points and surfaces are closest. The search begins at ``start``."""
        pose = start
        for reach in REACHES:
            model = self._model(pose)
            for _ in range(3):
                step = self._step(pose, model, reach)
                if step is None:
                    break
                pose = pose.moved(*step)
        return pose

    def cost(self, pose: Pose) -> float:
        """Return the mean distance (m) of the points from the surfaces; each distance counts as at most 5 cm."""
        found = []
        for points, (model, _) in zip(self._points, self._model(pose), strict=True):
            placed = points @ pose.T[:3, :3].T + pose.T[:3, 3]
            found.append(cKDTree(model).query(placed)[0].clip(max=0.05).mean() if len(model) else 0.05)
        return float(np.mean(found))

    def _model(self, pose: Pose) -> list[tuple[Array, Array]]:
        """Render the robot in each view; return points and normals (k, 3) before the largest rendered depth."""
        camera = placed_at(self._small, pose)
        seen = [self._surface.see(camera, view.q) for view in self._views]
        behind = np.max([each.depth for each in seen], axis=0)
        found = []
        for each in seen:
            mask = np.isfinite(each.depth) & (each.depth < behind - APART)
            points = camera.position + each.depth[mask][:, None] * camera.rays[mask]
            found.append((points.astype(np.float64), each.normals[mask].astype(np.float64)))
        return found

    def _step(self, pose: Pose, model: list[tuple[Array, Array]], reach: float) -> tuple[Array, Array] | None:
        placed, normals, off = [], [], []
        for points, (surface, across) in zip(self._points, model, strict=True):
            if not len(surface):
                continue
            here = points @ pose.T[:3, :3].T + pose.T[:3, 3]
            distance, nearest = cKDTree(surface).query(here, distance_upper_bound=reach)
            close = np.isfinite(distance)
            placed.append(here[close])
            normals.append(across[nearest[close]])
            off.append(((here[close] - surface[nearest[close]]) * normals[-1]).sum(axis=1))
        if sum(map(len, off)) < 30:
            return None
        p, n, r = np.concatenate(placed), np.concatenate(normals), np.concatenate(off)
        center = p.mean(axis=0)
        rows = np.column_stack([np.cross(p - center, n), n])
        weights = tukey(r, max(0.3 * reach, 0.004))
        square = rows.T @ (weights[:, None] * rows)
        damping = 1e-3 * np.trace(square) / 6.0
        step = np.linalg.solve(square + damping * np.eye(6), -rows.T @ (weights * r))
        return np.append(step, [0.0, 0.0]), center


FINE_PIXELS = 6000
"""Number of pixels of each image in the fine registration."""
SCALE_SIGMA, BIAS_SIGMA = 0.01, 0.005
"""Prior standard deviations of a depth camera's scale and bias (m)."""
PIXEL = 0.5
"""Standard deviation (pixels) of the offset of a ray from its pixel's centre."""
NEAR = 0.03
"""Maximum distance (m) between a measured point and the robot's surface at which they count as near."""


@dataclass(frozen=True, eq=False)
class Compared:
    """Comparison of one image with the robot's meshes, at k pixels that show the robot's surface.

    Attributes:
        points: (k, 3) measured points in the base frame, m.
        rays: (k, 3) rays from the camera, scaled to unit depth.
        normals: (k, 3) surface normals.
        off: (k,) errors along the normals, m.
        sigma: (k,) expected standard deviations of the errors, m.
        measured: (k,) measured depth, m.
        links: (k,) indices of the links.
        covered: number of pixels with measured depth on the robot's meshes. Edges and grazing angles are left out.
        near: number of the ``covered`` pixels whose measured point is near the robot's surface.
    """

    points: Array
    rays: Array
    normals: Array
    off: Array
    sigma: Array
    measured: Array
    links: npt.NDArray[np.int16]
    covered: int
    near: int


def compare(surface: RobotSurface, camera: Camera, view: ArmView, pose: Pose, reach: float) -> Compared:
    """Compare depths with the robot's meshes along the rays. Edges and grazing angles are left out."""
    placed = placed_at(camera, pose)
    seen = surface.see(placed, view.q)
    depth = np.where(view.depth > 0, pose.scale * view.depth + pose.bias, 0.0)
    facing = -(seen.normals * placed.rays).sum(axis=2) / np.linalg.norm(placed.rays, axis=2)
    usable = _inside(seen) & (view.depth > 0) & (facing > 0.3)
    with np.errstate(invalid="ignore"):  # Pixels without a surface have infinite depth, and inf - inf is invalid.
        difference = depth - seen.depth
    close = usable & (np.abs(difference) < reach)
    rays, normals = placed.rays[close].astype(np.float64), seen.normals[close].astype(np.float64)
    z = depth[close].astype(np.float64)
    along = (rays * normals).sum(axis=1)
    sigma_z = expected_error(z)
    sideways = PIXEL * z / camera.intrinsic[0, 0] * np.sqrt((1.0 - facing[close] ** 2).clip(0.0))
    return Compared(
        placed.T_base_camera[:3, 3] + z[:, None] * rays,
        rays,
        normals,
        difference[close] * along,
        np.sqrt((sigma_z * along) ** 2 + sideways**2 + 1e-4**2),
        view.depth[close].astype(np.float64),
        seen.links[close],
        int(usable.sum()),
        int((usable & (np.abs(difference) < NEAR)).sum()),
    )


def _inside(seen: RobotView) -> npt.NDArray[np.bool_]:
    """Return a mask of the pixels of the robot that are more than two pixels away from any edge of its surface."""
    there = np.isfinite(seen.depth)
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            for by in (1, 2):
                near = np.abs(seen.depth - np.roll(seen.depth, by, axis)) < 0.02 * by
                near &= np.abs(seen.depth - np.roll(seen.depth, -by, axis)) < 0.02 * by
                there &= near
    there[:2], there[-2:], there[:, :2], there[:, -2:] = False, False, False, False
    return there


def refine(
    surface: RobotSurface, camera: Camera, views: Sequence[ArmView], pose: Pose, draw: np.random.Generator
) -> tuple[Pose, Array]:
    """Refine a camera's pose and depth correction by comparing individual pixels with the robot's meshes.

    Args:
        surface: surfaces of the robot's links.
        camera: camera to calibrate.
        views: images of the camera, with the arm's joints.
        pose: pose and depth correction to start from.
        draw: random generator that selects pixels.

    Returns:
        The pose, and standard deviations (8,) of the rotation (3), the translation (3), the depth scale and the depth
        bias.
    """
    sigma = np.full(8, np.inf)
    for reach in (0.05, 0.04, 0.03, 0.03, 0.02, 0.02, 0.02):
        rows, points, off, spread = [], [], [], []
        for view in views:
            each = compare(surface, camera, view, pose, reach)
            some = draw.choice(len(each.off), min(FINE_PIXELS, len(each.off)), replace=False)
            rows.append(
                np.column_stack(
                    [
                        np.cross(each.points[some], each.normals[some]),
                        each.normals[some],
                        (each.rays[some] * each.normals[some]).sum(axis=1)[:, None] * each.measured[some, None],
                        (each.rays[some] * each.normals[some]).sum(axis=1),
                    ]
                )
            )
            points.append(each.points[some])
            off.append(each.off[some])
            spread.append(each.sigma[some])
        J, r, s = np.concatenate(rows), np.concatenate(off), np.concatenate(spread)
        if len(r) < 100:
            break
        middle = np.concatenate(points).mean(axis=0)
        J[:, :3] -= np.cross(middle, J[:, 3:6])
        scale = max(1.0, 1.4826 * float(np.median(np.abs(r / s))))
        weights = tukey(r / s, scale) / s**2
        square = J.T @ (weights[:, None] * J)
        # The errors of neighbouring pixels are correlated. Therefore priors keep the scale near 1 and the bias near 0.
        square[6, 6] += 1.0 / SCALE_SIGMA**2
        square[7, 7] += 1.0 / BIAS_SIGMA**2
        pull = J.T @ (weights * r)
        pull[6] += (pose.scale - 1.0) / SCALE_SIGMA**2
        pull[7] += pose.bias / BIAS_SIGMA**2
        inverse = np.linalg.pinv(square)
        step = -inverse @ pull
        sigma = scale * np.sqrt(np.diag(inverse))
        pose = pose.moved(step, middle)
    return pose, sigma


LEAST_VIEWS, MAX_VIEWS = 3, 9
"""Smallest and largest number of images for the fit."""
OFF_SIGMAS = 2.0
"""Maximum median error in held-out images, divided by the expected error."""
SEEN_SHARE = 0.7
"""Minimum fraction of the robot's pixels in held-out images whose measured points are near the robot's surface."""
POSE_SIGMA = 0.003, np.deg2rad(0.3)
"""Maximum standard deviation (m, rad) of the fitted pose; above it the images do not determine the pose."""


@dataclass(frozen=True, eq=False)
class MeshCalibration:
    """Pose and depth calibration of a camera, with measures of the quality.

    Attributes:
        camera: camera with its pose in the base frame.
        scale, bias: true depth = ``scale`` * measured depth + ``bias`` (m).
        residual_mm, held_out_mm: median distance of the points from the meshes, in the images of the fit and in
            held-out images.
        links_mm: median distance on each link, in all images.
        seen: fraction of the robot's pixels in held-out images whose measured points are near the robot's surface.
        sigma_mm, sigma_deg: standard deviation of the pose, as estimated by the fit.
        trouble: reason why the calibration must not be used; None if the fit has converged.
    """

    camera: Camera
    scale: float
    bias: float
    residual_mm: float
    held_out_mm: float
    links_mm: dict[str, float] = field(default_factory=dict)
    seen: float = 0.0
    sigma_mm: float = float("inf")
    sigma_deg: float = float("inf")
    trouble: str | None = None


def calibrate(
    surface: RobotSurface, camera: Camera, views: Sequence[ArmView], held_out: Sequence[ArmView], *, seed: int = 0
) -> MeshCalibration:
    """Find a camera's pose in the base frame, and scale and bias of its depth.

    Args:
        camera: camera with an initial guess of its pose, which may be wrong by about 15 degrees and 10 cm.
        views: 3 to 9 images of different arm poses. Only the arm may move between the images.
        held_out: 1 or more images of other arm poses, for validation.
        seed: seed of the random selection of pixels.

    Raises:
        InputError: there are too few or too many images, an image has a wrong size, or a link carries the camera.
    """
    if camera.link is not None:
        wrong = f"this calibration needs a camera at a fixed place, but the camera is on the robot's link {camera.link}"
        raise InputError(wrong, field=camera.name, remedy="calibrate the camera with a board")
    if not LEAST_VIEWS <= len(views) <= MAX_VIEWS or not held_out:
        raise InputError(
            f"the calibration needs {LEAST_VIEWS} to {MAX_VIEWS} images for the fit and at least one for validation, "
            f"but got {len(views)} for the fit and {len(held_out)} for validation",
            field="views",
        )
    check_views(camera, [*views, *held_out])
    draw = rng(seed, f"calibration/{camera.name}")
    moved = moved_pixels([view.depth for view in views])
    if sum(int(mask.sum()) >= LEAST_MOVED for mask in moved) < LEAST_VIEWS:
        return MeshCalibration(
            camera, 1.0, 0.0, np.inf, np.inf, trouble="the robot does not move before the camera: other arm poses"
        )
    found = Coarse(surface, camera, views, moved, draw).best()
    pose, sigma = refine(surface, camera, views, found, draw)
    return _judged(surface, camera, views, held_out, pose, sigma)


def _judged(
    surface: RobotSurface,
    camera: Camera,
    views: Sequence[ArmView],
    held_out: Sequence[ArmView],
    pose: Pose,
    sigma: Array,
) -> MeshCalibration:
    fitted = [compare(surface, camera, view, pose, NEAR) for view in views]
    others = [compare(surface, camera, view, pose, NEAR) for view in held_out]
    off = [np.concatenate([np.abs(each.off) for each in part]) for part in (fitted, others)]
    residual, held = (1e3 * float(np.median(each)) if len(each) else np.inf for each in off)
    every = np.concatenate([np.abs(each.off) for each in (*fitted, *others)])
    whose = np.concatenate([each.links for each in (*fitted, *others)])
    links = {surface.names[link]: 1e3 * float(np.median(every[whose == link])) for link in np.unique(whose)}
    covered = sum(each.covered for each in others)
    seen = sum(each.near for each in others) / max(covered, 1)
    expected = np.concatenate([np.abs(each.off) / each.sigma for each in others])
    sigma_mm, sigma_deg = 1e3 * float(sigma[3:6].max()), float(np.rad2deg(sigma[:3].max()))
    trouble = None
    if covered < 200 or not len(expected):
        trouble = "the held-out pictures show too little of the robot"
    elif seen < SEEN_SHARE:
        trouble = f"only {seen:.0%} of the robot is where the meshes are in the held-out pictures"
    elif float(np.median(expected)) > OFF_SIGMAS:
        trouble = f"the held-out pictures lie {held:.1f} mm off the meshes, {np.median(expected):.1f} times what is due"
    elif sigma_mm > 1e3 * POSE_SIGMA[0] or sigma_deg > np.rad2deg(POSE_SIGMA[1]):
        trouble = f"the arm poses do not tell the pose: {sigma_mm:.1f} mm, {sigma_deg:.2f} degrees; take others"
    return MeshCalibration(
        placed_at(camera, pose), pose.scale, pose.bias, residual, held, links, seen, sigma_mm, sigma_deg, trouble
    )
