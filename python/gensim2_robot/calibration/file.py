"""Calibrations as a dated file: what ``gensim2 robot calibrate`` writes and ``gensim2 robot run`` reads."""

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
"""Age from which on a calibration is stale, where nothing else is said."""
REMEDY = "make it anew with gensim2 robot calibrate"

_Finite = Annotated[float, Field(allow_inf_nan=False)]


class CameraCalibration(BaseModel):
    """One camera.

    Attributes:
        serial: number of the device; empty: it says none.
        method: against the robot's meshes, or a board.
        link: that carries it; None: it stands in the base frame.
        pose: (4, 4) of the camera in that frame, m.
        width, height, intrinsic: of the pictures it was made with.
        scale, bias: true depth is ``scale`` times the measured one, plus ``bias`` (m).
        residual_mm, held_out_mm: median errors in the pictures fitted to and in those held out.
        links_mm: median error on each link of the robot.
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
    """All calibrated cameras of a robot.

    Attributes:
        made: when, with its time zone.
        robot: name of the robot.
        cameras: by name.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    schema_version: Literal[1] = 1
    made: datetime
    robot: str
    cameras: dict[str, CameraCalibration]

    @model_validator(mode="after")
    def _is_dated(self) -> Calibration:
        if self.made.tzinfo is None:
            raise ValueError("made says no time zone")
        if not 2000 <= self.made.year < 9999:  # others cannot be compared in every time zone
            raise ValueError("made is no date of a calibration")
        return self

    def write(self, path: Path) -> None:
        """Write it, whole or not at all.

        Raises:
            WriteError: it cannot be written.
        """
        write_atomic(path, self.model_dump_json(indent=2) + "\n")


def read_calibration(
    path: Path, robot: str, cameras: Sequence[Camera], *, days: float = DAYS, now: datetime | None = None
) -> Calibration:
    """A calibration that may be driven with.

    Args:
        robot: that is driven.
        cameras: that are looked through.
        days: of age from which on it is stale.
        now: the time; None: the machine's.

    Raises:
        InputError: it cannot be read, is of another robot, stale or of the future, or a camera is not in it, has other
            pixels or hangs elsewhere.
    """
    found = read_record(path, Calibration, REMEDY)
    if found.robot != robot:
        raise InputError(f"is of {found.robot}, not of {robot}", file=path, field="robot", remedy=REMEDY)
    age = (now or datetime.now(UTC)) - found.made
    if age > timedelta(days=days):
        said = f"is stale: {age.total_seconds() / 86400:.1f} days old, {days:g} at most"
        raise InputError(said, file=path, field="made", remedy=REMEDY)
    if age < -timedelta(hours=1):
        raise InputError("lies in the future", file=path, field="made", remedy="set the machine's clock")
    require_calibrated(found, cameras, path)
    return found


def require_calibrated(found: Calibration, cameras: Sequence[Camera], path: Path) -> None:
    """Refuse cameras that a calibration is not of.

    Args:
        found: the calibration.
        cameras: that are looked through.
        path: its file.

    Raises:
        InputError: a camera is not in it, has other pixels or hangs elsewhere.
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
            raise InputError(f"hangs on {one.link}, not on {camera.link}", file=path, field=field, remedy=REMEDY)


def calibrated(cameras: Sequence[Camera], calibration: Calibration) -> tuple[Camera, ...]:
    """Cameras where the calibration says that they are."""
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
    """Numbers of the devices that were calibrated, where they say any."""
    return {name: one.serial for name, one in calibration.cameras.items() if one.serial}
