"""Compute the observations of an episode from its recorded states, in worker processes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error
from gensim2.data.formats.columns import IDS, RGB, STORED, XYZ, array_of, camera_array
from gensim2.objects import Library, ObjectModel, open_library
from gensim2.perception import Observation, ObservationSpec
from gensim2.perception.cloud import to_steps
from gensim2.perception.raycast.observer import Observer, Photograph
from gensim2.robots import robot as robot_profile
from gensim2.rollout.recording import Recording
from gensim2.scenes.config import SceneConfig

Arrays = dict[str, npt.NDArray[Any]]


def observe(recording: Recording, scene: SceneConfig, spec: ObservationSpec) -> Arrays:
    """Compute the observations (T + 1, ...) of all recorded states of an episode of T steps.

    Raises:
        InputError: an object's files cannot be used, or ``rgb`` needs a renderer that is missing.
        EmptyCloudError: a point cloud has no point in the workspace; the message gives the time of the state.
    """
    observer = _observer(recording, scene, spec)
    frames: dict[str, list[npt.NDArray[Any]]] = {}
    for observation in observer.recorded(recording.env_states, recording.actions):
        for name, array in _stored(observation).items():
            frames.setdefault(name, []).append(array)
        for camera in observer.cameras_at(observation.joint_positions):
            if camera.link is not None:
                frames.setdefault(camera_array(camera.name, "T_base_camera"), []).append(camera.T_base_camera)
    arrays: Arrays = {name: np.stack(rows) for name, rows in frames.items()}
    for camera in observer.cameras:
        arrays[camera_array(camera.name, "intrinsic")] = camera.intrinsic
        what = "T_base_camera" if camera.link is None else "T_link_camera"
        arrays[camera_array(camera.name, what)] = camera.T_base_camera
    return arrays


def segmentation_ids(recording: Recording, scene: SceneConfig, spec: ObservationSpec) -> dict[str, list[str]]:
    """Return the owner and the link for each segmentation id. The owner is an object's name, the robot or ``table``.

    Keys are strings for JSON. The result is empty if the spec has no cloud, depth image or segmentation image.

    Raises:
        InputError: an object's files cannot be used.
    """
    if not (spec.casts or spec.is_privileged):
        return {}
    names = _observer(recording, scene, ObservationSpec(("segmentation",), spec.cameras)).scene.names
    return {str(id): [owner, link] for id, (owner, link) in names.items()}


def _observer(recording: Recording, scene: SceneConfig, spec: ObservationSpec) -> Observer:
    return Observer(
        robot_profile(scene.robot),
        objects_of(scene, recording.instances),
        spec,
        recording.seed,
        scene.task.description,
        _photograph(recording, scene) if "rgb" in spec.modalities else None,
    )


def _stored(observation: Observation) -> Arrays:
    """Return the arrays of one observation, keyed by their names in an observation file."""
    found: Arrays = {array: observation[column] for column, array in STORED.items()}
    if observation.cloud is not None:
        assert observation.cloud.segmentation is not None
        found[XYZ] = to_steps(observation.cloud.xyz)
        found[RGB] = observation.cloud.rgb
        found[IDS] = observation.cloud.segmentation
    for name, array in observation.arrays.items():
        if (stored := array_of(name)) is not None:
            found[stored] = array
    return found


def _photograph(recording: Recording, scene: SceneConfig) -> Photograph:
    pictures = _pictures(scene)
    pictures.show(recording.instances, recording.seed, recording.reset_options)
    colors: Photograph = pictures.colors
    return colors


@lru_cache(maxsize=2)
def _library(assets: str) -> Library:
    return open_library(assets)


@lru_cache(maxsize=1)  # only one renderer is cached, because each needs 2 GB
def _pictures(scene: SceneConfig) -> Any:
    from gensim2.sim.pictures import StatePictures

    return StatePictures(scene)


def objects_of(scene: SceneConfig, instances: Mapping[str, str]) -> dict[str, ObjectModel]:
    """Return the objects of a scene by name, given the ids of their instances.

    Raises:
        InputError: an object's files cannot be used.
    """
    library = _library(scene.assets)
    found: dict[str, ObjectModel] = {}
    for name, spec in scene.task.objects.items():
        if name not in instances:
            raise GenSim2Error(f"the recording does not name the instance of {name}")
        found[name] = library.load(spec.asset_class, instances[name])
    return found
