"""Fine registration: each pixel's depth against that of the mesh along its ray."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gensim2.perception import Camera
from gensim2_robot.calibration.fitted import Array, Pose, expected_error, placed_at, tukey
from gensim2_robot.calibration.surfaces import ArmView, RobotSurface, Seen

FINE_PIXELS = 6000
"""Of each picture in the fine one."""
SCALE_SIGMA, BIAS_SIGMA = 0.01, 0.005
"""Prior standard deviations of a depth camera's scale (share) and bias (m)."""
PIXEL = 0.5
"""Pixels by which a ray may be off its pixel's centre."""
NEAR = 0.03
"""Metres that are near."""


@dataclass(frozen=True, eq=False)
class Compared:
    """Pixels of one picture on the robot's surface.

    Attributes:
        points: (k, 3) measured, in the base frame; rays: (k, 3) from the camera there, a metre deep each.
        normals: (k, 3); off: (k,) m along them; sigma: (k,) expected of it.
        measured: (k,) depth as it was measured, m.
        links: (k,).
        covered, near: pixels of the robot that were measured at all, and of them near it.
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
    """Each pixel's depth against that of the mesh along its ray, away from edges and not at a grazing angle."""
    placed = placed_at(camera, pose)
    seen = surface.see(placed, view.q)
    depth = np.where(view.depth > 0, pose.scale * view.depth + pose.bias, 0.0)
    facing = -(seen.normals * placed.rays).sum(axis=2) / np.linalg.norm(placed.rays, axis=2)
    usable = _inside(seen) & (view.depth > 0) & (facing > 0.3)
    with np.errstate(invalid="ignore"):  # infinity less infinity, where there is nothing
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


def _inside(seen: Seen) -> npt.NDArray[np.bool_]:
    """Pixels of the robot with the same surface on all sides, two pixels around."""
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
    """Pixel by pixel; the pose, and the (8,) standard deviations of its steps."""
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
        # Errors of neighbouring pixels are alike: what is known beforehand counts as in a picture of fewer pixels.
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
