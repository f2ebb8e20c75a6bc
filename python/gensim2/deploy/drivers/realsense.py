"""RealSense cameras, or a recording of one, by ``pyrealsense2`` (extra ``realsense``). Never tried on a camera."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.deploy.devices import Frame
from gensim2.deploy.drivers.streamed import DriverError
from gensim2.errors import InputError, MissingExtraError
from gensim2.observations import Camera

MILLIMETRE = 1e-3


class RealSenseCameras:
    """Cameras by their serial numbers; colours are brought onto the depth picture.

    Args:
        cameras: that there are: names, pixels and poses; intrinsics are asked of the devices.
        serials: number of the device of each, by name.
        rate: pictures a second.
        recording: a ``.bag`` or ``.db3`` in place of a device, of one camera; played as fast as it is read.

    Attributes:
        cameras: with the intrinsics of the devices; our pixel centres lie at .5, the library's at 0.

    Raises:
        MissingExtraError: ``pyrealsense2`` is not installed.
        InputError: a camera has no serial number, or a recording is of more than one.
        DriverError: a device is not there, or its depth is distorted.
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        serials: Mapping[str, str],
        rate: int = 30,
        recording: Path | None = None,
    ) -> None:
        try:
            import pyrealsense2 as rs
        except ImportError as error:
            raise MissingExtraError("pyrealsense2", "realsense") from error
        if recording is not None and len(cameras) != 1:
            raise InputError("is of one camera", file=recording, field="cameras")
        self._rs: Any = rs
        self.serials = dict(serials)
        self._pipelines: dict[str, Any] = {}
        self._align = rs.align(rs.stream.depth)
        # The library's clock is the system's, where its devices' global time is on; ours is the monotonic one.
        self._offset = time.monotonic() - time.time()
        found = []
        for camera in cameras:
            if camera.name not in serials:
                raise InputError("has no serial number", field=camera.name)
            found.append(self._open(camera, serials[camera.name], rate, recording))
        self.cameras = tuple(found)

    def poll(self) -> Sequence[Frame]:
        """Pictures that came since the last call, oldest first."""
        found = []
        for name, pipeline in self._pipelines.items():
            frames = pipeline.poll_for_frames()
            while frames:
                found.append(self._frame(name, self._align.process(frames)))
                frames = pipeline.poll_for_frames()
        return sorted(found, key=lambda frame: frame.captured)

    def close(self) -> None:
        """Leave the devices."""
        for pipeline in self._pipelines.values():
            pipeline.stop()

    def _open(self, camera: Camera, serial: str, rate: int, recording: Path | None) -> Camera:
        rs = self._rs
        pipeline, config = rs.pipeline(), rs.config()
        if recording is not None:
            config.enable_device_from_file(str(recording), repeat_playback=False)
        else:
            config.enable_device(serial)
            config.enable_stream(rs.stream.depth, camera.width, camera.height, rs.format.z16, rate)
            config.enable_stream(rs.stream.color, camera.width, camera.height, rs.format.rgb8, rate)
        try:
            profile = pipeline.start(config)
        except RuntimeError as error:
            raise DriverError(f"camera {camera.name}, {serial}: {error}") from error
        device = profile.get_device()
        if recording is not None:
            device.as_playback().set_real_time(False)
        self.serials[camera.name] = device.get_info(rs.camera_info.serial_number)
        unit = device.first_depth_sensor().get_depth_scale()
        if abs(unit - MILLIMETRE) > 1e-6:
            raise DriverError(f"camera {camera.name}: depth comes in units of {unit} m, must be {MILLIMETRE}")
        seen = profile.get_stream(rs.stream.depth).as_video_stream_profile().get_intrinsics()
        if any(seen.coeffs):
            raise DriverError(f"camera {camera.name}: its depth is distorted: {list(seen.coeffs)}")
        self._pipelines[camera.name] = pipeline
        intrinsic = np.array([[seen.fx, 0.0, seen.ppx + 0.5], [0.0, seen.fy, seen.ppy + 0.5], [0.0, 0.0, 1.0]])
        return replace(camera, width=seen.width, height=seen.height, intrinsic=intrinsic)

    def _frame(self, name: str, frames: Any) -> Frame:
        depth, color = frames.get_depth_frame(), frames.get_color_frame()
        return Frame(
            name,
            int(depth.get_frame_number()),
            1e-3 * float(depth.get_timestamp()) + self._offset,
            np.array(depth.get_data(), dtype=np.uint16),
            np.array(color.get_data(), dtype=np.uint8),
            self.serials[name],
        )
