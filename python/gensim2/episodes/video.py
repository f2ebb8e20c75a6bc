"""Pictures of recorded episodes: the actions are replayed in a rendering environment. Physics came first."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import imageio.v2 as imageio
import numpy as np
import numpy.typing as npt

from gensim2.episodes.trajectory import JSON_NAME
from gensim2.errors import GenSim2Error, InputError
from gensim2.files import replacing

Frame = npt.NDArray[np.uint8]

FRAMES_PER_SECOND = 20
"""The control frequency: a video runs in real time."""

LONG = 200
"""Control steps beyond which every second one is shown: a picture without a GPU takes a quarter of a second."""


@dataclass(frozen=True)
class Film:
    """What filming an episode gave.

    Attributes:
        frames: number of frames in the video.
        success: the task's criteria held at the end of the replay.
    """

    frames: int
    success: bool


def film(trajectory: Path, video: Path, *, episode: int = 0, still: Path | None = None) -> Film:
    """Replay one episode of ``trajectory.h5`` and write it as an mp4: H.264, 640 x 480, 20 frames a second or 10.

    Needs 2.2 GB of memory and, once a process, 10 s for shaders: run it in a worker process.

    Args:
        trajectory: the h5 file; its JSON file lies beside it.
        video: file to write, atomically.
        episode: number in the file.
        still: also write a PNG of the moment when a keypoint of an object is farthest from where it began.

    Raises:
        InputError: the file or the episode is not there.
        GenSim2Error: no Vulkan driver works on this machine.
    """
    from gensim2.sim import rendering

    if not rendering.can_render():
        raise GenSim2Error(rendering.NO_DRIVER)
    info, entry = _entry(trajectory, episode)
    with h5py.File(trajectory, "r") as file:
        actions = file[f"traj_{episode}"]["actions"][:]
    shown = _Shown()
    stride = 1 if len(actions) <= LONG else 2
    with replacing(video) as path:
        _write_video(path, _replay(info, entry, actions, shown, stride), FRAMES_PER_SECOND // stride)
    if still is not None:
        with replacing(still) as path:
            imageio.imwrite(path, shown.farthest)
    return Film(shown.frames, shown.success)


class _Shown:
    """What is kept of a replay besides the video: frames themselves are not, 200 of them are 180 MB."""

    def __init__(self) -> None:
        self.frames = 0
        self.success = False
        self.farthest: Frame | None = None
        self._start: npt.NDArray[np.float64] | None = None
        self._distance = -1.0

    def add(self, frame: Frame, keypoints: npt.NDArray[np.float64], success: bool) -> None:
        if self._start is None:
            self._start = keypoints
        distance = float(np.linalg.norm(keypoints - self._start, axis=1).max())
        if distance > self._distance:
            self._distance, self.farthest = distance, frame
        self.frames += 1
        self.success = success


def _entry(trajectory: Path, episode: int) -> tuple[dict[str, Any], dict[str, Any]]:
    path = trajectory.with_name(JSON_NAME) if trajectory.name == "trajectory.h5" else trajectory.with_suffix(".json")
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror}", file=path) from error
    except json.JSONDecodeError as error:
        raise InputError(f"is not valid JSON: {error.msg}", file=path, field=f"line {error.lineno}") from error
    for entry in document["episodes"]:
        if entry["episode_id"] == episode:
            return document["env_info"], entry
    raise InputError(f"there is no episode {episode}", file=path, field="episodes")


def _replay(
    info: dict[str, Any], entry: dict[str, Any], actions: npt.NDArray[np.float32], shown: _Shown, stride: int
) -> Iterator[Frame]:
    import gymnasium as gym

    env = gym.make(info["env_id"], **{**info["env_kwargs"], "obs_mode": "none", "render_mode": "rgb_array"})

    def see(outcome: dict[str, Any]) -> Frame:
        frame = np.asarray(env.render()[0].cpu().numpy(), dtype=np.uint8)  # type: ignore[index, union-attr]
        keypoints = env.unwrapped.measure().keypoints.values()  # type: ignore[attr-defined]
        points = [point for own in keypoints for point in own.values()]
        shown.add(frame, np.stack(points), bool(outcome["success"][0]))
        return frame

    try:
        yield see(env.reset(**entry["reset_kwargs"])[1])
        for number, action in enumerate(actions, 1):
            outcome = env.step(action)[4]
            if number % stride == 0 or number == len(actions):
                yield see(outcome)
    finally:
        env.close()


def _write_video(path: Path, frames: Iterable[Frame], frames_per_second: int) -> None:
    # ImageIO's plugin types do not say that a writer can append.
    writer: Any = imageio.get_writer(path, fps=frames_per_second, codec="libx264", quality=7)
    with writer:
        for frame in frames:
            writer.append_data(frame)
