"""The one way from a robot's joints and its cameras' pictures to an observation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error
from gensim2.perception.cloud import PointCloud, RobotSegments, point_cloud
from gensim2.perception.columns import DEPTH, IMAGE, SEGMENTATION, depth_column
from gensim2.perception.observation import Observation
from gensim2.perception.proprioception import Proprioception
from gensim2.perception.spec import ObservationSpec
from gensim2.perception.view import View
from gensim2.robots import RobotProfile


class Encoder:
    """Observations of one robot by one spec, whoever drives it.

    Args:
        spec: what is seen.
        profile: of the robot.
        language: what is to be done.
        robot: ids by which segmentation knows the robot; None: it is kept as anything else is.
    """

    def __init__(
        self, spec: ObservationSpec, profile: RobotProfile, language: str = "", robot: RobotSegments | None = None
    ) -> None:
        self.spec, self._profile, self._language, self._robot = spec, profile, language, robot

    def encode(
        self,
        step: int,
        positions: npt.ArrayLike,
        velocities: npt.ArrayLike,
        command: float,
        views: Sequence[View] = (),
        pictures: Mapping[str, npt.NDArray[np.uint8]] | None = None,
        known: PointCloud | None = None,
    ) -> Observation:
        """The observation of one instant.

        Args:
            step: control steps since the reset.
            positions, velocities: (n,) of all active joints.
            command: the gripper's last, -1 to 1.
            views: the cameras' pictures, for all that is not ``rgb``.
            pictures: (H, W, 3) by camera, for ``rgb``.
            known: cloud that is not made of the cameras' pictures, of a spec that says so.

        Raises:
            EmptyCloudError: the cameras see nothing that a point cloud keeps.
        """
        modalities = self.spec.modalities
        own = Proprioception(self._profile, positions, velocities, command)
        seen: dict[str, Any] = {}
        for view in views:
            name = view.camera.name
            if "depth" in modalities:
                seen[DEPTH + name] = depth_column(view.depth)
            if "segmentation" in modalities:
                if view.segmentation is None:
                    raise GenSim2Error(f"the camera {name!r} gives no segmentation")
                seen[SEGMENTATION + name] = view.segmentation
        if "rgb" in modalities:
            if pictures is None:
                raise GenSim2Error("there are no colour pictures: no renderer was given")
            for name in self.spec.cameras:
                seen[IMAGE + name] = pictures[name]
        cloud = known
        if "pointcloud" in modalities:
            if self.spec.cloud.source == "depth":
                cloud = point_cloud(views, self.spec.cloud, self._robot)
            elif known is None:
                raise GenSim2Error("only a simulator knows the keypoints that the point cloud is to be made of")
        return Observation(
            step=step,
            time=step / self._profile.control_hz,
            language=self._language,
            arrays={**own, **seen} if seen else own,
            cloud=cloud,
            cameras={view.camera.name: view.camera for view in views},
        )
