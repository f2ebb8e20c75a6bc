"""Write and read calibration files, which ``gensim2 robot calibrate`` writes and ``gensim2 robot run`` reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic
from gensim2.core.record_files import read_record
from gensim2.perception import Camera

DAYS = 7.0
"""Default maximum age of a calibration, days."""
REMEDY = "make it anew with gensim2 robot calibrate"

_Finite = Annotated[float, Field(allow_inf_nan=False)]


class CameraCalibration(BaseModel):
    """Calibration of one camera.

    Attributes:
        serial: serial number of the device; empty if unknown.
        method: ``"mesh"`` for a calibration with the robot's meshes, ``"board"`` for a calibration with a board.
        link: link that carries the camera; None for a camera fixed in the base frame.
        pose: (4, 4) pose of the camera in the frame of the link or in the base frame, m.
        width, height, intrinsic: size (pixels) and intrinsic matrix of the images.
        scale, bias: correction of the depth: true depth = ``scale`` * measured depth + ``bias`` (m).
        residual_mm: median error (mm) in the images that were used for the fit.
        held_out_mm: median error (mm) in the images that were kept out of the fit for validation.
        links_mm: median error (mm) on each link of the robot.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    serial: str
    method: Literal["mesh", "board"]
    link: str | None
    pose: list[list[_Finite]]
    width: int
    height: int
    intrinsic: list[list[_Finite]]
    scale: Annotated[float, Field(gt=0.5, lt=2.0)] = 1.0
    bias: Annotated[float, Field(gt=-0.5, lt=0.5)] = 0.0
    residual_mm: Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
    held_out_mm: Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
    links_mm: dict[str, _Finite] = {}

    @model_validator(mode="after")
    def _is_a_camera(self) -> CameraCalibration:
        try:
            Camera("calibrated", self.width, self.height, np.array(self.intrinsic), np.array(self.pose))
        except InputError as error:
            raise ValueError(str(error)) from error
        return self


class Calibration(BaseModel):
    """Calibration of all cameras of a robot.

    Attributes:
        made: date and time of the calibration, with time zone.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    schema_version: Literal[1] = 1
    made: datetime
    robot: str
    cameras: dict[str, CameraCalibration]

    @model_validator(mode="after")
    def _is_dated(self) -> Calibration:
        if self.made.tzinfo is None:
            raise ValueError("the time 'made' must have a time zone")
        # Times near the years 1 and 9999, the ends of datetime's range, cannot be converted to every time zone.
        if not 2000 <= self.made.year < 9999:
            raise ValueError("the time 'made' must lie between the years 2000 and 9998")
        return self

    def write(self, path: Path) -> None:
        """Write the calibration atomically.

        Raises:
            WriteError: the file cannot be written.
        """
        write_atomic(path, self.model_dump_json(indent=2) + "\n")


def read_calibration(
    path: Path, robot: str, cameras: Sequence[Camera], *, days: float = DAYS, now: datetime | None = None
) -> Calibration:
    """Read a calibration and check that it fits the robot and the cameras and is recent.

    Args:
        days: maximum age of the calibration, days.
        now: current time; None: the machine's clock.

    Raises:
        InputError: the file cannot be read, belongs to another robot, or is too old or from the future; or a camera is
            missing, has a different image size, or is mounted elsewhere.
    """
    found = read_record(path, Calibration, REMEDY)
    if found.robot != robot:
        wrong = f"the calibration is for the robot {found.robot}, not for {robot}"
        raise InputError(wrong, file=path, field="robot", remedy=REMEDY)
    age = (now or datetime.now(UTC)) - found.made
    if age > timedelta(days=days):
        said = f"is stale: {age.total_seconds() / 86400:.1f} days old, {days:g} at most"
        raise InputError(said, file=path, field="made", remedy=REMEDY)
    if age < -timedelta(hours=1):
        wrong = "the time of the calibration is in the future"
        raise InputError(wrong, file=path, field="made", remedy="correct the clock of this machine")
    require_calibrated(found, cameras, path)
    return found


def require_calibrated(found: Calibration, cameras: Sequence[Camera], path: Path) -> None:
    """Check that cameras match a calibration.

    Args:
        found: calibration to check.
        path: file of the calibration, for error messages.

    Raises:
        InputError: a camera is missing, has a different image size or is mounted elsewhere.
    """
    for camera in cameras:
        field = f"cameras.{camera.name}"
        one = found.cameras.get(camera.name)
        if one is None:
            raise InputError("is not calibrated", file=path, field=field, remedy=REMEDY)
        if (one.width, one.height) != (camera.width, camera.height):
            said = f"was made with {one.width}x{one.height} pixels, the camera gives {camera.width}x{camera.height}"
            raise InputError(said, file=path, field=field, remedy=REMEDY)
        if one.link != camera.link:
            raise InputError(
                f"the camera was calibrated on {one.link or 'a fixed mount'}, but is now on "
                f"{camera.link or 'a fixed mount'}",
                file=path,
                field=field,
                remedy=REMEDY,
            )


def calibrated(cameras: Sequence[Camera], calibration: Calibration) -> tuple[Camera, ...]:
    """Return copies of the cameras with the poses, intrinsics and depth corrections of a calibration."""
    return tuple(
        replace(
            camera,
            T_base_camera=np.array(one.pose),
            intrinsic=np.array(one.intrinsic),
            depth_scale=one.scale,
            depth_bias=one.bias,
        )
        for camera in cameras
        if (one := calibration.cameras[camera.name])
    )


def serials(calibration: Calibration) -> Mapping[str, str]:
    """Return the known serial numbers of the calibrated devices."""
    return {name: one.serial for name, one in calibration.cameras.items() if one.serial}
