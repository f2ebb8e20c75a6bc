"""The numbers of a LeRobot data set, v3.0, whoever wrote it, read without LeRobot."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.data.formats.arrow_columns import arrow_modules, to_array
from gensim2.data.formats.lerobot import INDEX_NAME, VERSION
from gensim2.errors import InputError

Array = npt.NDArray[Any]


def read_lerobot(root: Path) -> Iterator[tuple[str, dict[str, Array]]]:
    """Yield the sentence and the columns of each episode of a LeRobot data set, by index; pictures are left out.

    Numbers come as (T,), everything else as (T, *shape).

    Raises:
        InputError: it is no LeRobot data set of version 3.0.
        MissingExtraError: pyarrow is not installed.
    """
    arrow, parquet = arrow_modules()
    info = _read_info(root / "meta" / "info.json")
    shapes = {name: tuple(each["shape"]) for name, each in info["features"].items() if each["dtype"] != "video"}
    try:
        tasks = parquet.read_table(root / "meta" / "tasks.parquet").to_pydict()
        sentences = dict(zip(tasks["task_index"], tasks[INDEX_NAME], strict=True))
        for path in sorted((root / "data").glob("*/*.parquet")):
            file = parquet.ParquetFile(path)
            for group in range(file.num_row_groups):
                table = file.read_row_group(group)
                columns = {name: to_array(table[name], shape) for name, shape in shapes.items()}
                for number in np.unique(columns["episode_index"]):  # others may put several into a row group
                    rows = columns["episode_index"] == number
                    yield sentences[int(columns["task_index"][rows][0])], {n: v[rows] for n, v in columns.items()}
    except (KeyError, ValueError, OSError, arrow.ArrowException) as error:
        raise InputError(f"is no LeRobot data set that can be read: {error}", file=root) from error


def _read_info(path: Path) -> dict[str, Any]:
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
        version, features = info["codebase_version"], info["features"]
        if not isinstance(features, dict):
            raise TypeError
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError("is no LeRobot data set", file=path, remedy="give the folder that holds meta/") from error
    if version != VERSION:
        remedy = "convert it with LeRobot's own script"
        raise InputError(f"is {version}, not {VERSION}", file=path, field="codebase_version", remedy=remedy)
    return dict(info)
