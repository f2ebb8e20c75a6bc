"""Read the frames of a data set in any order, for training."""

from __future__ import annotations

import os
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.data.formats.columns import XYZ, seen_columns
from gensim2.data.observation_file import checked_description, frame_arrays, spec_of_file
from gensim2.data.store import TaskStore
from gensim2.perception import ObservationSpec
from gensim2.perception.cloud import from_steps
from gensim2.perception.observation import Proprioception
from gensim2.robots import OPEN, robot
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import Recording

if TYPE_CHECKING:
    import torch.utils.data

Array = npt.NDArray[Any]

OPEN_FILES = 64
"""Largest number of observation files that a process keeps open."""
KEPT_EPISODES = 1024
"""Maximum number of episodes whose states and actions a process caches, about 20 kB for each episode."""

_ROOT = 13
"""Number of values before the joints in ManiSkill's states: root pose and velocities."""


@dataclass(frozen=True)
class _Episode:
    store: TaskStore
    row: Episode
    language: str
    task: int

    @property
    def observations(self) -> Path:
        return self.store.observation_path(self.row.index)


@dataclass(frozen=True)
class _Open:
    """An open observation file, and its arrays that have one row for each frame."""

    file: h5py.File
    arrays: dict[str, h5py.Dataset]


class FrameAccess:
    """Sequence of the frames of all successful episodes.

    ``frames[i]`` is a mapping with the following entries:

    - observations, named as in :class:`~gensim2.perception.Observation`
    - ``action``, ``reward``, ``success`` and ``done``
    - ``language``, the instruction of the task
    - ``task_index``, ``episode_index`` and ``frame_index``

    A file is checked on first use. Afterwards only the requested frames are read. The object can be pickled; see
    :meth:`torch`.

    Args:
        stores: stored episodes of each task; at least one task.
        robot_name: robot of the episodes.
        observations: whether to include rendered observations; None includes them if any exist.
        horizon: number of future actions with each frame. ``action`` is (m + 1,) for 1, and (horizon, m + 1) otherwise.
            Near the end the last action is repeated, and ``action_is_pad`` marks the repetitions.

    Raises:
        InputError: the collection is not finished, only some episodes have observations, or their specs differ.
    """

    def __init__(
        self, stores: Sequence[TaskStore], robot_name: str, *, observations: bool | None = None, horizon: int = 1
    ) -> None:
        if horizon < 1:
            raise InputError("must be at least 1", field="horizon")
        self._profile = robot(robot_name)
        self._horizon = horizon
        self._episodes: list[_Episode] = []
        for number, store in enumerate(stores):
            language = store.spec().description
            self._episodes += [_Episode(store, row, language, number) for row in store.rows() if row.held]
        if not self._episodes:
            raise InputError("has no successful episode", file=stores[0].folder.parent)
        self._ends = list(accumulate(each.row.control_steps for each in self._episodes))
        there = [each.observations.exists() for each in self._episodes]
        self._observed = any(there) if observations is None else observations
        if self._observed and not all(there):
            path = self._episodes[there.index(False)].observations
            raise InputError("does not exist", file=path, remedy="run `gensim2 render` with --resume")
        self._spec: ObservationSpec | None = None
        self._forget()

    def _forget(self) -> None:
        self._process = os.getpid()
        self._files: OrderedDict[int, _Open] = OrderedDict()
        self._arrays: dict[int, list[str]] = {}
        self._recordings: OrderedDict[int, Recording] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_files": OrderedDict(), "_recordings": OrderedDict()}

    def __len__(self) -> int:
        return self._ends[-1]

    @property
    def episodes(self) -> int:
        return len(self._episodes)

    def episode(self, number: int) -> range:
        """Return the range of indices of the frames of episode ``number``."""
        return range(self._ends[number - 1] if number else 0, self._ends[number])

    @property
    def spec(self) -> ObservationSpec:
        """Observation spec with which the frames were rendered.

        Raises:
            InputError: there are no observations, or a file is damaged.
        """
        if not self._observed:
            raise InputError("has no observations", remedy="run `gensim2 render` on it")
        self._file(0)
        assert self._spec is not None
        return self._spec

    def __getitem__(self, index: int) -> dict[str, Any]:
        if not -len(self) <= index < len(self):
            raise IndexError(f"the data set has only {len(self)} frames")
        index %= len(self)
        number = bisect_right(self._ends, index)
        episode, frame = self._episodes[number], index - self.episode(number).start
        recording = self._recording(number)
        state = recording.env_states["articulations"][self._profile.agent][frame]
        joints = len(self._profile.reset_qpos)
        command = float(recording.actions[frame - 1][-1]) if frame else OPEN
        found: dict[str, Any] = dict(
            Proprioception(
                self._profile, state[_ROOT : _ROOT + joints], state[_ROOT + joints : _ROOT + 2 * joints], command
            )
        )
        if self._observed:
            seen = {name: rows[frame] for name, rows in self._file(number).arrays.items()}
            if XYZ in seen:
                seen[XYZ] = from_steps(seen[XYZ])
            found |= seen_columns(seen)
        return {
            **found,
            **self._actions(recording, frame),
            "reward": recording.rewards[frame],
            "success": recording.success[frame],
            "done": np.bool_(frame == recording.steps - 1),
            "language": episode.language,
            "task_index": episode.task,
            "episode_index": number,
            "frame_index": frame,
        }

    def torch(self) -> torch.utils.data.Dataset[dict[str, Any]]:
        """Return the frames as tensors, for a ``torch.utils.data.DataLoader`` with any number of workers."""
        from gensim2.data.torch_frames import TorchFrames

        return TorchFrames(self)

    def _actions(self, recording: Recording, frame: int) -> dict[str, Array]:
        meant = recording.meant  # the actions without the noise that `collect --noise` adds
        if self._horizon == 1:
            return {"action": meant[frame]}
        rows = np.arange(frame, frame + self._horizon)
        return {"action": meant[np.minimum(rows, recording.steps - 1)], "action_is_pad": rows >= recording.steps}

    def _recording(self, number: int) -> Recording:
        if os.getpid() != self._process:  # this is a forked worker, which must open HDF5 files again
            self._forget()
        if number not in self._recordings:
            episode = self._episodes[number]
            self._recordings[number] = episode.store.recording(episode.row)
            if len(self._recordings) > KEPT_EPISODES:
                self._recordings.popitem(last=False)
        return self._recordings[number]

    def _file(self, number: int) -> _Open:
        if number in self._files:
            self._files.move_to_end(number)
            return self._files[number]
        episode = self._episodes[number]
        path = episode.observations
        if number not in self._arrays:
            spec = spec_of_file(checked_description(path, episode.row.episode_digest), path)
            self._spec = self._spec or spec
            self._spec.require(spec, str(path), of="the rest of the data set")
            found = frame_arrays(path, episode.row.control_steps)
            self._arrays[number] = next((known for known in self._arrays.values() if known == found), found)
        # Disable HDF5's cache. Each chunk contains one frame, and programs seldom read the same frame twice.
        file = h5py.File(path, "r", rdcc_nbytes=0)
        self._files[number] = _Open(file, {name: file[name] for name in self._arrays[number]})
        if len(self._files) > OPEN_FILES:
            self._files.popitem(last=False)[1].file.close()
        return self._files[number]
