"""Real devices by the words of the command line. None of them was ever tried on hardware (docs/guides/robot.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gensim2.core.errors import InputError, near
from gensim2.perception import Camera
from gensim2.robots import RobotProfile
from gensim2_robot.cameras import ProcessCameras
from gensim2_robot.config import CameraSource
from gensim2_robot.drivers.streamed import StreamedArm

if TYPE_CHECKING:
    from gensim2_robot.drivers.logged import LoggedCameras
    from gensim2_robot.drivers.realsense import RealSenseCameras


def open_arm(word: str, profile: RobotProfile) -> StreamedArm:
    """Connect to an arm.

    Args:
        word: ``franka:HOST``, ``panda:HOST``, ``ur:HOST`` or ``xarm:HOST``, as a
            :class:`~gensim2_robot.config.LineConfig` has it.
        profile: of the robot.

    Raises:
        MissingExtraError: the maker's library is not installed.
        DriverError: the arm cannot be connected to.
    """
    kind, _, host = word.partition(":")
    if kind == "franka":
        from gensim2_robot.drivers.franka import FrankaArm

        return FrankaArm(host, profile)
    if kind == "panda":
        from gensim2_robot.drivers.panda_py import PandaPyArm

        return PandaPyArm(host, profile)
    if kind == "ur":
        from gensim2_robot.drivers.ur import URArm

        return URArm(host, profile)
    from gensim2_robot.drivers.xarm import XArm

    return XArm(host, profile)


def open_cameras(
    source: CameraSource, there: Sequence[Camera], rate: float, interrupted: Sequence[int] = ()
) -> ProcessCameras:
    """Open RealSense cameras, or recordings, in a process of their own.

    Args:
        source: with their devices or files.
        there: cameras by their names, with pixels and a first guess of their poses.
        rate: pictures a second; recordings give what they have.
        interrupted: numbers of signals that have asked to stop; once there is one, opening ends.

    Raises:
        InputError: a name is none of theirs, a file is no recording, or only some of them are logs of the line.
        MissingExtraError: the maker's library is not installed.
        DriverError: a device is not there.
    """
    known = {camera.name: camera for camera in there}
    for name in source.devices:
        if name not in known:
            raise InputError(f"there is no camera {name!r}", field="--cameras", remedy=near(name, known))
    named = tuple(known[name] for name in source.devices)
    if source.kind == "recording":
        from gensim2_robot.drivers.logged import is_log

        logs = [is_log(Path(file)) for file in source.devices.values()]
        if any(logs) and not all(logs):
            said = "some are logs of the line, some recordings of a RealSense"
            raise InputError(said, field="--cameras", remedy="all of one kind, played by one clock")
        if all(logs):
            return ProcessCameras(logged_cameras, source, named, interrupted=interrupted)
    return ProcessCameras(realsense_cameras, source, named, round(rate), interrupted=interrupted)


def realsense_cameras(source: CameraSource, cameras: Sequence[Camera], rate: int) -> RealSenseCameras:
    """Open RealSense cameras, or recordings of them, in this process; see :func:`open_cameras`."""
    from gensim2_robot.drivers.realsense import RealSenseCameras, connected, recorded

    if source.kind == "recording":
        devices = recorded({name: Path(file) for name, file in source.devices.items()})
    else:
        devices = connected(source.devices)
    return RealSenseCameras(cameras, devices, rate)


def logged_cameras(source: CameraSource, cameras: Sequence[Camera]) -> LoggedCameras:
    """Open logs of the line in this process; see :func:`open_cameras`."""
    from gensim2_robot.drivers.logged import LoggedCameras

    return LoggedCameras(cameras, {name: Path(file) for name, file in source.devices.items()})


class ByHand:
    """A table that a person sets and judges: nothing is known of the goal, nor whether the scene is at rest."""

    is_ready = True
    goal: bool | None = None
    at_rest: bool | None = None

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """A person has laid everything out."""
