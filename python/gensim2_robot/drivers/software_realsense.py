"""Software devices of ``pyrealsense2``: pictures go through the maker's library as those of a camera do."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.perception import Camera
from gensim2_robot.devices import Frame
from gensim2_robot.drivers.realsense import MILLIMETRE, RealSenseCameras, library

LOOK = 5e-4
"""Seconds between two looks for a picture that is on its way through the library."""


class SoftwareDevice:
    """A device that is given its pictures.

    Args:
        camera: pixels and intrinsics; our pixel centres lie at .5, the library's at 0.
        serial: its number.
        rate: pictures a second.

    Attributes:
        device: the library's, to be opened.
        domain: whose clock its times are of.

    Raises:
        MissingExtraError: ``pyrealsense2`` is not installed.
    """

    def __init__(self, camera: Camera, serial: str, rate: int) -> None:
        rs = self._rs = library()
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.serial_number, serial)
        self.device.register_info(rs.camera_info.name, "gensim2")
        self.domain = rs.timestamp_domain.system_time
        self._clock = time.time() - time.monotonic()
        self._profiles: list[tuple[Any, Any, int]] = []
        for number, (title, kind, form, size) in enumerate(
            (("Stereo Module", rs.stream.depth, rs.format.z16, 2), ("RGB Camera", rs.stream.color, rs.format.rgb8, 3))
        ):
            sensor = self.device.add_sensor(title)
            if kind == rs.stream.depth:
                sensor.add_read_only_option(rs.option.depth_units, MILLIMETRE)
            stream = rs.video_stream()
            stream.type, stream.index, stream.uid, stream.fmt = kind, 0, number, form
            stream.width, stream.height, stream.fps, stream.bpp = camera.width, camera.height, rate, size
            stream.intrinsics = self._intrinsics(camera)
            self._profiles.append((sensor, sensor.add_video_stream(stream).as_video_stream_profile(), size))
        same = rs.extrinsics()
        same.rotation, same.translation = np.eye(3).ravel().tolist(), [0.0, 0.0, 0.0]
        depth, colors = (profile for _, profile, _ in self._profiles)
        depth.register_extrinsics_to(colors, same)
        colors.register_extrinsics_to(depth, same)
        self.device.create_matcher(rs.matchers.dlr_c)  # a pair has the same number

    def recorder(self, file: Path) -> Any:
        """The device as one whose pictures are written into a file (``.db3``) while it is open."""
        return self._rs.recorder(str(file), self.device, True)

    def give(self, frame: Frame) -> None:
        """Give the library a picture; what is opened on the device gets it."""
        rs = self._rs
        for (sensor, profile, size), pixels in zip(self._profiles, (frame.depth, frame.colors), strict=True):
            picture = rs.software_video_frame()
            picture.stride, picture.bpp = frame.depth.shape[1] * size, size
            picture.timestamp = (frame.captured + self._clock) / MILLIMETRE
            picture.domain = self.domain
            picture.frame_number, picture.profile = frame.number, profile
            if size == 2:
                picture.depth_units = MILLIMETRE
            picture.pixels = np.ascontiguousarray(pixels)
            sensor.on_video_frame(picture)

    def _intrinsics(self, camera: Camera) -> Any:
        found = self._rs.intrinsics()
        found.width, found.height = camera.width, camera.height
        found.fx, found.fy = camera.intrinsic[0, 0], camera.intrinsic[1, 1]
        found.ppx, found.ppy = camera.intrinsic[0, 2] - 0.5, camera.intrinsic[1, 2] - 0.5
        found.model, found.coeffs = self._rs.distortion.none, [0.0] * 5
        return found


class SoftwareCameras:
    """Cameras whose pictures are given, and taken again from the maker's library.

    Args:
        cameras: that there are.
        serials: of their devices, by name.
        rate: pictures a second.

    Raises:
        MissingExtraError: ``pyrealsense2`` is not installed.
    """

    def __init__(self, cameras: Sequence[Camera], serials: Mapping[str, str], rate: int) -> None:
        self._devices = {camera.name: SoftwareDevice(camera, serials[camera.name], rate) for camera in cameras}
        self._driver = RealSenseCameras(cameras, {name: each.device for name, each in self._devices.items()}, rate)
        self.cameras, self.serials = self._driver.cameras, self._driver.serials

    def passed(self, frames: Sequence[Frame], within: float) -> list[Frame]:
        """Give pictures to the devices and take what comes of them.

        Args:
            frames: to give.
            within: s to wait for as many; what comes later comes with the next.
        """
        for frame in frames:
            self._devices[frame.camera].give(frame)
        end, found = time.monotonic() + within, list(self._driver.poll())
        while len(found) < len(frames) and time.monotonic() < end:
            time.sleep(LOOK)
            found += self._driver.poll()
        return found

    def close(self) -> None:
        """Leave the devices."""
        self._driver.close()
