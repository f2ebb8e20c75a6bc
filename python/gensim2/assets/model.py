"""A rigid model with one joint, whatever it was made from: the value between the sources and the cache."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from gensim2.assets.blueprint import Blueprint
from gensim2.assets.shapes import Mesh, Solid, pose, rotation, transform
from gensim2.assets.types import Keypoint

Array = npt.NDArray[np.float64]

ROOT_LINK = "base"

# Model frame (y up, z front) in the root frame (z up, front towards -x), as in every PartNet-Mobility model.
R_ROOT_MODEL = rotation((0, 0, 1), -np.pi / 2) @ rotation((1, 0, 0), np.pi / 2)
T_ROOT_MODEL = np.eye(4)
T_ROOT_MODEL[:3, :3] = np.round(R_ROOT_MODEL)


@dataclass(frozen=True)
class LinkGeometry:
    """Collision hulls, each (N, 3), and visual meshes of a link, metres in the link frame."""

    hulls: list[Array]
    meshes: list[Mesh]


@dataclass(frozen=True)
class Model:
    """An object with one joint, at its final size.

    Attributes:
        body: geometry that stands still, in the root frame.
        moving: geometry that the joint moves, in the moving link's frame.
        T_root_link: (4, 4) moving link at joint value zero, in the root frame.
        axis: (3,) unit joint axis through the moving link's origin, in the moving link's frame.
        T_link_object: (4, 4) object frame in the moving link's frame.
        content_hash: hex digest of everything that the model was made from.
        license: terms of the data.
        warnings: what was odd and how it was repaired.
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
        """(4, 4) moving link in the root frame at joint value ``q``."""
        motion = pose(q * self.axis) if self.joint_type == "prismatic" else pose(axis=self.axis, angle=q)
        return np.asarray(self.T_root_link @ motion)

    def keypoint_in_root(self, name: str, q: float) -> Array:
        """(3,) keypoint in the root frame at joint value ``q``."""
        keypoint = self.keypoints[name]
        if keypoint.link == self.root_link:
            return keypoint.position
        return np.asarray(transform(self.T_root_link_at(q), keypoint.position[None])[0])


def _geometry(solids: list[Solid], T: Array) -> LinkGeometry:
    moved = [solid.moved(T) for solid in solids]
    return LinkGeometry([s.hull for s in moved if s.hull is not None], [s.mesh for s in moved if s.mesh is not None])


def from_blueprint(asset_class: str, number: int, blueprint: Blueprint, content_hash: str, license: str) -> Model:
    """Turn a blueprint, written in the model frame, into a model."""
    origin = np.asarray(blueprint.joint_origin, float)
    axis = np.asarray(blueprint.joint_axis, float) / np.linalg.norm(blueprint.joint_axis)
    T_link_model = pose(-origin)
    keypoints = {}
    for name, (position, description) in blueprint.keypoints.items():
        p = np.asarray(position, float)[None]
        if "base" in name:
            keypoints[name] = Keypoint("base", transform(T_ROOT_MODEL, p)[0], description)
        else:
            keypoints[name] = Keypoint("link_0", transform(T_link_model, p)[0], description)
    return Model(
        asset_class=asset_class,
        id=str(number),
        source="generated",
        body=_geometry(blueprint.body, T_ROOT_MODEL),
        moving=_geometry(blueprint.moving, T_link_model),
        joint_name="joint_0",
        joint_type=blueprint.joint_type,
        moving_link="link_0",
        T_root_link=T_ROOT_MODEL @ pose(origin),
        axis=axis,
        lower=float(blueprint.limits[0]),
        upper=float(blueprint.limits[1]),
        keypoints=keypoints,
        T_link_object=T_link_model,
        object_axis=blueprint.object_axis,
        content_hash=content_hash,
        license=license,
    )
