"""Write the training curves as JSON lines, and to TensorBoard if it is installed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from gensim2.core.files import append, write_atomic
from gensim2.core.foreign.tree import read_input
from gensim2.core.record_files import parse_record

CURVES = "curves.jsonl"
MAX_BYTES = 2**30


class _Point(BaseModel):
    model_config = ConfigDict(extra="allow", allow_inf_nan=False)
    __pydantic_extra__: dict[str, float]

    step: int = Field(ge=0)
    loss: float


class Curves:
    """Writes training curves to ``curves.jsonl``, and to ``tensorboard/`` if TensorBoard is installed.

    Args:
        folder: folder in which the file and the subfolder are created.
        step: step from which training resumes; points after this step are deleted, because these steps are repeated.
    """

    def __init__(self, folder: Path, step: int) -> None:
        self._path = folder / CURVES
        points = [point for point in read_curves(folder) if point["step"] <= step] if step else []
        write_atomic(self._path, "".join(json.dumps(point) + "\n" for point in points))
        self._board = _board(folder / "tensorboard", step)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._board is not None:
            self._board.close()

    def add(self, *, step: int, **values: float) -> None:
        append(self._path, json.dumps({"step": step, **values}) + "\n")
        if self._board is not None:
            for name, value in values.items():
                self._board.add_scalar(name, value, step)


def read_curves(folder: Path) -> list[dict[str, Any]]:
    """Return the points of the training curves in a folder, oldest first; an incomplete last line is ignored.

    Raises:
        InputError: the file cannot be read, or a line is not a valid point.
    """
    path, remedy = folder / CURVES, "delete the file"
    found = []
    for number, line in enumerate(read_input(path, MAX_BYTES, remedy, b"").splitlines(), 1):
        if not line.endswith(b"}"):
            break  # The last line is incomplete, because the run was interrupted; the steps after it are repeated.
        point = parse_record(line, TypeAdapter(_Point), path, remedy, f"line {number}")
        found.append(point.model_dump())
    return found


def _board(folder: Path, step: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(folder, purge_step=step + 1 if step else None)
