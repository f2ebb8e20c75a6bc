"""Replace the policy's point cloud by zeros or by a cloud of another scene.

A comparison with the original cloud shows how much the policy uses its cloud.
"""

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
"""Name of the file with clouds of training scenes in a checkpoint's folder."""
MAX_CLOUDS = 64
RESOLUTION = 1e-3
"""Resolution of the coordinates in the file of clouds, m."""
MAX_BYTES = 2**26
"""Maximum size of the arrays in the file of clouds, bytes; 64 of the largest clouds take 47 MB."""

Sees = Literal["all", "nothing", "other"]
"""Point cloud that a policy gets: the observed cloud, all points at the base's origin, or another scene's cloud."""


@dataclass(frozen=True)
class Shuffled:
    """Point clouds of training scenes, for the control experiment with the clouds of other scenes.

    Random clouds of other scenes. These clouds replace the policy's cloud to measure how much the policy depends on it.

    Attributes:
        points: (S, N, 3) points of S clouds, m, base frame.
        colours: (S, N, 3) colours of the points, 0 to 255.
    """

    points: npt.NDArray[np.float32]
    colours: npt.NDArray[np.uint8]

    @staticmethod
    def of(folder: Path) -> Shuffled:
        """Read the file of clouds in a checkpoint's folder.

        Raises:
            InputError: the file of clouds is missing or damaged.
        """
        path, remedy = folder / CLOUDS, "train the policy again"
        if not path.exists():
            wrong = f"the checkpoint has no file {CLOUDS} with point clouds for the control experiment 'shuffled'"
            raise InputError(wrong, file=folder, remedy=remedy)
        arrays = read_arrays(path, MAX_BYTES)
        shape = (None, None, 3)
        require_shapes(arrays, {"points": (np.float32, shape), "colours": (np.uint8, shape)}, path)
        points, colours = arrays["points"], arrays["colours"]
        if points.shape != colours.shape or not points.size:
            wrong = "is damaged: there are no point clouds, or the number of colours differs from the number of points"
            raise InputError(wrong, file=path, remedy=remedy)
        return Shuffled(points, colours)

    def save(self, folder: Path) -> None:
        """Write the clouds to a file in a checkpoint's folder, with coordinates rounded to 1 mm, and the points of each
        cloud sorted by their coordinates.

        Raises:
            WriteError: the folder cannot be written to.
        """
        # The control experiment needs no exact points and no order. Rounded and sorted coordinates take less space.
        points = (np.round(self.points / RESOLUTION) * RESOLUTION).astype(np.float32)
        order = np.stack([np.lexsort(cloud.T[::-1]) for cloud in points])[..., None]
        # Coordinates of the same axis are alike, so they take less space one after the other.
        points = np.asfortranarray(np.take_along_axis(points, order, axis=1))
        colours = np.take_along_axis(self.colours, order, axis=1)
        write_arrays(folder / CLOUDS, {"points": points, "colours": colours})


@dataclass(frozen=True)
class Sight:
    """Replacement of the point clouds that a policy observes, to measure how much the policy depends on them.

    Attributes:
        sees: cloud that the policy gets. ``"all"``: the observed cloud; ``"nothing"``: zeros; ``"other"``: a cloud of
            another scene.
        others: clouds of other scenes; None unless ``sees`` is ``"other"``.
    """

    sees: Sees
    others: Shuffled | None

    @staticmethod
    def of(sees: Sees, folder: Path) -> Sight:
        """Return the replacement named ``sees``. For ``"other"``, the clouds are read from the checkpoint's folder.

        Raises:
            InputError: ``sees`` is unknown, or the clouds are missing.
        """
        if sees not in get_args(Sees):
            raise InputError(f"must be one of {', '.join(get_args(Sees))}, but is {sees!r}", field="sees")
        return Sight(sees, Shuffled.of(folder) if sees == "other" else None)

    def altered(self, observation: Observation, seed: int) -> Observation:
        """Return the observation with the replaced cloud. The episode's ``seed`` selects the other scene."""
        if self.sees == "all":
            return observation
        cloud = observation.cloud
        assert cloud is not None
        points, colours = np.zeros_like(cloud.xyz), np.zeros_like(cloud.rgb)
        if self.others is not None:
            drawn = int(rng(seed, "policy/other").integers(len(self.others.points)))
            points, colours = self.others.points[drawn].astype(np.float32), self.others.colours[drawn]
        return replace(observation, cloud=replace(cloud, xyz=points, rgb=colours))
