"""Calibrate cameras from images of several arm poses (``gensim2 robot calibrate``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.seeding import rng
from gensim2.perception import Camera
from gensim2.robots import RobotProfile, robot
from gensim2.rollout.inputs import read_task_input
from gensim2.scenes.config import SceneArguments
from gensim2_robot.arm import LimitedArm
from gensim2_robot.arm_limits import SPEED, ArmLimits
from gensim2_robot.calibration.board import Board, find_corners, hand_eye
from gensim2_robot.calibration.file import Calibration, CameraCalibration
from gensim2_robot.calibration.mesh import MAX_VIEWS, calibrate
from gensim2_robot.calibration.poses import Station, draw_poses, read_standing, take
from gensim2_robot.calibration.surfaces import RobotSurface
from gensim2_robot.clocks import SimulatedClock
from gensim2_robot.log_reader import about_of


def displaced(camera: Camera, degrees: float, metres: float, draw: np.random.Generator) -> Camera:
    """Return a camera that is rotated by ``degrees`` and shifted by ``metres``.

    The axis and the direction are random.
    """
    axis, way = draw.normal(size=(2, 3))
    T = camera.T_base_camera.copy()
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    T[:3, :3] = turn @ T[:3, :3]
    T[:3, 3] += metres * way / np.linalg.norm(way)
    return replace(camera, T_base_camera=T)


def pose_error(T: npt.NDArray[np.float64], true: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return the distance (mm) and the angle (degrees) between two poses (4, 4)."""
    error = np.linalg.inv(true) @ T
    return 1e3 * float(np.linalg.norm(error[:3, 3])), float(np.rad2deg(Rotation.from_matrix(error[:3, :3]).magnitude()))


HELD_OUT = 4
"""Period of held-out poses: every ``HELD_OUT``-th pose is used for validation."""


def calibrate_simulated(
    task: str,
    out: Path,
    *,
    poses: int = 8,
    degrees: float = 15.0,
    metres: float = 0.1,
    pixels: tuple[int, int] = (320, 240),
    speed: float = SPEED,
    seed: int = 0,
    progress: Progress = NULL_PROGRESS,
    **scene: Unpack[SceneArguments],
) -> dict[str, Any]:
    """Move a simulated arm through poses and calibrate the fixed simulated cameras.

    Args:
        task: task whose objects are in the scene.
        out: calibration file, which is written only if the calibration of every camera converges.
        degrees, metres: rotation error and position error of the initial guesses.
        pixels: width and height of the images.
        speed: fraction of the arm's maximum speed.
        seed: seed of the scene, the poses, the noise and the guess.

    Returns:
        Plain data, as described in docs/guides/robot.md.

    Raises:
        InputError: an argument is invalid.
        MissingExtraError: a package is not installed.
    """
    from gensim2_robot.local import LocalArm, LocalCameras
    from gensim2_robot.simulated import SimulatedCameras, SimulatedWorld, simulated_cameras

    given = read_task_input(task, seed=seed, **scene)
    profile = robot(given.scene.robot)
    limits = ArmLimits.of(profile, speed=speed)
    cameras = tuple(camera for camera in simulated_cameras(profile, *pixels) if camera.link is None)
    world, clock = SimulatedWorld(given.scene), SimulatedClock()
    driver = LocalArm(world, clock)
    try:
        driver.reset(seed)
        seen = LocalCameras(world, SimulatedCameras(profile, cameras, seed), clock)
        standing = take(LimitedArm(driver, limits), seen, clock, draw_poses(limits, poses, seed), progress)
    finally:
        driver.close()
    draw = rng(seed, "first guess of cameras")
    guesses = [displaced(camera, degrees, metres, draw) for camera in cameras]
    true = {camera.name: camera.T_base_camera for camera in cameras}
    return _calibrate(profile, guesses, seen.serials, standing, out, seed, true)


def calibrate_log(
    log: Path, out: Path, *, board: Board | None = None, carried: bool = False, seed: int = 0
) -> dict[str, Any]:
    """Calibrate the cameras of a log, using the poses at which the logged arm was at rest.

    Args:
        log: folder of the log, whose camera poses are the initial guesses.
        out: calibration file, which is written only if the calibration of every camera converges.
        board: board in the images; None: use the robot's meshes.
        carried: True if the cameras are on the arm and the board is fixed; False if the board is on the arm. Used only
            with a board.
        seed: seed of random selections.

    Raises:
        InputError: the log is missing, or has too few poses.
        MissingExtraError: a package is not installed.
    """
    about, standing = about_of(log), read_standing(log)
    profile = robot(about.robot)
    cameras = [each.camera() for each in about.cameras]
    chosen = [camera for camera in cameras if (camera.link is not None) == carried]
    if not chosen:
        raise InputError(
            "the log has no suitable camera (--carried needs a camera on the arm, other "
            "calibrations need a fixed camera)",
            file=log,
            field="cameras",
        )
    serials = {name: frames[0].serial for name, frames in standing[0].frames.items()}
    if board is not None:
        return _by_board(profile, chosen, serials, standing, out, board, carried)
    return _calibrate(profile, chosen, serials, standing, out, seed, {})


def _parted(standing: Sequence[Station]) -> tuple[list[Station], list[Station]]:
    """Divide the stations into two lists, for the fit and for validation. A station has the images of one arm pose."""
    held = list(standing[HELD_OUT - 1 :: HELD_OUT])
    return [each for each in standing if all(each is not other for other in held)], held


def _calibrate(
    profile: RobotProfile,
    guesses: Sequence[Camera],
    serials: Mapping[str, str],
    standing: Sequence[Station],
    out: Path,
    seed: int,
    true: dict[str, np.ndarray],
) -> dict[str, Any]:
    surface = RobotSurface(profile)
    fitted, held = _parted(standing)
    cameras: dict[str, CameraCalibration] = {}
    report: dict[str, Any] = {}
    for guess in guesses:
        # The fit estimates the depth correction, so it needs the uncorrected depth.
        bare = replace(guess, depth_scale=1.0, depth_bias=0.0)
        parts = [[each.view(bare) for each in part] for part in (fitted[:MAX_VIEWS], held)]
        found = calibrate(surface, bare, *parts, seed=seed)
        report[guess.name] = {
            "trouble": found.trouble,
            "residual_mm": _rounded(found.residual_mm),
            "held_out_mm": _rounded(found.held_out_mm),
            "links_mm": {name: _rounded(value) for name, value in found.links_mm.items()},
            "scale": found.scale,
            "bias_mm": 1e3 * found.bias,
        }
        if guess.name in true:
            millimetres, turned = pose_error(found.camera.T_base_camera, true[guess.name])
            report[guess.name].update(error_mm=millimetres, error_deg=turned)
        if found.trouble is None:
            cameras[guess.name] = CameraCalibration(
                serial=serials[guess.name],
                method="mesh",
                link=None,
                pose=found.camera.T_base_camera.tolist(),
                width=guess.width,
                height=guess.height,
                intrinsic=guess.intrinsic.tolist(),
                scale=found.scale,
                bias=found.bias,
                residual_mm=found.residual_mm,
                held_out_mm=found.held_out_mm,
                links_mm=found.links_mm,
            )
    return _written(profile, cameras, report, len(standing), out)


def _by_board(
    profile: RobotProfile,
    chosen: Sequence[Camera],
    serials: Mapping[str, str],
    standing: Sequence[Station],
    out: Path,
    board: Board,
    carried: bool,
) -> dict[str, Any]:
    cameras: dict[str, CameraCalibration] = {}
    report: dict[str, Any] = {}
    for camera in chosen:
        link = camera.link or profile.hand_link
        views = []
        for each in standing:
            pose = profile.model.forward_kinematics(each.q, link)
            corners = find_corners(each.frames[camera.name][0].colors, board, pose)
            views += [] if corners is None else [corners]
        held = views[HELD_OUT - 1 :: HELD_OUT]
        fitted = [each for number, each in enumerate(views) if number % HELD_OUT != HELD_OUT - 1]
        try:
            found = hand_eye(camera, fitted, held, carried=carried)
        except InputError as error:
            report[camera.name] = {"trouble": f"the board is seen in {len(views)} pictures: {error}"}
            continue
        report[camera.name] = {
            "trouble": None,
            "residual_px": found.residual_px,
            "held_out_px": found.held_out_px,
            "residual_mm": found.residual_mm,
            "held_out_mm": found.held_out_mm,
        }
        cameras[camera.name] = CameraCalibration(
            serial=serials[camera.name],
            method="board",
            link=camera.link,
            pose=found.camera.tolist(),
            width=camera.width,
            height=camera.height,
            intrinsic=camera.intrinsic.tolist(),
            residual_mm=found.residual_mm,
            held_out_mm=found.held_out_mm,
        )
    return _written(profile, cameras, report, len(standing), out)


def _written(
    profile: RobotProfile, cameras: dict[str, CameraCalibration], report: dict[str, Any], poses: int, out: Path
) -> dict[str, Any]:
    """Write the calibration file if the calibrations of all cameras have converged, and return the command's result.

    Args:
        cameras: calibrations that have converged, by camera name.
        report: report on every camera, by camera name.
        poses: number of arm poses that were used.
        out: calibration file to write.

    Returns:
        JSON data with the robot, the date, the number of poses, the report, whether all fits converged, and the file.
    """
    whole = len(cameras) == len(report)
    made = datetime.now(UTC)
    if whole:
        Calibration(made=made, robot=profile.name, cameras=cameras).write(out)
    return {
        "schema_version": 1,
        "robot": profile.name,
        "made": made.isoformat(),
        "poses": poses,
        "converged": whole,
        "cameras": report,
        "file": str(out) if whole else None,
    }


def _rounded(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
