"""Pose of a camera from its depth pictures of the robot itself, without a board.

What the robot's links cover in some pictures and not in others is the robot, whatever stands about: no masks are
needed. A coarse registration (nearest points, point to plane) brings these points onto the surfaces that the ray caster
says are visible; a fine one compares each pixel's depth with that of the mesh along the same ray, with scale and bias
of the depth beside the pose. Pictures that were held out judge the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.perception import Camera
from gensim2_robot.calibration.coarse import LEAST_MOVED, Coarse, moved_pixels
from gensim2_robot.calibration.fine import NEAR, compare, refine
from gensim2_robot.calibration.fitted import Array, Pose, placed_at
from gensim2_robot.calibration.surfaces import ArmView, RobotSurface, check_views

LEAST_VIEWS, MAX_VIEWS = 3, 9
"""Pictures that are fitted to."""
OFF_SIGMAS = 2.0
"""Expected errors that the median of the held-out pictures may be off."""
SEEN_SHARE = 0.7
"""Of the pixels on the robot in held-out pictures that must lie near it."""
POSE_SIGMA = 0.003, np.deg2rad(0.3)
"""Standard deviation (m, rad) of the fitted pose from which on the pictures do not tell it."""


@dataclass(frozen=True, eq=False)
class MeshCalibration:
    """A camera's pose and depth, and what vouches for them.

    Attributes:
        camera: with its pose in the base frame.
        scale, bias: true depth is ``scale`` times the measured one, plus ``bias`` (m).
        residual_mm, held_out_mm: median distance of measured points from the meshes, in the pictures fitted to and in
            those held out.
        links_mm: the same by link, of all pictures.
        seen: share of the held-out pixels on the robot that lie near it.
        sigma_mm, sigma_deg: standard deviation of the pose that the fit itself states.
        trouble: why it is not to be used; None: it has converged.
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
    surface: RobotSurface,
    camera: Camera,
    views: Sequence[ArmView],
    held_out: Sequence[ArmView],
    *,
    seed: int = 0,
) -> MeshCalibration:
    """Find a camera's pose in the base frame, and scale and bias of its depth.

    Args:
        surface: of the robot.
        camera: whose pose is a first guess, some 15 degrees and 10 cm off at most.
        views: 3 to 9, of arm poses far apart; what does not move between them must stand still.
        held_out: 1 or more, of other arm poses, that judge.
        seed: of what is drawn: which pixels are compared.

    Raises:
        InputError: there are too few or too many pictures, of other sizes, or the camera hangs on a link.
    """
    if camera.link is not None:
        raise InputError(f"is carried by {camera.link}", field=camera.name, remedy="calibrate it by a board")
    if not LEAST_VIEWS <= len(views) <= MAX_VIEWS or not held_out:
        raise InputError(
            f"takes {LEAST_VIEWS} to {MAX_VIEWS} and one held out, there are {len(views)} and {len(held_out)}",
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
