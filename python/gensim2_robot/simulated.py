"""Simulate an arm, a scene and cameras for the control loop."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

import numpy as np

from gensim2.core.arrays import Array
from gensim2.core.seeding import rng
from gensim2.objects import ObjectModel
from gensim2.perception import D435, Camera, CameraError, DepthNoise
from gensim2.perception.camera import FAR, observation_cameras, pinhole
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.planning.scene import Scene
from gensim2.robots import OPEN, RobotProfile, robot
from gensim2.rollout.motion import is_at_rest, is_stable
from gensim2.scenes.config import SceneConfig
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.measurement import Measurement
from gensim2_robot.arm_limits import CYCLE
from gensim2_robot.devices import ArmMode, ArmState, CameraFrame

if TYPE_CHECKING:
    from gensim2_robot.drivers.realsense import SoftwareCameras

GOAL_EVERY = 10
"""Cycles between two checks of the goal."""
FORCE_CYCLES = 5
"""Number of cycles over which the contact force is averaged, because simulated contacts are impulses."""
LAG = 0.4
"""Delay (s) of a simulated arm with the fault `arm-lagging`."""
_MODES: Mapping[str, ArmMode] = {"arm-reflex": "reflex", "arm-refusing": "refusing", "arm-at-limit": "at-limit"}
"""Mode that the simulated arm reports while a fault is injected."""


@dataclass(frozen=True, eq=False)
class Rows:
    """State of the simulated world at one instant. Simulated cameras render their images from this state.

    Attributes:
        time: time of the state, s.
        episode: number of times that the world was reset before this state.
        states: state in the form of ManiSkill's ``env_states``, with a first axis of length 1.
        q: (n,) all active joints.
    """

    time: float
    episode: int
    states: Mapping[str, Any]
    models: Mapping[str, ObjectModel]
    q: Array


class SimulatedWorld:
    """A simulated world that advances with the cycles of the control loop; faults can be injected into its arm.

    Args:
        scene: settings of the scenes.
    """

    def __init__(self, scene: SceneConfig) -> None:
        self._env = HeadlessEnv(scene)
        self.profile, self.task = self._env.profile, self._env.task
        if self.profile.simulation.physics_hz != round(1.0 / CYCLE):
            raise ValueError(
                f"the physics rate is {self.profile.simulation.physics_hz} Hz, but must equal the driver's rate of "
                f"{1 / CYCLE:g} Hz"
            )
        self.faults: set[str] = set()
        self.episode = 0
        self._stopped = False
        self._action = np.zeros(self.profile.action_size)
        self._waiting: deque[tuple[float, np.ndarray]] = deque()
        self._said: deque[ArmState] = deque()
        self._pressed: deque[float] = deque(maxlen=FORCE_CYCLES)
        self._looked: Measurement | None = None

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """Create a new scene.

        An arm that refused commands accepts them again, unless the fault is permanent.

        Args:
            seed: seed of random values.
            options: reset options, which replace random values.
        """
        self._env.reset(seed, options)
        self.episode += 1
        self._stopped, self._looked = False, None
        for each in (self._waiting, self._said, self._pressed):
            each.clear()
        self._hold_here(OPEN)

    def send(self, q: Array, gripper: float, time: float) -> None:
        """Accept targets of the arm's joints (m,) and the gripper."""
        delay = LAG if "arm-lagging" in self.faults else 0.0
        self._waiting.append((time + delay, np.append(q, gripper)))

    def stand(self) -> None:
        """Stop the arm at its current position, and ignore targets until the next reset."""
        self._stopped = True
        self._hold_here(float(self._action[-1]))

    def advance(self, now: float) -> None:
        """Simulate one cycle, up to the time ``now`` (s)."""
        mode: ArmMode = next((said for fault, said in _MODES.items() if fault in self.faults), "ready")
        if mode in ("reflex", "at-limit") and not self._stopped:
            self.stand()
        while self._waiting and self._waiting[0][0] <= now:
            _, action = self._waiting.popleft()
            if not self._stopped and mode != "refusing":
                self._action = action
        self._env.substep(self._action)
        self._pressed.append(self._env.pressing_force())
        force = sum(self._pressed) / len(self._pressed)
        self._said.append(ArmState(now, self._env.q, self._env.qvel, force, mode))

    def said(self, now: float) -> list[ArmState]:
        """Return the arm states that have arrived up to the time ``now`` (s)."""
        found = []
        delay = LAG if "arm-lagging" in self.faults else 0.0
        while self._said and self._said[0].time <= now - delay:
            found.append(self._said.popleft())
        if "arm-silent" in self.faults:
            return []
        return found

    def rows(self, now: float) -> Rows:
        states = {
            kind: {name: row[None].copy() for name, row in group.items()} for kind, group in self._env.state().items()
        }
        models = {name: thing.model for name, thing in self._env.initial_state.objects.items()}
        return Rows(now, self.episode, states, models, self._env.q)

    def measure(self) -> Measurement:
        """Return the true measurement of objects and gripper. The result can be sent to another process."""
        found = self._env.measure()
        return Measurement(**{**vars(found), "gripper": {name: np.array(at) for name, at in found.gripper.items()}})

    def scene_state(self) -> Scene:
        return self._env.scene_state()

    def look(self) -> tuple[bool, bool]:
        """Return whether the goal is reached in a stable simulation, and whether the scene is at rest.

        The scene is at rest if no object has moved since the last call. Call this method every ``GOAL_EVERY`` cycles.
        """
        measured = self.measure()
        before, self._looked = self._looked, measured
        rests = before is not None and is_at_rest(before, measured, GOAL_EVERY * CYCLE)
        return self._env.is_finite and is_stable(measured) and all_hold(self.task.success, measured), rests

    def close(self) -> None:
        self._env.close()

    def _hold_here(self, gripper: float) -> None:
        arm = self._env.q[list(self.profile.arm_columns)]
        self._action = np.append(arm, gripper)


RATE = 10.0
"""Frame rate of each camera, Hz."""
LATE = 0.3
"""Delay of a camera's images under the fault ``camera-late``, s."""
JUMP = 5.0
"""Time by which a fault makes a clock jump, s."""
PASSING = 0.02
"""Time limit for images to pass through the camera manufacturer's library, s."""


def simulated_serials(cameras: tuple[Camera, ...]) -> dict[str, str]:
    """Return the serial numbers of the simulated devices by camera."""
    return {camera.name: f"simulated-{camera.name}" for camera in cameras}


def sized(cameras: tuple[Camera, ...], width: int, height: int) -> tuple[Camera, ...]:
    """Return the cameras with a new image size and the same vertical field of view."""
    found = []
    for camera in cameras:
        fov = 2.0 * np.arctan(0.5 * camera.height / camera.intrinsic[1, 1])
        intrinsic = pinhole(width, height, float(fov))
        found.append(replace(camera, width=width, height=height, intrinsic=intrinsic))
    return tuple(found)


def simulated_cameras(profile: RobotProfile, width: int, height: int) -> tuple[Camera, ...]:
    """Return fixed cameras and cameras on links with the given image size.

    The pose of a camera on a link is in the link's frame."""
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
    """Cameras that render a simulated world.

    Args:
        cameras: cameras to simulate.
        seed: seed of the noise.
        noise: noise model. Each image has its own depth noise. Errors of pose, depth and clock are constant in an
            episode.
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
        self._last: dict[str, CameraFrame] = {}
        self._held: list[tuple[float, CameraFrame]] = []
        self.faults: set[str] = set()

    def prepare(self, models: Mapping[str, object], episode: int) -> None:
        """Build the ray-casting scene of an episode."""
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

    def take(self, rows: Rows) -> list[CameraFrame]:
        """Return the images of all cameras for one state.

        Faults affect the first camera or exchange the first two cameras.
        """
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
            frame = CameraFrame(
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

    def _exchanged(self, one: CameraFrame, other: CameraFrame) -> tuple[CameraFrame, CameraFrame]:
        """Exchange the images of two cameras.

        Their serial numbers are exchanged, too, unless the fault is ``camera-mislabelled``.
        """
        lie = "camera-mislabelled" in self.faults
        return tuple(
            replace(theirs, camera=own.camera, number=own.number, serial=own.serial if lie else theirs.serial)
            for own, theirs in ((one, other), (other, one))
        )  # type: ignore[return-value]

    def _faulty(self, frame: CameraFrame) -> list[CameraFrame]:
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
            torn[half:] = last.depth[half:]  # Simulate a torn image, whose lower half still shows the previous image.
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
    """Cameras that render a simulated world at their frame rate. The world is simulated in another process.

    Args:
        robot_name: name of the robot.
        cameras: cameras to simulate.
        world: pipe end with which the cameras request the world's state.
        seed: seed of the noise.
        rate: frame rate, Hz.
        noise: depth noise of the images.
        through: whether to pass images through software devices of ``pyrealsense2``.

    Attributes:
        cameras: simulated cameras.
        serials: serial number of each camera's device, by camera name.

    Raises:
        MissingExtraError: ``through`` is set and ``pyrealsense2`` is not installed.
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
            from gensim2_robot.drivers.realsense import SoftwareCameras

            self._devices = SoftwareCameras(cameras, self.serials, round(rate))
        self._due = time.monotonic()

    def poll(self) -> Sequence[CameraFrame]:
        """Return images of the current instant if they are due."""
        if time.monotonic() < self._due:
            return []
        self._world.send("rows")
        frames = self._taker.take(self._world.recv())
        if self._devices is not None:
            frames = self._devices.passed(frames, PASSING)
        self._due = max(self._due + self._period, time.monotonic())
        return frames

    def fail(self, fault: str) -> None:
        self._taker.faults.add(fault)

    def close(self) -> None:
        if self._devices is not None:
            self._devices.close()
