"""Render videos and images of recorded episodes.

If SAPIEN simulated the episode and its renderer works, the actions are replayed in SAPIEN and rendered. Otherwise
MuJoCo's renderer or the ray caster draws the recorded states; :func:`~gensim2.sim.driver.renderer` selects it.
"""

from __future__ import annotations

import contextlib
import errno
import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt
from PIL import Image
from pydantic import BaseModel, ConfigDict

from gensim2.core.errors import InputError
from gensim2.core.files import replacing
from gensim2.core.foreign.hdf5 import ForeignHdf5Error, array_in, group_in
from gensim2.core.foreign.library import read_by_library
from gensim2.core.foreign.tree import open_regular
from gensim2.core.record_files import read_record
from gensim2.data.episode_file import STATES_DEPTH, read_tree
from gensim2.data.trajectory import JSON_NAME, env_kwargs
from gensim2.robots import robot
from gensim2.rollout.recording import Recording
from gensim2.rollout.world import Tree
from gensim2.scenes.config import SceneConfig, SceneOptions
from gensim2.scenes.reset_options import RESET_OPTIONS, read_options
from gensim2.sim.driver import renderer
from gensim2.tasks.parse import parse_task

Frame = npt.NDArray[np.uint8]

LONG = 200
"""Number of steps above which a video shows every second step only, because a frame takes 0.25 s without a GPU."""


class _Arguments(BaseModel):
    model_config = ConfigDict(strict=True, extra="allow")

    assets: str
    instances: dict[str, list[str]]


class _Environment(BaseModel):
    env_kwargs: _Arguments


class _Origin(BaseModel):
    task: dict[str, Any]


class _Reset(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid")

    seed: int
    options: dict[str, Any]


class _Entry(BaseModel):
    model_config = ConfigDict(strict=True)

    episode_id: int
    reset_kwargs: _Reset


class _Trajectory(BaseModel):
    env_info: _Environment
    gensim2: _Origin
    episodes: list[_Entry]


@dataclass(frozen=True)
class Replay:
    """Everything that determines the states of an episode.

    Attributes:
        env_id, env_kwargs: environment, for ``gymnasium.make``.
        reset_kwargs: seed and options of the reset.
        actions: (T, m + 1) actions of T control steps; m is the number of arm joints.
        scene: configuration of the environment.
        states: recorded states (T + 1, ...) in the form of ManiSkill's ``env_states``. None if SAPIEN replays the
            actions.
    """

    env_id: str
    env_kwargs: Mapping[str, Any]
    reset_kwargs: Mapping[str, Any]
    actions: npt.NDArray[np.float32]
    scene: SceneConfig
    states: Tree | None = None

    @property
    def control_hz(self) -> int:
        """Number of actions per second."""
        return robot(self.scene.robot).control_hz

    @staticmethod
    def stored(trajectory: Path, episode: int = 0) -> Replay:
        """Read the replay of an episode from ``trajectory.h5`` and the JSON file in the same folder.

        The environment comes from the task in the file. The id in the file is not used, because it would import a
        module.

        Raises:
            InputError: the file or the episode is missing or cannot be used.
        """
        from gensim2.sim.registration import env_id

        path = (
            trajectory.with_name(JSON_NAME) if trajectory.name == "trajectory.h5" else trajectory.with_suffix(".json")
        )
        document = read_record(path, _Trajectory, "record the episodes again")
        found = next((entry for entry in document.episodes if entry.episode_id == episode), None)
        if found is None:
            raise InputError(f"there is no episode {episode}", file=path, field="episodes")
        reset = found.reset_kwargs
        # Other reset options of ManiSkill in an untrusted file could set any state of the simulation.
        if unknown := reset.options.keys() - RESET_OPTIONS:
            raise InputError(f"the option {min(unknown)!r:.80} is unknown", file=path, field="reset_kwargs")
        told, task = document.env_info.env_kwargs, parse_task(document.gensim2.task, str(path))
        try:
            read_options(reset.options, tuple(task.objects))
        except InputError as error:
            raise InputError(str(error), file=path, field="reset_kwargs") from error
        options = SceneOptions.from_record(told.model_dump())
        kwargs = env_kwargs(task, told.assets, told.instances, options.environment)
        with (
            read_by_library(trajectory, "record the episodes again"),
            open_regular(trajectory) as stream,
            h5py.File(stream, "r") as file,
        ):
            group = group_in(file, f"traj_{episode}")
            actions = array_in(group, "actions", np.float32, (None, None))
            states = None
            if renderer(options.engine).name != "sapien":
                states = read_tree(group_in(group, "env_states"), STATES_DEPTH)
                _check_states(states, len(actions) + 1)
        return Replay(env_id(task), kwargs, reset.model_dump(), actions, options.with_task(task), states)

    @staticmethod
    def of(recording: Recording, scene: SceneConfig) -> Replay:
        """Return the replay of a recording that was made in ``scene``."""
        from gensim2.sim.registration import env_id

        chosen = {name: [each] for name, each in recording.instances.items()}
        kwargs = env_kwargs(scene.task, scene.assets, chosen, scene.environment)
        reset = {"seed": recording.seed, "options": recording.reset_options}
        return Replay(env_id(scene.task), kwargs, reset, recording.actions, scene, recording.env_states)


def _check_states(states: Tree, rows: int) -> None:
    """Check that every array of states has ``rows`` rows."""
    for kind, group in states.items():
        if not isinstance(group, dict):
            raise ForeignHdf5Error(f"env_states/{kind} is not a group")
        for name, values in group.items():
            if values.ndim != 2 or len(values) != rows:
                needed = f"must have two dimensions and {rows} rows"
                raise ForeignHdf5Error(f"env_states/{kind}/{name} {needed}, but has the shape {values.shape}")


@dataclass(frozen=True)
class Film:
    """Result of recording a video.

    Attributes:
        success: whether the goal was reached at the end of the replay; None if the video shows recorded states.
        renderer: sentence that says which renderer drew the frames, and why.
    """

    frames: int
    success: bool | None
    renderer: str


def film(replay: Replay, video: Path, *, still: Path | None = None, stride: int | None = None, speed: int = 1) -> Film:
    """Record an episode as an mp4 video of 640 x 480 pixels with H.264, which browsers can play.

    SAPIEN's renderer needs 2.2 GB of memory and 10 s for its first frame, so call this function in a worker process.

    Args:
        video: file to write, atomically.
        still: image file for the moment when a keypoint is farthest from its start; its suffix determines the format.
            None: no image.
        stride: number of control steps between two frames. None: 1 for short episodes and 2 for long ones.
        speed: playback speed. 1 plays in real time, and 2 plays twice as fast.
    """
    shown = _Shown()
    chosen = renderer(replay.scene.engine)
    frames = _frames if chosen.name == "sapien" else _drawn
    stride = stride or (1 if len(replay.actions) <= LONG else 2)
    with replacing(video) as path:
        write_video(path, frames(replay, shown, stride), speed * replay.control_hz / stride)
    if still is not None:
        assert shown.farthest is not None
        with replacing(still) as path:
            Image.fromarray(shown.farthest).save(path)
    return Film(shown.frames, shown.success, chosen.reason)


class _Shown:
    """Summary of the frames of a video, with the still image. All frames together would need too much memory."""

    def __init__(self) -> None:
        self.frames = 0
        self.success: bool | None = None
        self.farthest: Frame | None = None
        self._start: npt.NDArray[np.float64] | None = None
        self._distance = -1.0

    def add(self, frame: Frame, keypoints: npt.NDArray[np.float64], success: bool | None) -> None:
        if self._start is None:
            self._start = keypoints
        distance = float(np.linalg.norm(keypoints - self._start, axis=1).max())
        if distance > self._distance:
            self._distance, self.farthest = distance, frame
        self.frames += 1
        self.success = success


def _frames(replay: Replay, shown: _Shown, stride: int) -> Iterator[Frame]:
    import gymnasium as gym

    from gensim2.data.close_up import CloseUp  # import late, because this module loads the ray caster
    from gensim2.sim import rendering

    env = gym.make(replay.env_id, **{**replay.env_kwargs, "obs_mode": "none", "render_mode": "rgb_array"})

    world: Any = env.unwrapped

    def see(outcome: dict[str, Any]) -> Frame:
        frame = np.asarray(env.render()[0].cpu().numpy(), dtype=np.uint8)  # type: ignore[index, union-attr]
        states = {
            kind: {name: row.cpu().numpy() for name, row in group.items()}
            for kind, group in world.get_state_dict().items()
        }
        frame = close_up.onto(frame, states)
        keypoints = world.measure().keypoints.values()
        points = [point for own in keypoints for point in own.values()]
        shown.add(frame, np.stack(points), bool(outcome["success"][0]))
        return frame

    try:
        outcome = env.reset(**replay.reset_kwargs)[1]
        models = {name: thing.model for name, thing in world.initial_state.objects.items()}
        close_up = CloseUp(world.profile, models, rendering.video_camera().height)
        yield see(outcome)
        for number, action in enumerate(replay.actions, 1):
            outcome = env.step(action)[4]
            if number % stride and number != len(replay.actions):
                continue
            yield see(outcome)
    finally:
        env.close()


def _drawn(replay: Replay, shown: _Shown, stride: int) -> Iterator[Frame]:
    """Draw the recorded states with MuJoCo's renderer or the ray caster."""
    # Import late: this module imports the ray caster, which other videos do not need.
    from gensim2.data.close_up import CloseUp
    from gensim2.data.observing import objects_of
    from gensim2.perception.raycast.kinematics import state_at
    from gensim2.perception.raycast.state_drawing import VIDEO_HEIGHT
    from gensim2.sim.drawing import state_drawing

    states = replay.states
    assert states is not None
    given = read_options(replay.reset_kwargs["options"], tuple(replay.scene.task.objects))
    objects = objects_of(replay.scene, {name: own["instance"] for name, own in given.items() if "instance" in own})
    profile = robot(replay.scene.robot)
    drawing, close_up = state_drawing(replay.scene.engine, profile, objects), CloseUp(profile, objects, VIDEO_HEIGHT)
    keypoints = drawing.keypoints(states)
    try:
        for number in range(len(replay.actions) + 1):
            if number % stride and number != len(replay.actions):
                continue
            state = state_at(states, number)
            frame = close_up.onto(drawing.of(state), state)
            shown.add(frame, keypoints[number], None)
            yield frame
    finally:
        drawing.close()


def write_video(path: Path, frames: Iterable[Frame], frames_per_second: float, *, exact: bool = False) -> None:
    """Write frames as an H.264 mp4 and check that the encoder finished.

    Args:
        frames: at least one image (H, W, 3); all images have the same size.
        frames_per_second: frame rate of the video.
        exact: whether to store a video for programs. Such a video keeps the frame size (see :func:`pixel_format`) and
            has a key frame every second frame. By default, sides are scaled to multiples of 16, which all browsers can
            play.

    Raises:
        OSError: the encoder ended early, for example because the disk was full.
    """
    import imageio_ffmpeg

    rest = iter(frames)
    first = next(rest)
    height, width = first.shape[:2]
    shape: dict[str, Any] = {"macro_block_size": 1, "output_params": ["-g", "2"]}
    if not exact:  # with "faststart", browsers can play a video while it loads
        shape = {"quality": 7, "output_params": ["-movflags", "+faststart"]}
    shape |= {"codec": "libx264", "pix_fmt_out": pixel_format(height, width) if exact else "yuv420p"}
    writer = imageio_ffmpeg.write_frames(
        str(path), (width, height), fps=frames_per_second, ffmpeg_log_level="quiet", **shape
    )
    count = 0
    with contextlib.closing(writer):
        writer.send(None)
        for frame in itertools.chain([first], rest):
            try:
                writer.send(np.ascontiguousarray(frame))
            except OSError as error:
                raise OSError(errno.EIO, _ENDED_EARLY) from error
            count += 1
    try:  # imageio_ffmpeg does not check the encoder's exit status, so count the frames in the file
        found = imageio_ffmpeg.count_frames_and_secs(str(path))[0]
    except RuntimeError as error:
        raise OSError(errno.EIO, _ENDED_EARLY) from error
    if found != count:
        raise OSError(errno.EIO, _ENDED_EARLY)


def pixel_format(height: int, width: int) -> str:
    """Return a pixel format for this frame size: yuv420p, or a format that allows odd sides."""
    return "yuv420p" if height % 2 == 0 and width % 2 == 0 else "yuv444p"


_ENDED_EARLY = "the video encoder ended early"
