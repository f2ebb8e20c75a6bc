"""Read LeRobot v3.0 data sets without the LeRobot package; the data may be untrusted."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from gensim2.core.errors import InputError
from gensim2.core.foreign.library import read_by_library
from gensim2.core.foreign.limits import MAX_LEROBOT_GROUP, MAX_LEROBOT_INFO, MAX_LEROBOT_ROWS, MAX_LEROBOT_TASKS
from gensim2.core.foreign.tree import ForeignTree
from gensim2.core.record_files import parse_record
from gensim2.data.formats.arrow_columns import arrow_modules, to_array
from gensim2.data.formats.lerobot import INDEX_NAME, INDICES, VERSION

Array = npt.NDArray[Any]


REMEDY = "give a LeRobot data set of version 3.0"

_FILE = re.compile(r"data/chunk-\d{3,9}/file-\d{3,9}\.parquet")


class _Feature(BaseModel):
    model_config = ConfigDict(strict=True)

    dtype: Annotated[str, Field(max_length=20)]
    shape: Annotated[list[Annotated[int, Field(ge=1, le=2**24)]], Field(max_length=4)]


class _Version(BaseModel):
    codebase_version: str


class _Info(BaseModel):
    codebase_version: Literal["v3.0"]
    features: Annotated[dict[str, _Feature], Field(max_length=1000)]


def read_lerobot(root: Path) -> Iterator[tuple[str, dict[str, Array]]]:
    """Yield the instruction and the columns (except images) of each episode of a LeRobot data set, ordered by index.

    In an episode of T frames, a column has the shape (T,) for scalars or (T, *shape) for arrays.

    Raises:
        InputError: the folder is not a LeRobot v3.0 data set, or is damaged.
        MissingExtraError: pyarrow is not installed.
    """
    arrow, parquet = arrow_modules()
    tree = ForeignTree(root)
    info = _read_info(tree)
    shapes = {name: tuple(each.shape) for name, each in info.features.items() if each.dtype != "video"}
    for name in INDICES:
        if shapes.get(name) != (1,):
            raise InputError("must have the shape [1]", file=root / _INFO, field=f"features.{name}", remedy=REMEDY)
    files = [name for name in tree.sizes() if _FILE.fullmatch(name)]
    sentences = _sentences(parquet, tree.inside(_TASKS))
    for name in sorted(files):
        path = root / name
        with read_by_library(path, REMEDY):
            file = parquet.ParquetFile(path, memory_map=False)
            _check_schema(arrow, file.schema_arrow, info.features, path)
        for group in range(file.metadata.num_row_groups):
            with read_by_library(path, REMEDY):
                columns = _row_group(file, group, shapes, path)
            for number in np.unique(columns["episode_index"]):  # a row group may contain several episodes
                rows = columns["episode_index"] == number
                task = int(columns["task_index"][rows][0])
                if task not in sentences:
                    raise InputError(f"names a task {task} that does not exist", file=path, field="task_index")
                yield sentences[task], {each: values[rows] for each, values in columns.items()}


_INFO, _TASKS = "meta/info.json", "meta/tasks.parquet"


def _read_info(tree: ForeignTree) -> _Info:
    path, remedy = tree.path / _INFO, "give the folder that holds meta/"
    try:
        content = tree.read(_INFO, MAX_LEROBOT_INFO)
        version = parse_record(content, TypeAdapter(_Version), path, remedy).codebase_version
    except InputError as error:
        raise InputError(f"is not a LeRobot data set: {error.message}", file=path, remedy=remedy) from error
    if version != VERSION:
        remedy = "convert it with LeRobot's own script"
        raise InputError(f"is {version}, not {VERSION}", file=path, field="codebase_version", remedy=remedy)
    return parse_record(content, TypeAdapter(_Info), path, remedy)


def _sentences(parquet: Any, path: Path) -> dict[int, str]:
    with read_by_library(path, REMEDY, "is not a readable list of tasks"):
        file = parquet.ParquetFile(path)
        if file.metadata.num_rows > MAX_LEROBOT_TASKS:
            raise InputError(f"has more than {MAX_LEROBOT_TASKS} tasks", file=path, remedy=REMEDY)
        tasks = file.read().to_pydict()
        numbers, sentences = tasks["task_index"], tasks[INDEX_NAME]
        if not all(isinstance(each, str) for each in sentences):
            raise InputError("contains a task without an instruction text", file=path, remedy=REMEDY)
        return dict(zip(map(int, numbers), sentences, strict=True))


def _check_schema(arrow: Any, schema: Any, features: dict[str, _Feature], path: Path) -> None:
    """Refuse columns whose type differs from ``meta/info.json``."""
    for name, feature in features.items():
        if feature.dtype == "video":
            continue
        kind = schema.field(name).type
        for _ in feature.shape if tuple(feature.shape) != (1,) else ():
            kind = kind.value_type
        if kind != arrow.type_for_alias(feature.dtype):
            wrong = f"the column has the type {kind}, but meta/info.json says {feature.dtype}"
            raise InputError(wrong, file=path, field=name, remedy=REMEDY)


def _row_group(file: Any, group: int, shapes: dict[str, tuple[int, ...]], path: Path) -> dict[str, Array]:
    told = file.metadata.row_group(group)
    if not 0 <= told.num_rows <= MAX_LEROBOT_ROWS or told.total_byte_size > MAX_LEROBOT_GROUP:
        wrong = f"has {told.num_rows} rows of {told.total_byte_size} bytes in one group"
        raise InputError(wrong, file=path, field=f"row group {group}", remedy=REMEDY)
    table = file.read_row_group(group, columns=list(shapes), use_threads=False)
    return {name: to_array(table[name], shape) for name, shape in shapes.items()}
