"""Read RealSense cameras and their recordings with ``pyrealsense2`` (extra ``realsense``); not tested on a camera.

Sensors are opened one by one. ``syncer`` combines depth and colours. Recordings and software devices work in the same
way.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.core.errors import InputError, required
from gensim2.perception import Camera
from gensim2_robot.devices import CameraFrame
from gensim2_robot.drivers.streamed import DriverError

MILLIMETRE = 1e-3
QUEUE = 4
"""Maximum number of image pairs that wait in the library; the oldest pairs are dropped."""
OF_A_BAG = "pyrealsense2.context().convert_bag_to_db3(BAG, DB3) makes a .db3 of a .bag that is whole"
"""Remedy for a recording in the old, deprecated format that the library cannot play."""


def library() -> Any:
    """Import ``pyrealsense2``.

    Raises:
        MissingExtraError: ``pyrealsense2`` is not installed.
    """
    return required("pyrealsense2", "realsense", "gensim2-robot")


def connected(serials: Mapping[str, str]) -> dict[str, Any]:
    """Find the connected devices with the given serial numbers; return them by camera name.

    Args:
        serials: serial number by camera name.

    Raises:
        DriverError: a device is not connected.
        MissingExtraError: ``pyrealsense2`` is not installed.
    """
    rs = library()
    there = {device.get_info(rs.camera_info.serial_number): device for device in rs.context().query_devices()}
    for name, serial in serials.items():
        if serial not in there:
            known = ", ".join(sorted(there)) or "none"
            raise DriverError(f"camera {name}: the device {serial} is not connected; connected devices: {known}")
    return {name: there[serial] for name, serial in serials.items()}


def recorded(files: Mapping[str, Path]) -> dict[str, Any]:
    """Open recordings (``.db3``, or ``.bag`` of older libraries) as devices; return them by camera name.

    Args:
        files: file of the recording by camera name.

    Raises:
        InputError: a file does not exist, or the library cannot read it.
        MissingExtraError: ``pyrealsense2`` is not installed.
    """
    context = library().context()
    found = {}
    for name, file in files.items():
        if not file.is_file():
            raise InputError("the recording does not exist", file=file, field=f"cameras.{name}")
        try:
            found[name] = context.load_device(str(file))
        except RuntimeError as error:
            said = f"is no recording of a RealSense: {error}"
            remedy = OF_A_BAG if file.suffix == ".bag" else None
            raise InputError(said, file=file, field=f"cameras.{name}", remedy=remedy) from error
    return found


class RealSenseCameras:
    """Cameras that read RealSense devices. Colour images are aligned with the depth images.

    A recording plays in a loop at its own rate. Its time stamps lie in the past and are shifted to the present. The
    shift is that of the image with the smallest delay, which counts as captured on arrival.

    Args:
        cameras: names, image sizes and poses of the cameras; the intrinsics are read from the devices.
        devices: device by camera name, from :func:`connected` or :func:`recorded`.
        rate: frame rate, Hz; None: the highest rate that a device offers for both depth and colour.

    Attributes:
        cameras: cameras with the intrinsics of the devices, which are converted from pixel centres at integers to pixel
            centres at half integers.
        serials: serial number that each device reported, by camera name.

    Raises:
        MissingExtraError: ``pyrealsense2`` is not installed.
        InputError: a camera has no device.
        DriverError: a device does not offer images of this size and rate, or its depth images are distorted.
    """

    def __init__(self, cameras: Sequence[Camera], devices: Mapping[str, Any], rate: int | None = None) -> None:
        rs = library()
        self.serials: dict[str, str] = {}
        self._films: list[_Film] = []
        found = []
        with contextlib.ExitStack() as failed:
            for camera in cameras:
                if camera.name not in devices:
                    raise InputError("has no device", field=camera.name)
                film = _Film(rs, camera, devices[camera.name], rate)
                failed.callback(film.close)
                self._films.append(film)
                self.serials[camera.name] = film.serial
                found.append(film.camera)
            failed.pop_all()
        self.cameras = tuple(found)

    def poll(self) -> Sequence[CameraFrame]:
        """Return the images received since the last call, oldest first.

        Raises:
            DriverError: a device does not use the machine's clock.
        """
        return sorted((frame for film in self._films for frame in film.poll()), key=lambda frame: frame.captured)

    def close(self) -> None:
        for film in self._films:
            film.close()


class _Film:
    """Reads depth and colour images of one device, and combines images of the same time."""

    def __init__(self, rs: Any, camera: Camera, device: Any, rate: int | None) -> None:
        self._rs, self._device = rs, device
        self._playback: Any = device.as_playback() if device.is_playback() else None
        self.serial: str = device.get_info(rs.camera_info.serial_number)
        unit = rs.option.depth_units  # Depth sensors have this option, even in recordings.
        units = [sensor.get_option(unit) for sensor in device.query_sensors() if sensor.supports(unit)]
        if not units or abs(units[0] - MILLIMETRE) > 1e-6:
            raise DriverError(f"camera {camera.name}: the depth unit is {units} m, but must be {MILLIMETRE} m")
        self._wanted = (camera.width, camera.height, rate)
        seen = self._choose(camera.name)[rs.stream.depth].get_intrinsics()
        if any(seen.coeffs):
            raise DriverError(f"camera {camera.name}: the depth images have lens distortion: {list(seen.coeffs)}")
        intrinsic = np.array([[seen.fx, 0.0, seen.ppx + 0.5], [0.0, seen.fy, seen.ppy + 0.5], [0.0, 0.0, 1.0]])
        self.camera = replace(camera, width=seen.width, height=seen.height, intrinsic=intrinsic)
        self._align = rs.align(rs.stream.depth)
        self._count = 0
        self._start()

    def poll(self) -> list[CameraFrame]:
        """Return the received images, with colours aligned to the depth image."""
        found = []
        pair = self._syncer.poll_for_frames()
        while pair:
            depth = pair.get_depth_frame()
            if depth and pair.get_color_frame():
                found.append(self._frame(depth, self._align.process(pair)))
            pair = self._syncer.poll_for_frames()
        if self._playback and self._offset is not None and self._is_over():
            self._stop()
            self._start()
        return found

    def close(self) -> None:
        self._stop()

    def _choose(self, name: str) -> dict[Any, Any]:
        """Select depth and colour streams of the requested size and rate; a recording has only one size and rate."""
        rs = self._rs
        kinds = {rs.stream.depth: rs.format.z16, rs.stream.color: rs.format.rgb8}
        self._sensors: list[tuple[Any, list[Any]]] = []
        found: dict[Any, Any] = {}
        sizes = set()
        wanted = self._wanted if self._wanted[2] is not None else (*self._wanted[:2], self._highest_rate(kinds))
        for sensor in self._device.query_sensors():
            opened = []
            for profile, kind, video in _streams(sensor, kinds):
                if kind in found:
                    continue
                has = (video.width(), video.height(), profile.fps())
                sizes.add(has)
                if self._playback or has == wanted:
                    found[kind] = video
                    opened.append(profile)
            if opened:
                if not self._playback and sensor.supports(rs.option.global_time_enabled):
                    sensor.set_option(rs.option.global_time_enabled, 1)
                self._sensors.append((sensor, opened))
        if len(found) < len(kinds):
            width, height, rate = self._wanted
            known = ", ".join(f"{one}x{other} at {each} Hz" for one, other, each in sorted(sizes)) or "none"
            at = "one rate" if rate is None else f"{rate} Hz"
            said = f"the device has no depth and colours of {width}x{height} at {at}; it has: {known}"
            raise DriverError(f"camera {name} (serial number {self.serial}): {said}")
        return found

    def _highest_rate(self, kinds: Mapping[Any, Any]) -> int | None:
        """Return the highest rate (Hz) that all kinds of streams have at the requested size, or None if there is
        none.
        """
        rates: dict[Any, set[int]] = {kind: set() for kind in kinds}
        for sensor in self._device.query_sensors():
            for profile, kind, video in _streams(sensor, kinds):
                if (video.width(), video.height()) == self._wanted[:2]:
                    rates[kind].add(profile.fps())
        return max(set.intersection(*rates.values()), default=None)

    def _start(self) -> None:
        self._syncer = self._rs.syncer(QUEUE)
        # The offset converts time stamps to the monotonic clock. Devices report system times. The times of recordings
        # lie in the past, so the offset is estimated. Each image gives an estimate that is too large by its delay, and
        # the smallest estimate of several images is used. Several are needed, because the first images are late on a
        # busy machine.
        self._offset: float | None = None if self._playback else time.monotonic() - time.time()
        with contextlib.ExitStack() as failed:
            for sensor, profiles in self._sensors:
                sensor.open(profiles)
                failed.callback(sensor.close)
                sensor.start(self._syncer)
                failed.callback(sensor.stop)
            failed.pop_all()

    def _stop(self) -> None:
        for sensor, _ in self._sensors:
            sensor.stop()
            sensor.close()

    def _is_over(self) -> bool:
        return bool(self._playback.current_status() == self._rs.playback_status.stopped)

    def _frame(self, depth: Any, aligned: Any) -> CameraFrame:
        taken = MILLIMETRE * float(depth.get_timestamp())
        if self._playback:
            now = time.monotonic() - taken
            self._offset = now if self._offset is None else min(self._offset, now)
        assert self._offset is not None, "that of a device is known from the start"
        if not self._playback and depth.get_frame_timestamp_domain() == self._rs.timestamp_domain.hardware_clock:
            said = "the image times come from the device's own clock; switch on the device's global time"
            raise DriverError(f"camera {self.camera.name} (serial number {self.serial}): {said}")
        self._count += 1
        return CameraFrame(
            self.camera.name,
            self._count - 1 if self._playback else int(depth.get_frame_number()),
            taken + self._offset,
            np.array(depth.get_data(), dtype=np.uint16),
            np.array(aligned.get_color_frame().get_data(), dtype=np.uint8),
            self.serial,
        )


def _streams(sensor: Any, kinds: Mapping[Any, Any]) -> Iterator[tuple[Any, Any, Any]]:
    """Yield profile, kind and video profile of each stream of a sensor that has a wanted format.

    Args:
        sensor: sensor of a RealSense device.
        kinds: wanted format for each kind of stream (depth or colour).
    """
    for profile in sensor.get_stream_profiles():
        kind = profile.stream_type()
        if profile.format() == kinds.get(kind):
            yield profile, kind, profile.as_video_stream_profile()


LOOK = 5e-4
"""Time between two checks whether the library has returned an image, s."""


class SoftwareDevice:
    """A software device of the RealSense library, which delivers the images that it is given.

    Args:
        camera: camera with image size and intrinsics, which are converted from pixel centres at half integers to pixel
            centres at integers.
        serial: serial number.
        rate: frame rate, Hz.

    Attributes:
        device: device object of the library.
        domain: clock domain of the image times.

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
        self.device.create_matcher(rs.matchers.dlr_c)  # this matcher combines images with the same frame number

    def recorder(self, file: Path) -> Any:
        """Return a recorder that writes this device's images to a ``.db3`` file until the recorder is deleted."""
        return self._rs.recorder(str(file), self.device, True)

    def give(self, frame: CameraFrame) -> None:
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
    """Simulated cameras whose images are passed through the RealSense library.

    Args:
        cameras: simulated cameras.
        serials: serial number by camera name.
        rate: frame rate, Hz.

    Raises:
        MissingExtraError: ``pyrealsense2`` is not installed.
    """

    def __init__(self, cameras: Sequence[Camera], serials: Mapping[str, str], rate: int) -> None:
        self._devices = {camera.name: SoftwareDevice(camera, serials[camera.name], rate) for camera in cameras}
        self._driver = RealSenseCameras(cameras, {name: each.device for name, each in self._devices.items()}, rate)
        self.cameras, self.serials = self._driver.cameras, self._driver.serials

    def passed(self, frames: Sequence[CameraFrame], within: float) -> list[CameraFrame]:
        """Pass images to the devices, and return the images that the devices deliver.

        Args:
            frames: images to pass.
            within: maximum time (s) to wait for as many images as were passed in. The next call returns later images.
        """
        for frame in frames:
            self._devices[frame.camera].give(frame)
        end, found = time.monotonic() + within, list(self._driver.poll())
        while len(found) < len(frames) and time.monotonic() < end:
            time.sleep(LOOK)
            found += self._driver.poll()
        return found

    def close(self) -> None:
        self._driver.close()
