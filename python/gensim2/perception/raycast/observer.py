"""Observations of simulated states: one class for data sets, for environments and for controllers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.seeding import rng
from gensim2.objects import ObjectModel
from gensim2.perception import (
    Camera,
    CameraError,
    DepthNoise,
    EmptyCloudError,
    Encoder,
    Observation,
    ObservationSpec,
    View,
)
from gensim2.perception.cameras import mounted, observation_cameras, require_cameras
from gensim2.perception.raycast.keypoints import KnownPoints
from gensim2.perception.raycast.kinematics import state_rows
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.robots import OPEN, RobotProfile

Array = npt.NDArray[np.float64]
Photograph = Callable[[Mapping[str, Any], int], Mapping[str, npt.NDArray[np.uint8]]]
"""Colour pictures (H, W, 3) by camera, of one row of states."""

_ROOT = 13
"""Numbers before the joints in a state of ManiSkill's: root pose and velocities."""


class Observer:
    """Observations of one episode, each a function of the state, of the episode's seed and of the step alone.

    Args:
        profile: of the robot.
        objects: by name, in the task's order.
        spec: what is seen.
        seed: of the episode's reset; the noise follows from it.
        language: what is to be done.
        photograph: gives colour pictures, where the spec asks for them.

    Raises:
        InputError: a file of the robot or of an object cannot be used.
        MissingExtraError: Embree is not installed.
    """

    def __init__(
        self,
        profile: RobotProfile,
        objects: Mapping[str, ObjectModel],
        spec: ObservationSpec,
        seed: int,
        language: str = "",
        photograph: Photograph | None = None,
    ) -> None:
        self.spec, self._profile, self._seed, self._photograph = spec, profile, seed, photograph
        require_cameras(spec.cameras, profile)
        fixed = {camera.name: camera for camera in observation_cameras(profile)}
        own = {camera.name: mounted(camera, np.eye(4)) for camera in profile.cameras}
        #: Those that a link carries with their poses in its frame.
        self.cameras = tuple((fixed | own)[name] for name in spec.cameras)
        self._links = tuple(dict.fromkeys(camera.link for camera in self.cameras if camera.link is not None))
        self._scene = RaycastScene(profile, objects, self.cameras) if spec.casts else None
        self._known = None
        if spec.is_privileged:
            self._known = KnownPoints(self._scene or RaycastScene(profile, objects, ()), objects, spec.cloud.points)
        noise = spec.cloud.noise if spec.casts else None
        self._noise = None if noise is None else noise.drawn(rng(seed, "noise of the episode"))
        self._late = 0.0 if noise is None else noise.time * float(rng(seed, "clock error").standard_normal())
        self._errors: dict[str, CameraError] = {}
        if noise is not None and any((noise.rotation, noise.translation, noise.scale, noise.bias)):
            self._errors = {each.name: noise.error(rng(seed, f"error of {each.name}")) for each in self.cameras}
        self._encoder = Encoder(spec, profile, language, None if self._scene is None else self._scene.robot)

    @property
    def scene(self) -> RaycastScene:
        """Scene of the rays; of a spec that casts any."""
        assert self._scene is not None, "the spec casts no rays"
        return self._scene

    def observe(self, states: Mapping[str, Any], step: int, command: float = OPEN) -> Observation:
        """One instant.

        Args:
            states: ManiSkill's ``env_states``, one row an array.
            step: control steps since the reset.
            command: the gripper's last, -1 to 1.

        Raises:
            InputError: the states are not of this scene.
            EmptyCloudError: the cameras see nothing that a point cloud keeps.
        """
        (found,) = self._encoded(states, [command], step)
        return found

    def joints(
        self, positions: npt.ArrayLike, velocities: npt.ArrayLike, step: int, command: float = OPEN
    ) -> Observation:
        """One instant of a spec that looks through no camera, from (n,) joints and their velocities alone."""
        return self._encoder.encode(step, positions, velocities, command)

    def recorded(self, states: Mapping[str, Any], actions: npt.NDArray[np.float32]) -> Iterator[Observation]:
        """Every instant of an episode.

        Args:
            states: ManiSkill's ``env_states`` of T + 1 instants.
            actions: (T, m + 1) that were taken between them.

        Raises:
            InputError, EmptyCloudError: as for :meth:`observe`; the second says at which step.
        """
        return self._encoded(states, [OPEN, *map(float, actions[:, -1])], 0)

    def _encoded(self, states: Mapping[str, Any], commands: Sequence[float], first: int) -> Iterator[Observation]:
        joints = len(self._profile.reset_qpos)
        robot = state_rows(states, "articulations", self._profile.agent, _ROOT + 2 * joints)
        poses = self.scene.poses(states) if self.spec.casts else None
        known = None if self._known is None else self._known.at(states)
        for row, command in enumerate(commands):
            step = first + row
            try:
                q, v = robot[row, _ROOT : _ROOT + joints], robot[row, _ROOT + joints :]
                read = q + np.float32(self._late) * v if self._late else q
                yield self._encoder.encode(
                    step,
                    read,
                    v,
                    command,
                    () if poses is None else self.views(poses[row], step, q, read),
                    None if self._photograph is None else self._photograph(states, row),
                    None if known is None else known[row],
                )
            except EmptyCloudError as error:
                raise EmptyCloudError(f"step {step}: {error}") from error

    def cameras_at(self, positions: npt.ArrayLike) -> tuple[Camera, ...]:
        """The cameras in the base frame, where the (n,) joints stand at ``positions``."""
        links = self._links_at(positions)
        return tuple(
            camera if camera.link is None else replace(camera, T_base_camera=links[camera.link] @ camera.T_base_camera)
            for camera in self.cameras
        )

    def _links_at(self, positions: npt.ArrayLike) -> dict[str, Array]:
        q = np.asarray(positions, dtype=np.float64)
        return {link: self._profile.model.forward_kinematics(q, link) for link in self._links}

    def views(
        self, poses: Array, step: int, positions: npt.ArrayLike | None = None, read: npt.ArrayLike | None = None
    ) -> tuple[View, ...]:
        """The cameras' pictures, with the noise of the spec on them.

        Args:
            poses: (L, 4, 4), one row of :meth:`RaycastScene.poses`.
            step: control steps since the reset.
            positions: (n,) of all active joints, where the robot carries cameras that are looked through.
            read: the same as the robot says them; None: as they are.
        """
        views = self.scene.see(poses, {} if positions is None else self._links_at(positions))
        if self._noise is None:
            return views
        generator = rng(self._seed, "depth noise", step)
        cameras = [view.camera for view in views]
        if read is not None and self._late:
            cameras = list(self.cameras_at(read))
        return tuple(
            noisy(view, camera, self._noise, self._errors.get(camera.name), generator)
            for view, camera in zip(views, cameras, strict=True)
        )


def noisy(
    view: View, believed: Camera, noise: DepthNoise, error: CameraError | None, generator: np.random.Generator
) -> View:
    """A view as a real camera gives it.

    Args:
        view: without noise.
        believed: the camera as it would be known without an error.
        noise: of the episode.
        error: of the episode; None: the camera is where it is believed to be.
        generator: of all that is drawn.
    """
    pixels = np.arange(view.depth.size)
    colors = view.colors_at(pixels).reshape(*view.depth.shape, 3) if noise.dark_lost else None
    depth = noise.on(view.depth, generator, colors, float(view.camera.intrinsic[1, 1]))
    if error is not None:
        depth = error.on(depth)
        believed = replace(believed, T_base_camera=believed.T_base_camera @ error.T)
    return _Noisy(view, believed, depth)


class _Noisy:
    """A view with noise on its depth."""

    def __init__(self, view: View, camera: Camera, depth: npt.NDArray[np.float32]) -> None:
        self.camera, self.depth = camera, depth
        self.segmentation, self.colors_at = view.segmentation, view.colors_at
