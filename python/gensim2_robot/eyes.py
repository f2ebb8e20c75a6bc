"""Pictures and joints to what a controller sees: the same function on the robot and in a replay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error, InputError
from gensim2.perception import Camera, Encoder, Observation, ObservationSpec, Picture, RobotSegments
from gensim2.perception.raycast.caster import Caster, CastSolid
from gensim2.perception.raycast.kinematics import Tree, read_urdf
from gensim2.perception.raycast.shapes import read_links
from gensim2.robots import RobotProfile
from gensim2_robot.devices import Array, CameraFrame

NEAR = 0.02
"""Metres by which a measured depth may lie off the robot's own and still show it."""

THROUGH = 0.05
"""Metres behind the robot's surface from which on a camera that is where it is said to be cannot measure."""
THROUGH_SHARE = 0.3
"""Share of the pixels on the robot that measure behind it, from which on the camera is elsewhere."""
THROUGH_PIXELS = 1.0 / 400.0
"""Share of a picture that the robot must cover to tell."""


class CameraPoseError(GenSim2Error):
    """A camera does not see the robot where its posed meshes are: another camera, or one that was moved."""


class OwnPoints:
    """The robot's meshes in the eyes of its cameras.

    Args:
        profile: of the robot.
        cameras: that look; those that a link carries with their poses in its frame.
        near: metres by which a depth may lie off that of the meshes.

    Attributes:
        robot: ids of the hand with all that hangs on it, and of the rest.
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
        # A picture's depth is corrected here once: whoever has its camera must not correct it again.
        self._seen = {camera.name: replace(camera, depth_scale=1.0, depth_bias=0.0) for camera in self._cameras}
        self._casters = {camera.name: Caster(solids, [camera]) for camera in self._cameras}
        rest = self._tree.poses(np.eye(4)[None], np.array(profile.reset_qpos)[None])[0][self._shown]
        for caster in self._casters.values():
            caster.cast(rest)  # the first rays take long: a picture would wait for them
        hanging = {profile.hand_link}
        for name, parent in zip(self._tree.names, self._tree.parents, strict=True):
            if parent >= 0 and self._tree.names[parent] in hanging:
                hanging.add(name)
        hand = frozenset(number + 1 for number, name in enumerate(self._tree.names) if name in hanging)
        self.robot = RobotSegments(hand, frozenset(range(1, len(self._tree.names) + 1)) - hand)

    def placed(self, camera: Camera, q: Array) -> Camera:
        """A camera in the base frame, where the (n,) joints stand at ``q``."""
        if camera.link is None:
            return camera
        T_base_link = self._profile.model.forward_kinematics(q, camera.link)
        return replace(camera, T_base_camera=T_base_link @ camera.T_base_camera)

    def picture(
        self, camera: Camera, depth: npt.NDArray[np.uint16], colors: npt.NDArray[np.uint8] | None, q: Array
    ) -> Picture:
        """Mark the robot in a picture; its depth is in corrected metres, and its camera corrects none.

        Args:
            camera: that took it, as it was given.
            depth: (H, W) mm.
            colors: (H, W, 3); None: there are none.
            q: (n,) all active joints when it was taken.

        Raises:
            CameraPoseError: the picture goes through the robot, so that it is not of this camera.
        """
        metres = camera.metres(depth)
        poses = self._tree.poses(np.eye(4)[None], q[None])[0][self._shown]
        if camera.link is not None:
            T_base_link = self._profile.model.forward_kinematics(q, camera.link)
            poses = np.linalg.inv(T_base_link) @ poses
        caster = self._casters[camera.name]
        hits = caster.cast(poses)
        own = caster.segmentation(hits.face[0])
        _require_robot(camera, metres, hits.depth[0], own)
        seen = self.placed(self._seen[camera.name], q)
        return Picture(seen, metres, _marked(metres, hits.depth[0], own, self._near), colors)


def _require_robot(
    camera: Camera, depth: npt.NDArray[np.float32], meshes: npt.NDArray[np.float32], ids: npt.NDArray[np.int16]
) -> None:
    """Refuse a picture that measures behind the robot where the robot is; what stands before it may hide it."""
    covered = (ids > 0) & (depth > 0)
    count = int(covered.sum())
    if count < THROUGH_PIXELS * depth.size:
        return
    through = int((covered & (depth - meshes > THROUGH)).sum())
    if through > THROUGH_SHARE * count:
        raise CameraPoseError(
            f"camera {camera.name}: {100 * through // count} % of its view of the robot goes through it: "
            "another camera, or one that was moved"
        )


def _marked(
    depth: npt.NDArray[np.float32], meshes: npt.NDArray[np.float32], ids: npt.NDArray[np.int16], near: float
) -> npt.NDArray[np.int16]:
    """Ids of pixels whose depth is that of the meshes there, or in a pixel beside: stereo makes edges fat."""
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
"""Pixels of a picture that are looked at, at least: a cloud is drawn of a few thousand of them."""


def thinned(camera: Camera, pixels: float = PIXELS) -> tuple[Camera, int]:
    """A camera that has each n-th pixel of a larger one's rows and columns, and n; no fewer pixels than asked for."""
    step = max(1, int((camera.width * camera.height / pixels) ** 0.5))
    if step == 1:
        return camera, 1
    intrinsic = camera.intrinsic.copy()
    intrinsic[:2] /= step
    intrinsic[:2, 2] += 0.5 - 0.5 / step  # pixel centres lie at .5
    width, height = -(-camera.width // step), -(-camera.height // step)
    return replace(camera, width=width, height=height, intrinsic=intrinsic), step


@dataclass(frozen=True, eq=False)
class SensorSnapshot:
    """All that an observation follows from.

    Attributes:
        step: control steps since the episode began.
        q, v: (n,) all active joints, rad and m; a second.
        gripper: its last command, -1 to 1.
        frames: one of each camera.
        posed: (n,) joints when each of them was taken, by camera.
    """

    step: int
    q: Array
    v: Array
    gripper: float
    frames: tuple[CameraFrame, ...]
    posed: Mapping[str, Array]


class Eyes:
    """Makes observations.

    Args:
        spec: what is looked at.
        profile: of the robot.
        cameras: that there are.
        language: what is to be done.
        pixels: that are looked at of each picture, at least.

    Raises:
        InputError: a camera of the spec is not there, or it asks for what no camera gives.
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
                raise InputError(f"there is no camera {name!r}", field="cameras", remedy=f"some of {', '.join(there)}")
        if not set(spec.modalities) <= {"pointcloud", "depth"}:
            raise InputError("cameras give point clouds and depth", field="modalities")
        used = [there[name] for name in spec.cameras] if spec.modalities else []
        # Depth is asked for in the size in which it was taken.
        whole = "depth" in spec.modalities
        looked = [(camera, 1) if whole else thinned(camera, pixels) for camera in used]
        self._used, self._steps = tuple(camera for camera, _ in looked), tuple(step for _, step in looked)
        self._own = OwnPoints(profile, self._used)
        self._encoder = Encoder(spec, profile, language, self._own.robot)

    def observe(self, sight: SensorSnapshot) -> Observation:
        """Observe the present instant.

        Raises:
            EmptyCloudError: the cameras see nothing that a point cloud keeps.
        """
        frames = {frame.camera: frame for frame in sight.frames}
        views = []
        for camera, step in zip(self._used, self._steps, strict=True):
            frame, each = frames[camera.name], np.s_[::step, ::step]
            views.append(self._own.picture(camera, frame.depth[each], frame.colors[each], sight.posed[camera.name]))
        return self._encoder.encode(sight.step, sight.q, sight.v, sight.gripper, views)


def inputs(observation: Observation) -> dict[str, npt.NDArray[np.generic]]:
    """All arrays of an observation, by name: what a policy is given."""
    return {name: np.asarray(observation[name]) for name in observation}
