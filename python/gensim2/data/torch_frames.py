"""Provide the frames of a data set as a PyTorch data set."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
import torch.utils.data

if TYPE_CHECKING:
    from gensim2.data.frame_access import FrameAccess


class TorchFrames(torch.utils.data.Dataset[dict[str, Any]]):  # type: ignore[misc]
    """Map-style PyTorch data set of tensors, named as in :class:`~gensim2.data.frame_access.FrameAccess`.

    Depth images become int32, because few operations support uint16. The instruction stays a string.
    """

    def __init__(self, frames: FrameAccess) -> None:
        self.frames = frames

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> dict[str, Any]:
        return {name: _tensor(value) for name, value in self.frames[index].items()}


def _tensor(value: Any) -> Any:
    if isinstance(value, str | int):
        return value
    array = np.asarray(value)
    return torch.from_numpy(np.array(array.astype(np.int32) if array.dtype == np.uint16 else array))
