"""Pictures and joints to what a controller sees: the same function on the robot and in a replay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.perception import Camera, Encoder, Observation, ObservationSpec
from gensim2.robots import RobotProfile
from gensim2_robot.devices import Array, Frame
from gensim2_robot.own_points import OwnPoints

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
class Sight:
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
    frames: tuple[Frame, ...]
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

    def observe(self, sight: Sight) -> Observation:
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
