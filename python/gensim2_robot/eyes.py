"""Compute observations from images and joints; the control loop and the replay of logs both use this code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import maximum_filter

from gensim2.core.arrays import Array
from gensim2.core.errors import GenSim2Error, InputError
from gensim2.perception import Camera, Encoder, Observation, ObservationSpec, Picture, RobotSegments
from gensim2.perception.raycast.caster import Caster, CastSolid
from gensim2.perception.raycast.kinematics import Tree, read_urdf
from gensim2.perception.raycast.shapes import read_links
from gensim2.robots import RobotProfile
from gensim2_robot.devices import CameraFrame

NEAR = 0.02
"""Maximum difference (m) between measured depth and the robot's meshes at which a pixel counts as robot."""

THROUGH = 0.05
"""Distance (m) behind the robot's surface at which a correctly placed camera cannot measure."""
THROUGH_SHARE = 0.3
"""The camera pose counts as wrong if at least this fraction of the robot's pixels measures points behind the robot."""
THROUGH_PIXELS = 1.0 / 400.0
"""Minimum fraction of an image that the robot must cover for a check of the camera pose."""
OUTLINE = 1.0 / 100.0
"""Width of the robot's outline as a fraction of the width of the image. The outline is not checked, because small
errors move it off the robot.
"""


class CameraPoseError(GenSim2Error):
    """The robot is not where its meshes should appear in an image, because the camera was moved or exchanged."""


class OwnPoints:
    """Finds the robot's own pixels in images, by comparing depth with the robot's meshes.

    Args:
        cameras: cameras. The pose of a camera on a link is in the link's frame.
        near: maximum difference (m) between the measured depth of a robot pixel and the depth of the robot's meshes.

    Attributes:
        robot: segmentation ids of the hand (with its descendants) and of the other links.
    """

    def __init__(self, profile: RobotProfile, cameras: Sequence[Camera], near: float = NEAR) -> None:
        self._profile, self._cameras, self._near = profile, tuple(cameras), near
        self._tree = Tree.of(read_urdf(profile.urdf), (*profile.arm_joints, *profile.gripper.joints))
        surfaces = read_links(self._tree.file)
        self._shown = [number for number, name in enumerate(self._tree.names) if surfaces[name] is not None]
        solids = [
            CastSolid(number + 1, surface, still=False)
            for number in self._shown
            if (surface := surfaces[self._tree.names[number]]) is not None
        ]
        # Depth is corrected here, so the stored cameras must not correct the depth again.
        self._seen = {camera.name: replace(camera, depth_scale=1.0, depth_bias=0.0) for camera in self._cameras}
        self._casters = {camera.name: Caster(solids, [camera]) for camera in self._cameras}
        rest = self._tree.poses(np.eye(4)[None], np.array(profile.reset_qpos)[None])[0][self._shown]
        for caster in self._casters.values():
            caster.cast(rest)  # The first call is slow, so it is made before the loop starts.
        hanging = {profile.hand_link}
        for name, parent in zip(self._tree.names, self._tree.parents, strict=True):
            if parent >= 0 and self._tree.names[parent] in hanging:
                hanging.add(name)
        hand = frozenset(number + 1 for number, name in enumerate(self._tree.names) if name in hanging)
        self.robot = RobotSegments(hand, frozenset(range(1, len(self._tree.names) + 1)) - hand)

    def placed(self, camera: Camera, q: Array) -> Camera:
        """Return a camera with its pose in the base frame at joints ``q`` (n,)."""
        if camera.link is None:
            return camera
        T_base_link = self._profile.model.forward_kinematics(q, camera.link)
        return replace(camera, T_base_camera=T_base_link @ camera.T_base_camera)

    def picture(
        self, camera: Camera, depth: npt.NDArray[np.uint16], colors: npt.NDArray[np.uint8] | None, q: Array
    ) -> Picture:
        """Return an image with corrected depth (m) in which the pixels that show the robot are marked.

        Args:
            camera: camera of the image.
            depth: (H, W) depth, mm.
            colors: (H, W, 3) colours, or None.
            q: (n,) all active joints at the time of the image.

        Raises:
            CameraPoseError: measured points lie behind the robot, so the pose of the camera is wrong.
        """
        metres = camera.metres(depth)
        poses = self._tree.poses(np.eye(4)[None], q[None])[0][self._shown]
        if camera.link is not None:
            T_base_link = self._profile.model.forward_kinematics(q, camera.link)
            poses = np.linalg.inv(T_base_link) @ poses
        caster = self._casters[camera.name]
        hits = caster.cast(poses)
        own = caster.segmentation(hits.face[0])
        require_robot(camera, metres, hits.depth[0], own)
        seen = self.placed(self._seen[camera.name], q)
        return Picture(seen, metres, _marked(metres, hits.depth[0], own, self._near), colors)


def require_robot(
    camera: Camera, depth: npt.NDArray[np.float32], meshes: npt.NDArray[np.float32], ids: npt.NDArray[np.int16]
) -> None:
    """Raise an error if points lie behind the robot's surface, which would hide them.

    Points in front of it are allowed.
    """
    reach = 2 * max(1, round(OUTLINE * depth.shape[1])) + 1
    farthest = maximum_filter(np.where(ids > 0, meshes, np.inf), reach)
    covered = np.isfinite(farthest) & (depth > 0)
    count = int(covered.sum())
    if count < THROUGH_PIXELS * depth.size:
        return
    through = int((covered & (depth > farthest + THROUGH)).sum())
    if through > THROUGH_SHARE * count:
        raise CameraPoseError(
            f"camera {camera.name}: {100 * through // count} % of the points that should lie on the robot lie behind "
            "it, so the camera was exchanged or moved"
        )


def _marked(
    depth: npt.NDArray[np.float32], meshes: npt.NDArray[np.float32], ids: npt.NDArray[np.int16], near: float
) -> npt.NDArray[np.int16]:
    """Return ids of pixels with the depth of the meshes there or beside, because stereo makes objects wider."""
    found = np.where((ids > 0) & (np.abs(depth - meshes) < near), ids, np.int16(0))
    for here, there in (
        (np.s_[1:, :], np.s_[:-1, :]),
        (np.s_[:-1, :], np.s_[1:, :]),
        (np.s_[:, 1:], np.s_[:, :-1]),
        (np.s_[:, :-1], np.s_[:, 1:]),
    ):
        beside = (found[here] == 0) & (ids[there] > 0) & (np.abs(depth[here] - meshes[there]) < near)
        found[here] = np.where(beside, ids[there], found[here])
    return found


PIXELS = 320 * 240
"""Minimum number of pixels of an image that are used; a cloud is sampled from a few thousand pixels."""


def thinned(camera: Camera, pixels: float = PIXELS) -> tuple[Camera, int]:
    """Keep every n-th row and column of a camera, with the largest n that leaves at least ``pixels`` pixels.

    Args:
        camera: camera with full resolution.
        pixels: minimum number of pixels of a reduced image.

    Returns:
        The camera with reduced resolution, and the number n.
    """
    step = max(1, int((camera.width * camera.height / pixels) ** 0.5))
    if step == 1:
        return camera, 1
    intrinsic = camera.intrinsic.copy()
    intrinsic[:2] /= step
    # Pixel centres are at half integers, so the coordinate x becomes (x - 0.5) / step + 0.5.
    intrinsic[:2, 2] += 0.5 - 0.5 / step
    width, height = -(-camera.width // step), -(-camera.height // step)
    return replace(camera, width=width, height=height, intrinsic=intrinsic), step


@dataclass(frozen=True, eq=False)
class SensorSnapshot:
    """Data from which an observation is computed.

    Attributes:
        step: number of control steps since the start of the episode.
        q, v: (n,) positions, rad or m, and velocities, rad/s or m/s, of all active joints.
        gripper: last gripper command, -1 to 1.
        frames: one image of each camera.
        posed: by camera name, the positions (n,) of all active joints at the time of the camera's image, rad or m.
    """

    step: int
    q: Array
    v: Array
    gripper: float
    frames: tuple[CameraFrame, ...]
    posed: Mapping[str, Array]


class Eyes:
    """Computes observations from images.

    Args:
        cameras: available cameras.
        language: instruction of the task.
        pixels: minimum number of pixels to use of each image.

    Raises:
        InputError: a camera is missing, or the observation spec needs data that no camera provides.
    """

    def __init__(
        self,
        spec: ObservationSpec,
        profile: RobotProfile,
        cameras: tuple[Camera, ...],
        language: str,
        pixels: float = PIXELS,
    ) -> None:
        there = {camera.name: camera for camera in cameras}
        for name in spec.cameras if spec.modalities else ():
            if name not in there:
                wrong = f"there is no camera {name!r}"
                raise InputError(wrong, field="cameras", remedy=f"choose from {', '.join(there)}")
        if not set(spec.modalities) <= {"pointcloud", "depth"}:
            wrong = "the policy uses other data, but the cameras provide only point clouds and depth images"
            raise InputError(wrong, field="modalities")
        used = [there[name] for name in spec.cameras] if spec.modalities else []
        # If the policy uses depth images, the images keep their full resolution.
        whole = "depth" in spec.modalities
        looked = [(camera, 1) if whole else thinned(camera, pixels) for camera in used]
        self._used, self._steps = tuple(camera for camera, _ in looked), tuple(step for _, step in looked)
        self._own = OwnPoints(profile, self._used)
        self._encoder = Encoder(spec, profile, language, self._own.robot)

    def observe(self, sight: SensorSnapshot) -> Observation:
        """Return the observation of a snapshot.

        Raises:
            EmptyCloudError: the point cloud is empty.
        """
        frames = {frame.camera: frame for frame in sight.frames}
        views = []
        for camera, step in zip(self._used, self._steps, strict=True):
            frame, each = frames[camera.name], np.s_[::step, ::step]
            views.append(self._own.picture(camera, frame.depth[each], frame.colors[each], sight.posed[camera.name]))
        return self._encoder.encode(sight.step, sight.q, sight.v, sight.gripper, views)


def inputs(observation: Observation) -> dict[str, npt.NDArray[np.generic]]:
    """Return a dictionary with all arrays of an observation. The arrays are the inputs of a policy."""
    return {name: np.asarray(observation[name]) for name in observation}
