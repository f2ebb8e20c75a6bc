"""Compute observations of simulated states, for data sets, environments and controllers."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.objects import ObjectModel
from gensim2.perception import (
    Camera,
    CameraError,
    EmptyCloudError,
    Encoder,
    Observation,
    ObservationSpec,
    View,
)
from gensim2.perception.camera import mounted, observation_cameras, require_cameras
from gensim2.perception.cloud import FARTHEST, PointCloud, from_steps, to_steps
from gensim2.perception.raycast.kinematics import state_rows
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.robots import OPEN, RobotProfile


class KnownPoints:
    """Computes point clouds from the true positions of points on a scene's objects. The chosen points determine the
    pose of each object and the position of its joint.

    The cloud lists the objects in the task's order. Each object contributes three groups of points: eight corners of a
    box around its moving part, along the axes of the moving link; eight corners of a box around its fixed part, along
    the axes of the root link; and its keypoints, sorted by name. A rigid object has only one box. The list is repeated
    until the cloud has ``count`` points.

    Args:
        scene: ray-casting scene with the objects.
        objects: objects by name, in the task's order.
        count: N, number of points in the cloud.

    Raises:
        InputError: the objects have more points than the cloud.
    """

    def __init__(self, scene: RaycastScene, objects: Mapping[str, ObjectModel], count: int) -> None:
        self._scene = scene
        #: For each point of the cloud: the object's name, the link that carries the point, and the point's position
        #: (3,) in the link's frame.
        self._points: list[tuple[str, str, Array]] = []
        for name, model in objects.items():
            for link, points in _boxes(scene, name, model):
                self._points += [(name, link, point) for point in points]
            for _, keypoint in sorted(model.keypoints.items()):
                # A rigid object has a single link with the object's name.
                link = name if model.joint is None else keypoint.link
                self._points.append((name, link, np.asarray(keypoint.position, dtype=np.float64)))
        if len(self._points) > count:
            message = f"is {count}, but the objects have {len(self._points)} keypoints and bounding box corners"
            raise InputError(message, field="observation.points", remedy=f"set it to at least {len(self._points)}")
        self._rows = np.arange(count) % len(self._points)
        self._ids = np.array([scene.ids(name, [link])[0] for name, link, _ in self._points], dtype=np.int16)

    def at(self, states: Mapping[str, Any]) -> list[PointCloud]:
        """Return the clouds of T recorded instants in the robot's base frame.

        Args:
            states: ManiSkill's ``env_states``, T rows per array.

        Raises:
            InputError: the states belong to a different scene.
        """
        # links that carry points; each link occurs once
        places = dict.fromkeys((name, link) for name, link, _ in self._points)
        frames = {(name, link): self._scene.link_poses(states, name, link) for name, link in places}
        placed = [
            frames[name, link][:, :3, :3] @ point + frames[name, link][:, :3, 3] for name, link, point in self._points
        ]
        xyz = np.clip(np.stack(placed, axis=1)[:, self._rows], -FARTHEST, FARTHEST).astype(np.float32)
        colours, ids = np.zeros((len(self._rows), 3), np.uint8), self._ids[self._rows]
        return [PointCloud(from_steps(to_steps(points)), colours, ids) for points in xyz]


def _boxes(scene: RaycastScene, name: str, model: ObjectModel) -> list[tuple[str, Array]]:
    """Return the bounding boxes of an object's moving part and fixed part, or the single bounding box of a rigid
    object. Each box is a pair: the name of the link in whose frame the box is given, and the corners (8, 3) of the box
    in this frame.
    """
    if model.joint is None:
        return [(name, _corners(np.concatenate([hull for hulls in model.hulls.values() for hull in hulls])))]
    tree = scene.tree(name)
    at_zero = dict(zip(tree.names, tree.poses(np.eye(4)[None], np.zeros((1, 1)))[0], strict=True))
    found = []
    for moves in (True, False):
        frame = model.joint.child_link if moves else tree.names[0]
        links = [link for link, still in zip(tree.names, tree.still, strict=True) if still is not moves]
        hulls = []
        for link in links:
            T = np.linalg.inv(at_zero[frame]) @ at_zero[link]
            hulls += [hull @ T[:3, :3].T + T[:3, 3] for hull in model.hulls.get(link, ())]
        if hulls:
            found.append((frame, _corners(np.concatenate(hulls))))
    return found


def _corners(points: Array) -> Array:
    """Return the corners (8, 3) of the axis-aligned bounding box of points (n, 3)."""
    ends = np.stack([points.min(0), points.max(0)])
    return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in itertools.product((0, 1), repeat=3)])


Photograph = Callable[[Mapping[str, Any], int], Mapping[str, npt.NDArray[np.uint8]]]
"""Function that returns colour images (H, W, 3) by camera for one row of states."""

_ROOT = 13
"""Number of values before the joint values in a ManiSkill articulation state: root pose and velocities."""


class Observer:
    """Computes the observations of one episode. An observation depends only on the state, the seed of the episode, and
    the number of the control step.

    Args:
        objects: objects by name, in the task's order.
        seed: seed of the episode's reset, which determines the noise.
        language: instruction of the task.
        photograph: function that renders colour images. It is required if the observation spec requests ``rgb``.

    Raises:
        InputError: a file of the robot or of an object cannot be used.
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
        #: The cameras of the spec. The pose of a fixed camera is in the base frame, and the pose of a camera on the
        #: robot is in the frame of its link.
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
        """Scene of robot and objects into which the rays of the cameras are cast.

        The scene exists only for observation specs with cameras.
        """
        assert self._scene is not None, "the spec casts no rays"
        return self._scene

    def observe(self, states: Mapping[str, Any], step: int, command: float = OPEN) -> Observation:
        """Return the observation of one instant.

        Args:
            states: ManiSkill's ``env_states``, one row per array.
            step: control steps since the reset.
            command: last gripper command, -1 to 1.

        Raises:
            InputError: the states belong to a different scene.
            EmptyCloudError: the point cloud is empty.
        """
        (found,) = self._encoded(states, [command], step)
        return found

    def joints(
        self, positions: npt.ArrayLike, velocities: npt.ArrayLike, step: int, command: float = OPEN
    ) -> Observation:
        """Return an observation without images, from joint positions (n,) and velocities (n,). The spec must have no
        cameras.
        """
        return self._encoder.encode(step, positions, velocities, command)

    def recorded(self, states: Mapping[str, Any], actions: npt.NDArray[np.float32]) -> Iterator[Observation]:
        """Yield the observations of an episode.

        Args:
            states: ManiSkill's ``env_states`` of T + 1 instants.
            actions: (T, m + 1) actions between these instants.

        Raises:
            InputError: as for :meth:`observe`.
            EmptyCloudError: as for :meth:`observe`; the message names the step.
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
        """Return the cameras with their poses in the base frame. ``positions`` (n,) are the robot's joint positions,
        which determine the poses of cameras on the robot.
        """
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
        """Return the images of all cameras, with the noise that the spec requests.

        Args:
            poses: (L, 4, 4) poses of the solids, one row of :meth:`RaycastScene.poses`.
            step: control steps since the reset.
            positions: (n,) true positions of all active joints. They determine the true pose of a camera on the robot,
                and therefore its image.
            read: (n,) joint positions that the robot reports, which lag behind ``positions`` if the robot reports with
                a delay. The camera poses in the returned views are computed from the reported positions. None: the
                robot reports without a delay.
        """
        views = self.scene.see(poses, {} if positions is None else self._links_at(positions))
        if self._noise is None:
            return views
        generator = rng(self._seed, "depth noise", step)
        assumed = [view.camera for view in views] if read is None or not self._late else self.cameras_at(read)
        found = []
        for view, camera in zip(views, assumed, strict=True):
            colors = None
            if self._noise.dark_lost:
                colors = view.colors_at(np.arange(view.depth.size)).reshape(*view.depth.shape, 3)
            depth = self._noise.on(view.depth, generator, colors, float(view.camera.intrinsic[1, 1]))
            if (error := self._errors.get(camera.name)) is not None:
                depth = error.on(depth)
                camera = replace(camera, T_base_camera=camera.T_base_camera @ error.T)
            found.append(view.measured(camera, depth))
        return tuple(found)
