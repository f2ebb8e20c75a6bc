"""Compute, by ray casting, the depth, the normals and the links of the robot's surface as seen by a camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.perception import Camera
from gensim2.perception.raycast.caster import Caster, CastSolid
from gensim2.perception.raycast.kinematics import Tree, read_urdf
from gensim2.perception.raycast.shapes import read_links
from gensim2.robots import RobotProfile

Depth = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class ArmView:
    """An image of a robot at rest.

    Attributes:
        q: (n,) all active joints.
        depth: (H, W) depth, m; 0 for pixels without a measurement.
    """

    q: Array
    depth: Depth


@dataclass(frozen=True, eq=False)
class RobotView:
    """The robot's meshes as seen by a camera.

    Attributes:
        depth: (H, W) depth, m; infinity for pixels that do not show the robot.
        normals: (H, W, 3) normals towards the camera, in the base frame; 0 for pixels that do not show the robot.
        links: (H, W) index of the link; -1 for pixels that do not show the robot.
    """

    depth: Depth
    normals: npt.NDArray[np.float32]
    links: npt.NDArray[np.int16]


class RobotSurface:
    """Meshes of a robot.

    Attributes:
        names: names of the robot's links.
    """

    def __init__(self, profile: RobotProfile) -> None:
        self._tree = Tree.of(read_urdf(profile.urdf), (*profile.arm_joints, *profile.gripper.joints))
        self.names = self._tree.names
        surfaces = read_links(self._tree.file)
        self._shown = [number for number, name in enumerate(self.names) if surfaces[name] is not None]
        self._solids, normals = [], []
        for number in self._shown:
            surface = surfaces[self.names[number]]
            assert surface is not None
            self._solids.append(CastSolid(number + 1, surface, still=False))
            corners = surface.vertices[surface.faces].astype(np.float64)
            across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            normals.append(across / np.linalg.norm(across, axis=1, keepdims=True).clip(1e-12))
        self._normals = np.concatenate(normals).astype(np.float32)
        self._link_of = np.repeat(self._shown, [len(each) for each in normals]).astype(np.int16)

    def see(self, camera: Camera, q: Array) -> RobotView:
        """Return a camera's view of the robot at joints ``q`` (n,); the camera's pose is in the base frame."""
        poses = self._tree.poses(np.eye(4)[None], q[None])[0]
        hits = Caster(self._solids, [camera]).cast(poses[self._shown])
        face = hits.face[0]
        there = face >= 0
        links = np.where(there, self._link_of[face], np.int16(-1))
        turns = poses[:, :3, :3].astype(np.float32)
        normals = np.zeros((*face.shape, 3), dtype=np.float32)
        normals[there] = np.einsum("kij,kj->ki", turns[links[there]], self._normals[face[there]])
        away = (normals * camera.rays).sum(axis=2) > 0.0
        normals[away] *= -1.0
        return RobotView(np.where(there, hits.depth[0], np.float32(np.inf)), normals, links)


def shrunk(camera: Camera, by: int) -> Camera:
    """Return the camera with width and height divided by ``by``. One of its pixels covers ``by`` x ``by`` pixels."""
    scale = np.diag([1.0 / by, 1.0 / by, 1.0])
    return replace(camera, width=camera.width // by, height=camera.height // by, intrinsic=scale @ camera.intrinsic)


def check_views(camera: Camera, views: Sequence[ArmView]) -> None:
    """Check that images have the size of the camera.

    Raises:
        InputError: an image has a different size.
    """
    for view in views:
        if view.depth.shape != (camera.height, camera.width):
            wrong = f"has the shape {view.depth.shape}, but the camera's images have ({camera.height}, {camera.width})"
            raise InputError(wrong, field=f"{camera.name}.depth")
