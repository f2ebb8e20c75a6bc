"""Sample training batches from demonstrations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import torch

from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.formats.columns import RGB, XYZ
from gensim2.perception.cloud import from_steps
from gensim2.perception.observation import CLOUD, GRIPPER, STATE, TOOL_POSE, VELOCITY, cloud_column
from gensim2.policy.checkpoint import ActionSpec
from gensim2.policy.control import Shuffled
from gensim2.policy.decoded import DecodedData, decode
from gensim2.policy.heads.actions import ACTION, EXTRA
from gensim2.policy.keyframes import KEY_POSITIONS, KEY_ROTATIONS, keyframes, next_keyframes, taught_frames
from gensim2.policy.rotations import matrix_of_quaternion
from gensim2.policy.source import SENTENCE
from gensim2.robots import robot

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig


class Demonstrations:
    """Frames of successful episodes, each with the chunk of actions that follows. All tasks are sampled equally often.

    Frames in which arm and fingers wait at the start or the end of an episode are left out.

    Args:
        data: decoded episodes.
        config: settings of the policy; they determine the number of past frames and the length of a chunk.
    """

    def __init__(self, data: DecodedData, config: PolicyConfig) -> None:
        profile = robot(data.robot)
        self.robot, self.observation, self.record = data.robot, data.observation, data.record
        self.action = ActionSpec(kind="joint-relative", arm=profile.arm_size, control_hz=profile.control_hz)
        self.sentences = tuple(dict.fromkeys(each.language for each in data.episodes))
        self._arrays, self._config = data.arrays, config
        firsts = np.array([each.first for each in data.episodes])
        lengths = np.array([each.steps + 1 for each in data.episodes])
        episode = np.repeat(np.arange(len(firsts)), lengths)
        self._first = firsts[episode]
        masks = [self._taught(first, length) for first, length in zip(firsts, lengths, strict=True)]
        taught = np.concatenate(masks)
        lasts = np.array([first + int(np.flatnonzero(mask)[-1]) for first, mask in zip(firsts, masks, strict=True)])
        self._last = lasts[episode]
        numbers = np.array([self.sentences.index(each.language) for each in data.episodes])
        self._sentence = numbers[episode]
        tasks = np.array([data.record.tasks.index(each.task) for each in data.episodes])[episode]
        self._frames = [np.flatnonzero(taught & (tasks == number)) for number in range(len(data.record.tasks))]
        self._keyframes = self._find_keyframes(firsts, lengths) if config.keyframes else None

    @staticmethod
    def open(
        folders: Sequence[Path], config: PolicyConfig, tasks: Sequence[str] = (), *, progress: Progress = NULL_PROGRESS
    ) -> Demonstrations:
        return Demonstrations(decode(folders, tasks, progress=progress), config)

    def __len__(self) -> int:
        return len(self._first)

    def draw(self, rng: np.random.Generator, size: int) -> dict[str, torch.Tensor]:
        """Return a batch of random frames: first a random task, then a random frame of that task."""
        task = rng.integers(len(self._frames), size=size)
        share = rng.random(size)
        rows = [self._frames[t][int(s * len(self._frames[t]))] for t, s in zip(task, share, strict=True)]
        return self.batch(np.array(rows))

    def batch(self, rows: npt.NDArray[np.int64]) -> dict[str, torch.Tensor]:
        """Return the training batch for the given frames.

        Args:
            rows: (B,) numbers of the frames at which the policy predicts.

        Returns:
            Observation columns (B, T, ...), ``sentence`` and ``action``, and the tool poses at the next keyframes if
            the policy predicts them. T counts the observed frames including the present one; before the start, the
            first frame is repeated. After the last training frame the last action is repeated, with the end mark.
        """
        back = self._config.stride * np.arange(self._config.history - 1, -1, -1)
        seen = np.maximum(rows[:, None] - back, self._first[rows][:, None])
        cloud = cloud_column(from_steps(self._arrays[XYZ][seen]), self._arrays[RGB][seen])
        found = {CLOUD: cloud}
        for name in (STATE, VELOCITY, TOOL_POSE, GRIPPER):
            found[name] = self._arrays[name][seen]
        found[ACTION] = self._chunks(rows)
        found[SENTENCE] = self._sentence[rows]
        batch = {name: torch.from_numpy(np.ascontiguousarray(values)) for name, values in found.items()}
        return batch if self._keyframes is None else {**batch, **self._ahead(rows, self._keyframes[rows])}

    def some_clouds(self, max_clouds: int) -> Shuffled:
        """Return the clouds of the first frames of up to ``max_clouds`` episodes, evenly spaced through the data."""
        firsts = np.unique(self._first)
        rows = firsts[np.unique(np.linspace(0, len(firsts) - 1, max_clouds).astype(np.int64))]
        return Shuffled(from_steps(self._arrays[XYZ][rows]), np.array(self._arrays[RGB][rows]))

    def _taught(self, first: int, length: int) -> npt.NDArray[np.bool_]:
        """Return a mask (T,) of the frames of an episode that are used for training."""
        own = slice(first, first + length)
        widths = self._arrays[GRIPPER][own, 0]
        return taught_frames(self._arrays[ACTION][own, : self.action.arm], widths, self.action.control_hz)

    def _find_keyframes(self, firsts: npt.NDArray[np.int64], lengths: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Return, for each of F frames, the frame numbers (F, K) of the next K keyframes."""
        found = np.empty((len(self._first), self._config.keyframes), dtype=np.int64)
        for first, length in zip(firsts, lengths, strict=True):
            own = slice(first, first + length)
            keys = keyframes(self._arrays[ACTION][own, : self.action.arm], self.action.control_hz)
            found[own] = first + next_keyframes(keys, int(length), self._config.keyframes)
        return found

    def _ahead(self, rows: npt.NDArray[np.int64], keys: npt.NDArray[np.int64]) -> dict[str, torch.Tensor]:
        """Return tool poses at the later keyframes ``keys`` (B, K), relative to the tool pose at frame ``rows[b]``."""
        now = torch.from_numpy(np.ascontiguousarray(self._arrays[TOOL_POSE][rows]))
        then = torch.from_numpy(np.ascontiguousarray(self._arrays[TOOL_POSE][keys]))
        R = matrix_of_quaternion(now[:, 3:])
        return {
            KEY_POSITIONS: (then[..., :3] - now[:, None, :3]) @ R,
            KEY_ROTATIONS: R[:, None].transpose(-1, -2) @ matrix_of_quaternion(then[..., 3:]),
        }

    def _chunks(self, rows: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
        """Return the action chunks (B, H, m + 2) of :mod:`gensim2.policy.heads.actions`."""
        arm = self.action.arm
        ahead = rows[:, None] + np.arange(self._config.horizon)
        last = self._last[rows][:, None]
        actions = self._arrays[ACTION][np.minimum(ahead, last)]
        chunk = np.empty((*ahead.shape, arm + EXTRA), np.float32)
        chunk[..., :arm] = actions[..., :arm] - self._arrays[STATE][rows][:, None, :arm]
        chunk[..., arm] = actions[..., arm]
        chunk[..., arm + 1] = np.where(ahead >= last, 1.0, -1.0)
        return chunk
