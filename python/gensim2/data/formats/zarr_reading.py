"""Read untrusted zarr folders in the layout of :mod:`~gensim2.data.formats.replay_zarr`.

Metadata is checked before zarr opens an array. Otherwise zarr could unpickle objects, which runs foreign code, or fill
the memory.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from gensim2.core.errors import InputError, required
from gensim2.core.foreign.library import read_by_library
from gensim2.core.foreign.limits import MAX_ZARR_ARRAY, MAX_ZARR_CHUNK, MAX_ZARR_EPISODES, MAX_ZARR_JSON
from gensim2.core.foreign.names import is_name
from gensim2.core.foreign.tree import ForeignTree
from gensim2.core.record_files import parse_record
from gensim2.data.formats.columns import current, formerly_nested
from gensim2.data.formats.frames import Frames

REMEDY = "export again"

Array = npt.NDArray[Any]


class _Compressor(BaseModel):
    id: Literal["zstd", "blosc", "zlib", "gzip", "lz4", "bz2", "lzma"]


class _ArrayDescription(BaseModel):
    """Content of ``.zarray`` in zarr format 2."""

    model_config = ConfigDict(strict=True)

    zarr_format: Literal[2]
    shape: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1, max_length=6)]
    chunks: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1, max_length=6)]
    dtype: Annotated[str, Field(pattern=r"^(<[iuf][248]|\|[biu]1)$")]
    compressor: _Compressor | None
    filters: Annotated[list[Any], Field(max_length=0)] | None = None
    order: Literal["C"]


class _Attributes(BaseModel):
    tasks: list[str]


def zarr_frames(root: Path) -> Iterator[Frames]:
    """Yield the episodes of a zarr folder, including images and depth.

    Raises:
        InputError: the folder is not a zarr export of gensim2, or is damaged.
        MissingExtraError: zarr is not installed.
    """
    required("zarr", "data")
    tree = ForeignTree(root)
    names = array_names(tree)
    try:
        sentences = parse_record(tree.read(".zattrs", MAX_ZARR_JSON), TypeAdapter(_Attributes), root, REMEDY).tasks
        ends, tasks = (_whole(tree, f"meta/{name}") for name in ("episode_ends", "task"))
    except InputError as error:
        raise InputError(f"is not a zarr data set of gensim2: {error}", file=root, remedy=REMEDY) from error
    lengths = np.diff(ends, prepend=0)
    if len(ends) != len(tasks) or not len(ends) or (lengths < 1).any():
        wrong = f"meta/episode_ends ({len(ends)}) and meta/task ({len(tasks)}) do not describe consecutive episodes"
        raise InputError(wrong, file=root, field="meta", remedy=REMEDY)
    if not ((tasks >= 0) & (tasks < len(sentences))).all():
        raise InputError("an entry refers to a task that does not exist", file=root, field="meta/task", remedy=REMEDY)
    arrays = {column: _opened(tree, name, int(ends[-1]), int(lengths.max())) for column, name in names.items()}
    begin = 0
    for end, task in zip(ends.tolist(), tasks.tolist(), strict=True):
        columns: dict[str, Array] = {}
        for column, array in arrays.items():
            with read_by_library(root / names[column], REMEDY, f"frames {begin} to {end} cannot be read"):
                columns[column] = array[begin:end]
        yield Frames(sentences[task], columns)
        begin = end


def array_names(tree: ForeignTree) -> dict[str, str]:
    """Return the path of each column's array by the column's current name. Old exports nest arrays in folders."""
    found: dict[str, str] = {}
    for name in tree.sizes():
        parts = name.split("/")
        if parts[0] != "data" or parts[-1] != ".zarray":
            continue
        folder = "/".join(parts[:-1])
        prefix = formerly_nested(parts[1]) if len(parts) == 4 else None
        column = parts[1] if len(parts) == 3 else None if prefix is None else prefix + current(parts[2])
        if column is None or not is_name(column):
            wrong = "the path of an array must be data/NAME, where NAME is a valid name"
            raise InputError(wrong, file=tree.path / folder, remedy=REMEDY)
        found[column] = folder
    return found


def _description(tree: ForeignTree, name: str) -> _ArrayDescription:
    file = f"{name}/.zarray"
    found = parse_record(tree.read(file, MAX_ZARR_JSON), TypeAdapter(_ArrayDescription), tree.path / file, REMEDY)
    if len(found.shape) != len(found.chunks):
        wrong = f"has {len(found.chunks)} entries, but the list 'shape' has {len(found.shape)}"
        raise InputError(wrong, file=tree.path / file, field="chunks", remedy=REMEDY)
    if _bytes(found.chunks, found.dtype) > MAX_ZARR_CHUNK:
        wrong = f"has {shown(found.chunks)}: more than {MAX_ZARR_CHUNK // 2**20} MiB"
        raise InputError(wrong, file=tree.path / file, field="chunks", remedy=REMEDY)
    return found


def _opened(tree: ForeignTree, name: str, frames: int, longest: int) -> Any:
    """Open an array with ``frames`` rows. The longest episode, ``longest`` rows, may have ``MAX_ZARR_ARRAY`` bytes."""
    file, found = tree.path / name / ".zarray", _description(tree, name)
    if found.shape[0] != frames:
        wrong = f"has {shown(found.shape)}, not the {frames} frames of meta/episode_ends"
        raise InputError(wrong, file=file, field="shape", remedy=REMEDY)
    if _bytes([longest, *found.shape[1:]], found.dtype) > MAX_ZARR_ARRAY:
        wrong = f"has {shown(found.shape)}: more than {MAX_ZARR_ARRAY // 2**20} MiB an episode"
        raise InputError(wrong, file=file, field="shape", remedy=REMEDY)
    with read_by_library(tree.path / name, REMEDY):
        return required("zarr", "data").open_array(tree.inside(name), mode="r", zarr_format=2)


def _whole(tree: ForeignTree, name: str) -> npt.NDArray[np.int64]:
    """Read an array that has one integer for each episode."""
    found = _description(tree, name)
    if len(found.shape) != 1 or found.dtype != "<i8" or found.shape[0] > MAX_ZARR_EPISODES:
        wrong = f"has {shown(found.shape)} of {found.dtype}, not one <i8 an episode"
        raise InputError(wrong, file=tree.path / name / ".zarray", field="shape", remedy=REMEDY)
    with read_by_library(tree.path / name, REMEDY):
        values: npt.NDArray[np.int64] = required("zarr", "data").open_array(tree.inside(name), mode="r", zarr_format=2)[
            :
        ]
    return values


def shown(shape: Sequence[int]) -> str:
    """Format a shape for a message, with huge numbers shortened."""
    return f"({', '.join(str(size) if size < 10**15 else 'over 10^15' for size in shape)})"


def _bytes(shape: Sequence[int], dtype: str) -> int:
    return math.prod(shape) * int(dtype[-1])
