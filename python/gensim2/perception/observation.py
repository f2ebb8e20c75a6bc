"""One instant as whoever decides sees it: in simulation, in recordings, on a robot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.perception.camera import Camera
from gensim2.perception.cloud import PointCloud
from gensim2.perception.columns import CLOUD, CLOUD_SEGMENTATION, GRIPPER, STATE, TOOL_POSE, VELOCITY, cloud_column

Array = npt.NDArray[Any]


@dataclass(frozen=True, eq=False)
class Observation(Mapping[str, Array]):
    """Observation of one instant; as a mapping, arrays by the names that they have in exports.

    Attributes:
        step: control steps since the reset.
        time: seconds since the reset.
        language: what is to be done, a sentence.
        arrays: by name (:mod:`gensim2.perception.columns`), but for the point cloud.
        cloud: the point cloud; None where none was asked for.
        cameras: those that were looked through, by name: intrinsics, and poses in the base frame.
    """

    step: int
    time: float
    language: str
    arrays: Mapping[str, Array]
    cloud: PointCloud | None
    cameras: Mapping[str, Camera]

    @property
    def joint_positions(self) -> npt.NDArray[np.float32]:
        """(n,) of all active joints, rad and m."""
        return self.arrays[STATE]

    @property
    def joint_velocities(self) -> npt.NDArray[np.float32]:
        """(n,) rad/s and m/s."""
        return self.arrays[VELOCITY]

    @property
    def T_base_tool(self) -> npt.NDArray[np.float64]:
        """(4, 4) tool in the robot's base frame."""
        pose = self.arrays[TOOL_POSE].astype(np.float64)
        found = np.eye(4)
        from scipy.spatial.transform import Rotation  # here: who refuses an argument needs it not

        found[:3, :3] = Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()
        found[:3, 3] = pose[:3]
        return found

    @property
    def gripper_width(self) -> float:
        """Distance of the pads, m."""
        return float(self.arrays[GRIPPER][0])

    @property
    def gripper_command(self) -> float:
        """The last command, from -1 (closed) to 1 (open)."""
        return float(self.arrays[GRIPPER][1])

    def _own_names(self) -> tuple[str, ...]:
        if self.cloud is None:
            return ()
        return (CLOUD,) if self.cloud.segmentation is None else (CLOUD, CLOUD_SEGMENTATION)

    def __getitem__(self, name: str) -> Array:
        if name in self._own_names():
            assert self.cloud is not None
            if name == CLOUD:
                return cloud_column(self.cloud.xyz, self.cloud.rgb)
            assert self.cloud.segmentation is not None
            return self.cloud.segmentation
        return self.arrays[name]

    def __iter__(self) -> Iterator[str]:
        yield from self.arrays
        yield from self._own_names()

    def __len__(self) -> int:
        return len(self.arrays) + len(self._own_names())
