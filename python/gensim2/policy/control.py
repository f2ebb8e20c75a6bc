"""Controls of what a policy sees: nothing of the scene, or another scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from gensim2.errors import InputError
from gensim2.observations import Observation
from gensim2.policy.array_file import read_arrays, write_arrays
from gensim2.seeding import rng

CLOUDS = "clouds.npz"
"""Clouds of scenes that were trained on, beside a checkpoint."""
MAX_CLOUDS = 64

Sees = Literal["all", "nothing", "other"]
"""Ablation of the clouds: none, points at the origin, or the cloud of another scene."""


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
            InputError: there are none.
        """
        try:
            arrays = read_arrays(folder / CLOUDS)
            return Shuffled(arrays["points"], arrays["colours"])
        except (InputError, KeyError) as error:
            raise InputError("holds no clouds of other scenes", file=folder, remedy="train the policy again") from error

    def save(self, folder: Path) -> None:
        """Write them beside a checkpoint.

        Raises:
            WriteError: the folder cannot be written to.
        """
        write_arrays(folder / CLOUDS, {"points": self.points, "colours": self.colours})


def altered(observation: Observation, sees: Sees, others: Shuffled | None, seed: int) -> Observation:
    """The observation with what the control lets be seen: the cloud with all points at the base's origin, or that of a
    scene that the episode's seed draws.
    """
    if sees == "all":
        return observation
    cloud = observation.cloud
    assert cloud is not None
    points, colours = np.zeros_like(cloud.xyz), np.zeros_like(cloud.rgb)
    if others is not None:
        drawn = int(rng(seed, "policy/other").integers(len(others.points)))
        points, colours = others.points[drawn].astype(np.float32), others.colours[drawn]
    return replace(observation, cloud=replace(cloud, xyz=points, rgb=colours))
