"""Write a zarr folder in the layout of Diffusion Policy and DP3: the frames of all episodes concatenated.

    data/<key>          (frames, ...), one array per key: state, action, point_cloud, ...
    meta/episode_ends   (episodes,) int64: total number of frames up to the end of each episode
    meta/task           (episodes,) int64: index of the instruction in the list ``tasks`` (attribute of the root group)

The file has zarr format 2, which zarr 2 and 3 read. Only one episode is in memory at a time. ``zarr_reading`` reads the
file.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError, required
from gensim2.core.foreign.names import checked_name

CHUNK_BYTES = 2**20
"""Size of a chunk before compression, bytes."""
EPISODES_PER_CHUNK = 4096

Array = npt.NDArray[Any]


class ZarrWriter:
    """Context manager that writes a data set episode by episode.

    Args:
        root: new or empty folder; its name should end with ``.zarr``.

    Raises:
        InputError: ``root`` is not empty.
        MissingExtraError: zarr is not installed.
    """

    def __init__(self, root: Path) -> None:
        zarr = required("zarr", "data")
        if root.exists() and any(root.iterdir()):
            raise InputError("is not empty", file=root, remedy="give another folder")
        self._root = root
        self._group = zarr.open_group(root, mode="w-", zarr_format=2)  # mode "w" would replace an existing folder
        self._data, self._meta = self._group.create_group("data"), self._group.create_group("meta")
        self._tasks: dict[str, int] = {}
        self._arrays: dict[str, Any] = {}
        self._frames = 0
        for name in ("episode_ends", "task"):
            self._meta.create_array(name, shape=(0,), chunks=(EPISODES_PER_CHUNK,), dtype=np.int64)

    def __enter__(self) -> ZarrWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            _finish_writing()
        elif not self._frames:
            raise InputError("there is no episode to export", file=self._root)

    def add(self, task: str, frames: Mapping[str, Array]) -> None:
        """Add an episode.

        Args:
            task: instruction of the task.
            frames: (T, ...) by key. The keys and the shapes of their rows are the same in all episodes, and no key has
                a slash.

        Raises:
            InputError: a key is missing, new or invalid, or the shape of its array differs from earlier episodes.
        """
        if self._arrays and frames.keys() != self._arrays.keys():
            wrong = f"the episode has the keys {sorted(frames)}, but earlier episodes have {sorted(self._arrays)}"
            raise InputError(wrong, field="frames")
        for key, values in frames.items():
            if key not in self._arrays:
                self._arrays[key] = self._created(checked_name(key, field="frames"), values)
            array = self._arrays[key]
            if values.shape[1:] != array.shape[1:]:
                wrong = f"the shape of a frame is {values.shape[1:]}, but in earlier episodes it is {array.shape[1:]}"
                raise InputError(wrong, field=key)
            array.append(np.ascontiguousarray(values))
        self._frames += len(next(iter(frames.values())))
        index = self._tasks.setdefault(task, len(self._tasks))
        self._meta["episode_ends"].append(np.array([self._frames]))
        self._meta["task"].append(np.array([index]))
        self._group.attrs["tasks"] = list(self._tasks)

    def _created(self, key: str, values: Array) -> Any:
        row = max(1, values[:1].nbytes)
        chunk = max(1, CHUNK_BYTES // row)
        return self._data.create_array(
            key, shape=(0, *values.shape[1:]), chunks=(chunk, *values.shape[1:]), dtype=values.dtype
        )


def _finish_writing() -> None:
    """Wait for the other writes of zarr after a failed write. Otherwise they would create the folder again."""
    from zarr.core.sync import sync

    async def others() -> None:
        pending = asyncio.all_tasks() - {asyncio.current_task()}
        await asyncio.gather(*pending, return_exceptions=True)

    sync(others())
