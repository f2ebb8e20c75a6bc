"""Ablations of the observed point cloud: blank, or from another scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.perception import Observation
from gensim2.policy.array_file import read_arrays, require_shapes, write_arrays

CLOUDS = "clouds.npz"
"""Clouds of scenes that were trained on, beside a checkpoint."""
MAX_CLOUDS = 64
MAX_BYTES = 2**26
"""Bytes of their file: 64 clouds of the most points have 47 MB."""

Sees = Literal["all", "nothing", "other"]
"""Ablation of the cloud: none, all points at the base's origin, or the cloud of another scene."""


@dataclass(frozen=True)
class Shuffled:
    """Clouds of other scenes.

    Attributes:
        points: (S, N, 3) m in the base frame.
        colours: (S, N, 3).
    """

    points: npt.NDArray[np.float32]
    colours: npt.NDArray[np.uint8]

    @staticmethod
    def of(folder: Path) -> Shuffled:
        """Those beside a checkpoint.

        Raises:
            InputError: there are none, or their file is damaged.
        """
        path, remedy = folder / CLOUDS, "train the policy again"
        if not path.exists():
            raise InputError("holds no clouds of other scenes", file=folder, remedy=remedy)
        arrays = read_arrays(path, MAX_BYTES)
        shape = (None, None, 3)
        require_shapes(arrays, {"points": (np.float32, shape), "colours": (np.uint8, shape)}, path)
        points, colours = arrays["points"], arrays["colours"]
        if points.shape != colours.shape or not points.size:
            raise InputError("is damaged: has no clouds", file=path, remedy=remedy)
        return Shuffled(points, colours)

    def save(self, folder: Path) -> None:
        """Write them beside a checkpoint.

        Raises:
            WriteError: the folder cannot be written to.
        """
        write_arrays(folder / CLOUDS, {"points": self.points, "colours": self.colours})


@dataclass(frozen=True)
class Sight:
    """Ablation of a policy's observations.

    Attributes:
        sees: ``"all"``, or the ablation.
        others: clouds of other scenes, for ``"other"``.
    """

    sees: Sees
    others: Shuffled | None

    @staticmethod
    def of(sees: Sees, folder: Path) -> Sight:
        """Ablation of a policy, with the clouds beside its checkpoint.

        Raises:
            InputError: there is no such ablation, or there are no clouds.
        """
        if sees not in get_args(Sees):
            raise InputError(f"must be one of {', '.join(get_args(Sees))}, is {sees!r}", field="sees")
        return Sight(sees, Shuffled.of(folder) if sees == "other" else None)

    def altered(self, observation: Observation, seed: int) -> Observation:
        """Return the observation with its cloud replaced: all points at the base's origin, or the cloud of a scene
        drawn by the episode's seed.
        """
        if self.sees == "all":
            return observation
        cloud = observation.cloud
        assert cloud is not None
        points, colours = np.zeros_like(cloud.xyz), np.zeros_like(cloud.rgb)
        if self.others is not None:
            drawn = int(rng(seed, "policy/other").integers(len(self.others.points)))
            points, colours = self.others.points[drawn].astype(np.float32), self.others.colours[drawn]
        return replace(observation, cloud=replace(cloud, xyz=points, rgb=colours))
