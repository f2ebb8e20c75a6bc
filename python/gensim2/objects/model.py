"""Define the model of an object with one joint before the object is prepared for simulation."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.shapes import Mesh, transform
from gensim2.objects.types import Keypoint, joint_motion

ROOT_LINK = "base"


@dataclass(frozen=True)
class LinkGeometry:
    """Geometry of a link, in metres in the link frame.

    Attributes:
        hulls: convex parts (N, 3) for mass and stability; also used for collisions if ``solid`` is None.
        meshes: visual meshes.
        solid: convex parts for collision, if these differ from ``hulls``; otherwise None.
    """

    hulls: list[Array]
    meshes: list[Mesh]
    solid: list[Array] | None = None

    @property
    def collides(self) -> list[Array]:
        """Return the convex collision parts."""
        return self.hulls if self.solid is None else self.solid


@dataclass(frozen=True)
class Model:
    """An object with one joint, at its final size.

    Attributes:
        body: fixed geometry, in the root frame.
        moving: geometry of the moving link, in its frame.
        T_root_link: (4, 4) pose of the moving link in the root frame at joint value zero.
        axis: (3,) unit joint axis through the moving link's origin, in the moving link's frame.
        T_link_object: (4, 4) object frame in the moving link's frame.
        content_hash: hex digest of all inputs of the model.
        license: licence terms of the data.
        warnings: irregularities in the files, and how they were repaired.
    """

    asset_class: str
    id: str
    source: Literal["generated", "real"]
    body: LinkGeometry
    moving: LinkGeometry
    joint_name: str
    joint_type: Literal["revolute", "prismatic"]
    moving_link: str
    T_root_link: Array
    axis: Array
    lower: float
    upper: float
    keypoints: dict[str, Keypoint]
    T_link_object: Array
    object_axis: Literal["x", "y", "z"]
    content_hash: str
    license: str
    root_link: str = ROOT_LINK
    warnings: tuple[str, ...] = field(default=())

    def T_root_link_at(self, q: float) -> Array:
        """Return the pose (4, 4) of the moving link in the root frame at joint value ``q``."""
        return np.asarray(self.T_root_link @ joint_motion(self.joint_type, self.axis, q))

    def keypoint_in_root(self, name: str, q: float) -> Array:
        """Return a keypoint (3,) in the root frame at joint value ``q``."""
        keypoint = self.keypoints[name]
        if keypoint.link == self.root_link:
            return keypoint.position
        return np.asarray(transform(self.T_root_link_at(q), keypoint.position[None])[0])
