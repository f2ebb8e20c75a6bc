"""Draw videos of recorded episodes by ray casting, next to the point cloud that the controller observes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.core.files import replacing
from gensim2.data.close_up import CloseUp, titled
from gensim2.data.episode_file import read_episode
from gensim2.data.observing import objects_of
from gensim2.data.video import write_video
from gensim2.perception import Camera, EmptyCloudError, ObservationSpec
from gensim2.perception.raycast.drawing import shaded
from gensim2.perception.raycast.kinematics import state_at
from gensim2.perception.raycast.observer import Observer
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.robots import OPEN, RobotProfile, robot
from gensim2.rollout import worker
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import Recording
from gensim2.scenes.config import SceneConfig
from gensim2.tasks.strategies import Strategies

Frame = npt.NDArray[np.uint8]

SIZE = 384
"""Width and height of the scene's image and of the point cloud's image, pixels."""
FRAMES_PER_SECOND = 10
EYE, TARGET = (-0.45, -1.15, 0.75), (-0.13, -0.07, 0.2)
"""Position of the camera, and the point it looks at (world frame, m); most open doors show their inside to it."""
FIELD_OF_VIEW = float(np.deg2rad(40))
PAPER = (24, 26, 30)
DOT = 2
"""Half the width of the square that represents a point, pixels."""


PICTURE_ALONE = ObservationSpec(modalities=())
"""Observation spec for a video that shows no point cloud."""


def film_again(config: EpisodeConfig, strategies: Strategies, seed: int, video: Path) -> Episode:
    """Run an episode again and record a video, even if the episode fails. Worker processes call this function.

    Args:
        strategies: strategies of its task by name, as plain data.
        seed: seed of the episode.
        video: file to write, atomically; not written if the arm never moves.

    Returns:
        The record of the episode.
    """

    def keep(found: Episode, recording: Recording | None) -> Episode:
        if recording is not None and found.control_steps:
            film_recording(recording, config.scene, PICTURE_ALONE, video)
        return found

    return worker.record(config, strategies, seed, keep)


def film_path(folder: Path, index: int) -> Path:
    """Return the path of an episode's video in its task's folder."""
    return folder / f"video_{index:06d}.mp4"


def film_index(film: Path) -> int:
    """Return the episode's index from a video path made by :func:`film_path`."""
    return int(film.stem.removeprefix("video_"))


def film_episode(episode: Path, scene: SceneConfig, spec: ObservationSpec, video: Path) -> int:
    """Record a video of an episode in a worker process and return the number of frames.

    Frames are ray-cast, so they need neither the simulator's renderer nor a graphics driver. A simulated second has ten
    frames.

    Args:
        episode: file of the episode, with states.
        spec: observation spec of the controller; its point cloud is shown next to the image.
        video: file to write, atomically.

    Raises:
        InputError: the file is damaged or has no states, or an object's files cannot be used.
    """
    recording = read_episode(episode).recording
    if recording is None:
        raise InputError("has no states", file=episode)
    return film_recording(recording, scene, spec, video)


def film_recording(recording: Recording, scene: SceneConfig, spec: ObservationSpec, video: Path) -> int:
    """Record a video like :func:`film_episode`, but from states in memory."""
    profile = robot(scene.robot)
    stride = max(1, round(profile.control_hz / FRAMES_PER_SECOND))
    frames = list(_frames(recording, scene, profile, spec, stride))
    with replacing(video) as path:
        write_video(path, frames, profile.control_hz / stride)
    return len(frames)


def _frames(
    recording: Recording, scene: SceneConfig, profile: RobotProfile, spec: ObservationSpec, stride: int
) -> Iterator[Frame]:
    objects = objects_of(scene, recording.instances)
    camera = film_camera(profile)
    solid, close_up = RaycastScene(profile, objects, [camera]), CloseUp(profile, objects, SIZE)
    sees = "pointcloud" in spec.modalities
    observer = Observer(profile, objects, spec, recording.seed, scene.task.description) if sees else None
    poses = solid.poses(recording.env_states)
    commands = [OPEN, *map(float, recording.actions[:, -1])]
    last = len(commands) - 1
    for step in sorted({*range(0, last + 1, stride), last}):
        states = state_at(recording.env_states, step)
        picture = close_up.onto(shaded(solid.see(poses[step])[0]), states)
        if observer is None:
            yield titled(picture, "camera")
            continue
        try:
            cloud = observer.observe(states, step, commands[step]).cloud
        except EmptyCloudError:
            cloud = None
        points = np.zeros((0, 3)) if cloud is None else cloud.xyz
        colours = np.zeros((0, 3), np.uint8) if cloud is None else cloud.rgb
        shown = titled(picture, "camera"), titled(dotted(points, colours, camera), "point cloud of the controller")
        yield np.concatenate(shown, axis=1)


def film_camera(profile: RobotProfile) -> Camera:
    """Return the camera for videos of a robot and its workspace."""
    turn, base = profile.T_world_base[:3, :3].T, np.array(profile.base_position)
    place, target = turn @ (EYE - base), turn @ (TARGET - base)
    return Camera.looking("film", place, target, width=SIZE, height=SIZE, fov=FIELD_OF_VIEW)


def dotted(points: npt.NDArray[Any], colours: npt.NDArray[np.uint8], camera: Camera) -> Frame:
    """Draw points (N, 3), metres in the base frame, into an image (H, W, 3) as coloured squares.

    Near points cover far ones.
    """
    picture = np.empty((camera.height, camera.width, 3), np.uint8)
    picture[:] = PAPER
    seen = np.c_[points, np.ones(len(points))] @ camera.projection.T
    order = np.argsort(-seen[:, 2])
    seen, colours = seen[order], colours[order]
    ahead = seen[:, 2] > 0
    pixels = np.floor(seen[ahead, :2] / seen[ahead, 2:]).astype(np.int64)
    # Brighten the colours, because dark points would be invisible on the dark background.
    shown = (96 + 0.62 * colours[ahead]).astype(np.uint8)
    for (column, row), colour in zip(pixels, shown, strict=True):
        if 0 <= column < camera.width and 0 <= row < camera.height:
            picture[max(row - DOT + 1, 0) : row + DOT, max(column - DOT + 1, 0) : column + DOT] = colour
    return picture
