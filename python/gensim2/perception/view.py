"""Output of a camera: a depth picture, and what belongs to its pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from gensim2.perception.camera import Camera


class View(Protocol):
    """A picture."""

    @property
    def camera(self) -> Camera:
        """That took it."""
        ...

    @property
    def depth(self) -> npt.NDArray[np.float32]:
        """(H, W) m ahead of the camera; 0 where nothing was measured."""
        ...

    @property
    def segmentation(self) -> npt.NDArray[np.int16] | None:
        """(H, W) id of what each pixel shows, 0 for nothing; None: unknown."""
        ...

    def colors_at(self, pixels: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
        """(k, 3) of pixels, by their number in rows of the picture."""
        ...


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture that was taken: of a real camera, or with noise on it; as :class:`View` has it."""

    camera: Camera
    depth: npt.NDArray[np.float32]
    segmentation: npt.NDArray[np.int16] | None = None
    colors: npt.NDArray[np.uint8] | None = None

    def colors_at(self, pixels: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
        """(k, 3) of pixels; black where there are no colours."""
        if self.colors is None:
            return np.zeros((len(pixels), 3), dtype=np.uint8)
        return self.colors.reshape(-1, 3)[pixels]
