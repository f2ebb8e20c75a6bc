"""What is observed of an episode: arrays from its recorded states. Called in worker processes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from gensim2.errors import GenSim2Error, InputError
from gensim2.objects import Library, ObjectModel, open_library
from gensim2.observations import CloudSettings, EmptyCloudError, PointCloud, View
from gensim2.observations.cloud import to_steps
from gensim2.raycast.observer import Observer
from gensim2.robots import RobotProfile
from gensim2.robots import robot as robot_profile
from gensim2.rollout.recording import Recording
from gensim2.scenes.config import SceneConfig
from gensim2.sim.cameras import PLACES, observation_cameras

Modality = Literal["pointcloud", "rgb", "depth", "segmentation"]
MODALITIES: tuple[Modality, ...] = get_args(Modality)
CAMERAS: tuple[str, ...] = tuple(PLACES)

Arrays = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class Plan:
    """What is to be observed of every episode of a data set.

    Attributes:
        modalities: ``pointcloud``, ``depth`` and ``segmentation`` by ray casting, ``rgb`` by the renderer.
        cameras: names of those that are used, in the environment's order.
        cloud: how point clouds are made; its noise is on depth pictures, too.
    """

    modalities: tuple[Modality, ...] = ("pointcloud",)
    cameras: tuple[str, ...] = CAMERAS
    cloud: CloudSettings = field(default_factory=CloudSettings)

    def __post_init__(self) -> None:
        for name, given, known in (("modalities", self.modalities, MODALITIES), ("cameras", self.cameras, CAMERAS)):
            unknown = [word for word in given if word not in known]
            if unknown or not given or len(set(given)) < len(given):
                message = f"must be some of {', '.join(known)}, each once, is {', '.join(given) or 'nothing'}"
                raise InputError(message, field=name)

    @property
    def casts(self) -> bool:
        """Whether any of it comes from rays."""
        return bool({"pointcloud", "depth", "segmentation"} & set(self.modalities))

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON; in the order of :data:`MODALITIES` and of the cameras, however they were named."""
        return {
            "modalities": [word for word in MODALITIES if word in self.modalities],
            "cameras": [word for word in CAMERAS if word in self.cameras],
            "cloud": self.cloud.to_dict(),
        }


def observe(recording: Recording, scene: SceneConfig, plan: Plan) -> Arrays:
    """Everything that the plan asks for, (T + 1, ...) an array; states of T steps, and the one before the first.

    Raises:
        InputError: an object's files cannot be used, or there is no renderer for ``rgb``.
        EmptyCloudError: the cameras see nothing of the workspace at some instant; it says at which.
    """
    profile = robot_profile(scene.robot)
    cameras = tuple(camera for camera in observation_cameras(profile) if camera.name in plan.cameras)
    observer = Observer(profile, _objects(scene, recording.instances), plan.cloud, recording.seed, cameras)
    arrays: Arrays = {}
    for camera in cameras:
        arrays[f"cameras/{camera.name}/intrinsic"] = camera.intrinsic
        arrays[f"cameras/{camera.name}/T_base_camera"] = camera.T_base_camera
    arrays |= _proprioception(recording, observer, profile)
    if plan.casts:
        arrays |= _cast(recording, observer, plan)
    if "rgb" in plan.modalities:
        arrays |= _photographed(recording, scene, plan)
    return arrays


def _proprioception(recording: Recording, observer: Observer, profile: RobotProfile) -> Arrays:
    rows = np.asarray(recording.env_states["articulations"][profile.agent], dtype=np.float32)
    size = (rows.shape[1] - 13) // 2
    return {
        "proprioception/qpos": rows[:, 13 : 13 + size],
        "proprioception/qvel": rows[:, 13 + size :],
        "proprioception/tool_pose": observer.scene.tool_poses(recording.env_states),
    }


def _cast(recording: Recording, observer: Observer, plan: Plan) -> Arrays:
    frames: dict[str, list[npt.NDArray[Any]]] = {}
    for step, poses in enumerate(observer.poses(recording.env_states)):
        views = observer.views(poses, step)
        if "pointcloud" in plan.modalities:
            try:
                cloud = observer.cloud(views)
            except EmptyCloudError as error:
                raise EmptyCloudError(f"step {step}: {error}") from error
            _append(frames, _stored_cloud(cloud))
        for view in views:
            _append(frames, _stored_view(view, plan))
    return {name: np.stack(rows) for name, rows in frames.items()}


def _append(frames: dict[str, list[npt.NDArray[Any]]], arrays: Arrays) -> None:
    for name, array in arrays.items():
        frames.setdefault(name, []).append(array)


def _stored_cloud(cloud: PointCloud) -> Arrays:
    assert cloud.segmentation is not None
    return {
        "pointcloud/xyz": to_steps(cloud.xyz),
        "pointcloud/rgb": cloud.rgb,
        "pointcloud/segmentation": cloud.segmentation,
    }


def _stored_view(view: View, plan: Plan) -> Arrays:
    found: Arrays = {}
    if "depth" in plan.modalities:
        found[f"cameras/{view.camera.name}/depth"] = np.rint(1000.0 * view.depth).astype(np.uint16)
    if "segmentation" in plan.modalities:
        assert view.segmentation is not None
        found[f"cameras/{view.camera.name}/segmentation"] = view.segmentation
    return found


def _photographed(recording: Recording, scene: SceneConfig, plan: Plan) -> Arrays:
    pictures = _pictures(scene)
    pictures.show(recording.instances, recording.seed, recording.reset_options)
    frames: dict[str, list[npt.NDArray[Any]]] = {}
    for step in range(recording.steps + 1):
        images = pictures.at(recording.env_states, step)
        _append(frames, {f"cameras/{name}/rgb": images[name]["rgb"] for name in plan.cameras})
    return {name: np.stack(rows) for name, rows in frames.items()}


@lru_cache(maxsize=2)
def _library(assets: str) -> Library:
    return open_library(assets)


@lru_cache(maxsize=1)  # 2 GB each
def _pictures(scene: SceneConfig) -> Any:
    from gensim2.sim.pictures import StatePictures

    return StatePictures(scene)


def _objects(scene: SceneConfig, instances: Mapping[str, str]) -> dict[str, ObjectModel]:
    library = _library(scene.assets)
    found: dict[str, ObjectModel] = {}
    for name, spec in scene.task.objects.items():
        if name not in instances:
            raise GenSim2Error(f"the recording does not say which {name} it was made with")
        found[name] = library.load(spec.asset_class, instances[name])
    return found
