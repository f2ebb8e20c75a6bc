"""Write LeRobot v3.0 data sets (codebase version ``v3.0``) without the LeRobot package.

    meta/info.json                            features, counts, file names
    meta/stats.json                           minimum, maximum, mean, deviation and count of every feature
    meta/tasks.parquet                        instruction -> task_index
    meta/episodes/chunk-000/file-000.parquet  one row per episode: length, task, location of frames, statistics
    data/chunk-000/file-000.parquet           one row per frame; one row group per episode; files of about 100 MB
    videos/<camera>/chunk-000/file-000.mp4    one file per episode, if there are images

One episode is in memory at a time.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.core.files import replacing, write_json
from gensim2.core.foreign.names import checked_name
from gensim2.data.formats.arrow_columns import arrow_modules, column_type, to_column
from gensim2.data.video import pixel_format, write_video

VERSION = "v3.0"
FILE_BYTES = 100 * 2**20
"""Size in memory after which frames go to a new file, bytes."""
FILES_PER_CHUNK = 1000
PATH = "chunk-{chunk_index:03d}/file-{file_index:03d}"

INDEX_NAME = "__index_level_0__"
"""Name that pandas gives to an index without a name."""

Array = npt.NDArray[Any]

INDICES = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
"""Index columns of every LeRobot data set, one number per frame."""


@dataclass(frozen=True)
class Totals:
    """Running sums, minimum and maximum of a feature's elements over the frames.

    Its statistics are computed from them.
    """

    count: int
    low: Array
    high: Array
    total: Array
    squares: Array

    @staticmethod
    def of(values: Array, picture: bool) -> Totals:
        """Return count, minimum, maximum, sum and sum of squares of frames (T, ...). Images are scaled to 0..1."""
        found = np.asarray(values, dtype=np.float64)
        if picture:
            found = found.reshape(-1, found.shape[-1]) / 255.0
        count = len(values)
        scale = count / len(found)
        return Totals(count, found.min(0), found.max(0), found.sum(0) * scale, np.square(found).sum(0) * scale)

    def plus(self, other: Totals) -> Totals:
        return Totals(
            self.count + other.count,
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
            self.total + other.total,
            self.squares + other.squares,
        )

    def statistics(self, picture: bool) -> dict[str, Array]:
        """Return the statistics with LeRobot's names and shapes."""
        mean = self.total / self.count
        deviation = np.sqrt(np.maximum(self.squares / self.count - mean**2, 0.0))
        found = {"min": self.low, "max": self.high, "mean": mean, "std": deviation}
        shaped = {
            word: np.atleast_1d(each).reshape(-1, 1, 1) if picture else np.atleast_1d(each)
            for word, each in found.items()
        }
        return {**shaped, "count": np.array([self.count])}


def thinned(pictures: Array) -> Array:
    """Return the subset of an episode's images from which the image statistics are computed."""
    return np.asarray(pictures)[:: max(1, len(pictures) // 20)]


@dataclass(frozen=True)
class Feature:
    """A data column of a LeRobot data set; index columns are not features.

    Attributes:
        dtype: NumPy data type; ``"video"`` for images, which are stored as one mp4 for each camera.
        shape: shape of one frame.
        names: names of the vector's elements, or of the image's axes.
    """

    dtype: str
    shape: tuple[int, ...]
    names: Sequence[str] | None = None

    @property
    def is_video(self) -> bool:
        """Whether the feature is an image, (H, W, 3) uint8."""
        return self.dtype == "video"


class LeRobotWriter:
    """Context manager that writes a data set episode by episode; the data set is readable after a normal exit.

    Args:
        root: new or empty folder.
        features: features by name. A name may contain dots but no slashes, because LeRobot's tools refuse slashes.
        fps: frames per second.
        robot: robot type.

    Raises:
        InputError: ``root`` is not empty, or a feature's name has a slash.
        MissingExtraError: pyarrow is not installed.
    """

    def __init__(self, root: Path, features: Mapping[str, Feature], *, fps: int, robot: str) -> None:
        self._arrow, self._parquet = arrow_modules()
        if root.exists() and any(root.iterdir()):
            raise InputError("is not empty", file=root, remedy="give another folder")
        for name in features:
            checked_name(name, field="features")
        self._root, self._features, self._fps, self._robot = root, dict(features), fps, robot
        self._tasks: dict[str, int] = {}
        self._episodes: list[dict[str, Any]] = []
        self._frames = 0
        self._file, self._in_file = 0, 0
        self._writer: Any = None
        self._totals: dict[str, Totals] = {}

    def __enter__(self) -> LeRobotWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.finish()
        elif self._writer is not None:
            self._writer.close()

    def add(self, task: str, frames: Mapping[str, Array]) -> None:
        """Add an episode.

        Args:
            task: instruction of the task.
            frames: array (T, *shape) of every feature, by name.

        Raises:
            InputError: a feature is missing, or the shape of its array differs from the declared shape.
        """
        length = self._length(frames)
        number, task_index = len(self._episodes), self._tasks.setdefault(task, len(self._tasks))
        columns: dict[str, Array] = {
            "timestamp": (np.arange(length) / self._fps).astype(np.float32),
            "frame_index": np.arange(length),
            "episode_index": np.full(length, number),
            "index": np.arange(self._frames, self._frames + length),
            "task_index": np.full(length, task_index),
        }
        columns |= {
            name: np.asarray(frames[name], feature.dtype)
            for name, feature in self._features.items()
            if not feature.is_video
        }
        self._write(columns)
        row: dict[str, Any] = {
            "episode_index": number,
            "tasks": [task],
            "length": length,
            "data/chunk_index": self._file // FILES_PER_CHUNK,
            "data/file_index": self._file % FILES_PER_CHUNK,
            "dataset_from_index": self._frames,
            "dataset_to_index": self._frames + length,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        for name, feature in self._features.items():
            if feature.is_video:
                row |= self._film(name, np.asarray(frames[name], np.uint8), number)
                columns[name] = thinned(frames[name])
        for name, values in columns.items():
            picture = name in self._features and self._features[name].is_video
            found = Totals.of(values, picture)
            row |= {f"stats/{name}/{word}": each.tolist() for word, each in found.statistics(picture).items()}
            self._totals[name] = self._totals[name].plus(found) if name in self._totals else found
        self._episodes.append(row)
        self._frames += length

    def finish(self) -> None:
        """Write the files that summarize all episodes. Without these files the data set cannot be read."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        if not self._episodes:
            raise InputError("there is no episode to export", file=self._root)
        meta = self._root / "meta"
        with replacing(meta / "episodes" / f"{PATH.format(chunk_index=0, file_index=0)}.parquet") as path:
            self._parquet.write_table(self._arrow.Table.from_pylist(self._episodes), path)
        with replacing(meta / "tasks.parquet") as path:
            self._parquet.write_table(self._task_table(), path)
        write_json(
            meta / "stats.json",
            {
                name: {word: each.tolist() for word, each in found.statistics(self._is_video(name)).items()}
                for name, found in self._totals.items()
            },
        )
        write_json(meta / "info.json", self._info())

    def _is_video(self, name: str) -> bool:
        return name in self._features and self._features[name].is_video

    def _length(self, frames: Mapping[str, Array]) -> int:
        lengths = set()
        for name, feature in self._features.items():
            if name not in frames:
                raise InputError("this feature is missing from an episode, but every episode must have it", field=name)
            if frames[name].shape[1:] != feature.shape:
                raise InputError(f"has the shape {frames[name].shape[1:]}, not {feature.shape}", field=name)
            lengths.add(len(frames[name]))
        if len(lengths) != 1 or not min(lengths):
            raise InputError(f"all features must have the same number of frames, not {sorted(lengths)}", field="frames")
        return lengths.pop()

    def _write(self, columns: Mapping[str, Array]) -> None:
        arrow = self._arrow
        size = sum(values.nbytes for values in columns.values())
        if self._writer is not None and self._in_file + size > FILE_BYTES:
            self._writer.close()
            self._writer, self._in_file, self._file = None, 0, self._file + 1
        schema = arrow.schema(
            [(name, column_type(arrow, values.dtype, values.shape[1:])) for name, values in columns.items()]
        )
        table = arrow.Table.from_arrays([to_column(arrow, values) for values in columns.values()], schema=schema)
        if self._writer is None:
            place = PATH.format(chunk_index=self._file // FILES_PER_CHUNK, file_index=self._file % FILES_PER_CHUNK)
            path = self._root / "data" / f"{place}.parquet"
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = self._parquet.ParquetWriter(path, schema, compression="zstd")
        self._writer.write_table(table, row_group_size=len(table))
        self._in_file += size

    def _film(self, camera: str, pictures: Array, number: int) -> dict[str, Any]:
        """Write the video of a camera for one episode.

        Return the columns that locate it in LeRobot's table of episodes.
        """
        chunk, file = divmod(number, FILES_PER_CHUNK)
        with replacing(
            self._root / "videos" / camera / f"{PATH.format(chunk_index=chunk, file_index=file)}.mp4"
        ) as path:
            write_video(path, pictures, self._fps, exact=True)
        return {
            f"videos/{camera}/chunk_index": chunk,
            f"videos/{camera}/file_index": file,
            f"videos/{camera}/from_timestamp": 0.0,
            f"videos/{camera}/to_timestamp": len(pictures) / self._fps,
        }

    def _task_table(self) -> Any:
        """Return LeRobot's table of tasks. The instructions are its index for pandas."""
        table = self._arrow.table({"task_index": list(self._tasks.values()), INDEX_NAME: list(self._tasks)})
        columns = [
            {"name": name, "field_name": field, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
            for name, field, kind, numpy in (
                ("task_index", "task_index", "int64", "int64"),
                (None, INDEX_NAME, "unicode", "object"),
            )
        ]
        note = {"index_columns": [INDEX_NAME], "column_indexes": [], "columns": columns, "pandas_version": "2.0.0"}
        return table.replace_schema_metadata({"pandas": json.dumps(note)})

    def _info(self) -> dict[str, Any]:
        videos = any(feature.is_video for feature in self._features.values())
        described: dict[str, Any] = {
            name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in INDICES.items()
        }
        for name, feature in self._features.items():
            names = list(feature.names) if feature.names is not None else None
            described[name] = {"dtype": feature.dtype, "shape": list(feature.shape), "names": names}
            if feature.is_video:
                height, width, channels = feature.shape
                described[name]["info"] = {
                    "video.height": height,
                    "video.width": width,
                    "video.channels": channels,
                    "video.codec": "h264",
                    "video.pix_fmt": pixel_format(height, width),
                    "video.is_depth_map": False,
                    "video.fps": self._fps,
                    "has_audio": False,
                }
        return {
            "codebase_version": VERSION,
            "robot_type": self._robot,
            "total_episodes": len(self._episodes),
            "total_frames": self._frames,
            "total_tasks": len(self._tasks),
            "chunks_size": FILES_PER_CHUNK,
            "data_files_size_in_mb": FILE_BYTES // 2**20,
            "video_files_size_in_mb": 200,
            "fps": self._fps,
            "splits": {"train": f"0:{len(self._episodes)}"},
            "data_path": f"data/{PATH}.parquet",
            "video_path": f"videos/{{video_key}}/{PATH}.mp4" if videos else None,
            "features": described,
        }
