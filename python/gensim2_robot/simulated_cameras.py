"""Simulated stereo cameras: rays, and the noise of a RealSense on them."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

import numpy as np

from gensim2.core.seeding import rng
from gensim2.perception import D435, Camera, CameraError, DepthNoise
from gensim2.perception.camera import pinhole
from gensim2.perception.cameras import FAR, observation_cameras
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.robots import RobotProfile, robot
from gensim2_robot.devices import Frame

if TYPE_CHECKING:
    from gensim2_robot.drivers.software_realsense import SoftwareCameras
    from gensim2_robot.simulated_world import Rows

RATE = 10.0
"""Pictures a second of each camera."""
LATE = 0.3
"""Seconds by which the pictures of a camera come late that is told to."""
JUMP = 5.0
"""Seconds by which a clock jumps."""
PASSING = 0.02
"""Seconds that pictures may take through the maker's library before the next ones are taken."""


def simulated_serials(cameras: tuple[Camera, ...]) -> dict[str, str]:
    """Numbers of the simulated devices, by camera."""
    return {camera.name: f"simulated-{camera.name}" for camera in cameras}


def sized(cameras: tuple[Camera, ...], width: int, height: int) -> tuple[Camera, ...]:
    """Cameras with so many pixels; what they see in height stays."""
    found = []
    for camera in cameras:
        fov = 2.0 * np.arctan(0.5 * camera.height / camera.intrinsic[1, 1])
        intrinsic = pinhole(width, height, float(fov))
        found.append(replace(camera, width=width, height=height, intrinsic=intrinsic))
    return tuple(found)


def simulated_cameras(profile: RobotProfile, width: int, height: int) -> tuple[Camera, ...]:
    """The fixed cameras of observations and the robot's own, with so many pixels; the latter in their links' frames."""
    own = tuple(
        Camera(
            each.name,
            each.width,
            each.height,
            pinhole(each.width, each.height, each.field_of_view),
            np.asarray(each.T_link_camera, dtype=np.float64),
            FAR,
            each.link,
        )
        for each in profile.cameras
    )
    return sized((*observation_cameras(profile), *own), width, height)


class SimulatedCameras:
    """Cameras that look at a simulated world.

    Args:
        profile: of the robot.
        cameras: that there are.
        seed: of their noise.
        noise: on each picture; its errors of pose, depth and clock are drawn each episode, and nothing is told of them.
    """

    def __init__(self, profile: RobotProfile, cameras: tuple[Camera, ...], seed: int, noise: DepthNoise = D435) -> None:
        self.profile, self.cameras, self._noise = profile, cameras, noise
        self.serials = simulated_serials(cameras)
        self._seed, self._draw = seed, rng(seed, "simulated cameras")
        self._errors: dict[str, CameraError] = {}
        self._late = 0.0
        self._drawn = noise
        self._episode = -1
        self._scene: RaycastScene | None = None
        self._numbers = dict.fromkeys((camera.name for camera in cameras), 0)
        self._last: dict[str, Frame] = {}
        self._held: list[tuple[float, Frame]] = []
        self.faults: set[str] = set()

    def prepare(self, models: Mapping[str, object], episode: int) -> None:
        """Build what rays meet in an episode."""
        draw = rng(self._seed, "errors of simulated cameras", episode)
        self._drawn = self._noise.drawn(draw)
        self._late = self._noise.time * float(draw.standard_normal())
        self._errors = {camera.name: self._noise.error(draw) for camera in self.cameras}
        true = [
            replace(camera, T_base_camera=camera.T_base_camera @ np.linalg.inv(self._errors[camera.name].T))
            for camera in self.cameras
        ]
        self._scene = RaycastScene(self.profile, models, true)  # type: ignore[arg-type]
        self._episode = episode

    def take(self, rows: Rows) -> list[Frame]:
        """Pictures of one instant, as they come: a fault concerns the first camera, or the first two."""
        if rows.episode != self._episode:
            self.prepare(rows.models, rows.episode)
        scene = self._scene
        assert scene is not None
        links = {camera.link: self.profile.model.forward_kinematics(rows.q, camera.link) for camera in self.cameras}
        views = scene.see(scene.poses(rows.states)[0], {link: pose for link, pose in links.items() if link is not None})
        found = []
        for camera, view in zip(self.cameras, views, strict=True):
            colors = view.colors_at(np.arange(camera.width * camera.height)).reshape(camera.height, camera.width, 3)
            depth = self._drawn.on(view.depth, self._draw, colors, float(camera.intrinsic[1, 1]))
            depth = self._errors[camera.name].on(depth)
            frame = Frame(
                camera.name,
                self._numbers[camera.name],
                rows.time + self._late,
                np.rint(1000.0 * depth).clip(0, 65535).astype(np.uint16),
                colors,
                self.serials[camera.name],
            )
            self._numbers[camera.name] += 1
            found.append(frame)
        if self.faults & {"camera-swapped", "camera-mislabelled"}:
            found[:2] = self._exchanged(*found[:2])
        return [each for frame in found for each in self._faulty(frame)]

    def _exchanged(self, one: Frame, other: Frame) -> tuple[Frame, Frame]:
        """Each under the other's name; the devices' numbers go with them, unless they lie."""
        lie = "camera-mislabelled" in self.faults
        return tuple(
            replace(theirs, camera=own.camera, number=own.number, serial=own.serial if lie else theirs.serial)
            for own, theirs in ((one, other), (other, one))
        )  # type: ignore[return-value]

    def _faulty(self, frame: Frame) -> list[Frame]:
        if frame.camera != self.cameras[0].name:
            return [frame]
        last = self._last.setdefault(frame.camera, frame)
        if "camera-unplugged" in self.faults:
            return []
        if "camera-frozen" in self.faults:
            return [replace(frame, depth=last.depth, colors=last.colors)]
        if "camera-torn" in self.faults:
            torn, self._last[frame.camera] = frame.depth.copy(), frame
            half = len(torn) // 2
            torn[half:] = last.depth[half:]  # what had come of it when the buffer was read
            return [replace(frame, depth=torn)]
        if "camera-clock" in self.faults:
            return [replace(frame, captured=frame.captured - JUMP)]
        if "camera-late" in self.faults:
            self._held.append((frame.captured + LATE, frame))
            due = [each for at, each in self._held if at <= frame.captured]
            self._held = [each for each in self._held if each[0] > frame.captured]
            return due
        self._last[frame.camera] = frame
        return [frame]


class RenderedCameras:
    """Simulated cameras that look at a world in another process, at their rate.

    Args:
        robot_name: of the robot.
        cameras: that there are.
        world: end of the pipe by which they ask for what is there.
        seed: of their noise.
        rate: pictures a second.
        noise: on them.
        through: pictures go through software devices of ``pyrealsense2``.

    Attributes:
        cameras: that there are.
        serials: numbers of their devices, by name.

    Raises:
        MissingExtraError: they are to, and it is not installed.
    """

    def __init__(
        self,
        robot_name: str,
        cameras: tuple[Camera, ...],
        world: Connection,
        seed: int,
        rate: float,
        noise: DepthNoise,
        through: bool = False,
    ) -> None:
        self._taker = SimulatedCameras(robot(robot_name), cameras, seed, noise)
        self.cameras, self.serials = cameras, self._taker.serials
        self._world, self._period = world, 1.0 / rate
        self._devices: SoftwareCameras | None = None
        if through:
            from gensim2_robot.drivers.software_realsense import SoftwareCameras

            self._devices = SoftwareCameras(cameras, self.serials, round(rate))
        self._due = time.monotonic()

    def poll(self) -> Sequence[Frame]:
        """Pictures of the present instant, where it is time for them."""
        if time.monotonic() < self._due:
            return []
        self._world.send("rows")
        frames = self._taker.take(self._world.recv())
        if self._devices is not None:
            frames = self._devices.passed(frames, PASSING)
        self._due = max(self._due + self._period, time.monotonic())
        return frames

    def fail(self, fault: str) -> None:
        """Fail from now on."""
        self._taker.faults.add(fault)

    def close(self) -> None:
        """Leave the software devices."""
        if self._devices is not None:
            self._devices.close()
