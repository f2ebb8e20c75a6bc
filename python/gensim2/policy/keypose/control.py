"""Controls of what a policy sees: nothing of the scene, or another scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gensim2.errors import InputError
from gensim2.observations import Observation
from gensim2.seeding import rng

CLOUDS = "clouds.npz"
"""Clouds of scenes that were trained on, beside a checkpoint."""
MOST_CLOUDS = 64


@dataclass(frozen=True)
class Shuffled:
    """Clouds of other scenes.

    Attributes:
        points: (S, N, 3) m in the base frame.
    """

    points: npt.NDArray[np.float32]

    @staticmethod
    def of(folder: Path) -> Shuffled:
        """Those beside a checkpoint.

        Raises:
            InputError: there are none.
        """
        try:
            with np.load(folder / CLOUDS, allow_pickle=False) as archive:
                return Shuffled(archive["points"])
        except (OSError, ValueError, KeyError) as error:
            raise InputError("holds no clouds of other scenes", file=folder, remedy="train the policy again") from error


def altered(observation: Observation, sees: str, others: Shuffled | None, seed: int) -> Observation:
    """The observation with what the control lets be seen: the cloud with all points at the base's origin, or that of a
    scene that the episode's seed draws.
    """
    if sees == "all":
        return observation
    cloud = observation.cloud
    assert cloud is not None
    points = np.zeros_like(cloud.xyz)
    if others is not None:
        points = others.points[int(rng(seed, "keypose/other").integers(len(others.points)))]
    return replace(observation, cloud=replace(cloud, xyz=points.astype(np.float32)))
