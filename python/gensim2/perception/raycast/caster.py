"""Cast rays at links in given poses. Each link has an Embree scene, and rays are transformed into link frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.perception import Camera
from gensim2.perception.raycast.shapes import Color, Surface, Texture

NEAR = 1e-3
"""Depth (m) below which a bounding box is assumed to cover the whole image."""


@dataclass(frozen=True, eq=False)
class CastSolid:
    """A visible rigid body.

    Attributes:
        id: segmentation id, from 1.
        surface: surface in the frame of the body.
        still: whether the body rarely moves. The caster keeps the ray hits of such bodies for later images.
    """

    id: int
    surface: Surface
    still: bool


@dataclass(frozen=True, eq=False)
class Hits:
    """For each ray of several cameras, the surface that the ray hits first.

    Attributes:
        depth: for each camera, depth (H, W), m; the camera's ``far`` for rays without a hit.
        face: for each camera, index (H, W) of the hit triangle among all triangles of the caster; -1 for rays without a
            hit.
        u, v: for each camera, barycentric coordinates (H, W) of the hit: weights of the triangle's second and third
            corner. They are valid only for hits on textured triangles.
    """

    depth: tuple[npt.NDArray[np.float32], ...]
    face: tuple[npt.NDArray[np.int32], ...]
    u: tuple[npt.NDArray[np.float32], ...]
    v: tuple[npt.NDArray[np.float32], ...]

    @staticmethod
    def none(cameras: Sequence[Camera]) -> Hits:
        sizes = [(camera.height, camera.width) for camera in cameras]
        return Hits(
            tuple(np.full(s, c.far, dtype=np.float32) for s, c in zip(sizes, cameras, strict=True)),
            tuple(np.full(s, -1, dtype=np.int32) for s in sizes),
            tuple(np.zeros(s, dtype=np.float32) for s in sizes),
            tuple(np.zeros(s, dtype=np.float32) for s in sizes),
        )

    def copy(self) -> Hits:
        return Hits(_copied(self.depth), _copied(self.face), _copied(self.u), _copied(self.v))


_Kept = TypeVar("_Kept", bound=npt.NDArray[Any])


def _copied(arrays: tuple[_Kept, ...]) -> tuple[_Kept, ...]:
    return tuple(array.copy() for array in arrays)


class Caster:
    """Casts the rays of cameras at solids.

    Rays are cast at still solids only once, and the hits are reused until one of these solids moves.

    Args:
        solids: L solids.
        cameras: cameras that see the solids.
    """

    def __init__(self, solids: Sequence[CastSolid], cameras: Sequence[Camera]) -> None:
        self.cameras = tuple(cameras)
        self._solids = tuple(solids)
        counts = [len(solid.surface.faces) for solid in solids]
        self._first = np.cumsum([0, *counts])
        # A ray without a hit has the face index -1. This index selects the last row of ``_ids`` and of ``_colors``, so
        # a ray without a hit gets the id 0 and the colour black.
        self._ids = np.repeat([*(solid.id for solid in solids), 0], [*counts, 1]).astype(np.int16)
        self._colors = np.concatenate([*(solid.surface.colors for solid in solids), np.zeros((1, 3), dtype=np.uint8)])
        self._textures = [
            (start, texture)
            for start, solid in zip(self._first, solids, strict=False)
            for texture in solid.surface.textures
        ]
        self._still = [index for index, solid in enumerate(solids) if solid.still]
        self._moving = [index for index, solid in enumerate(solids) if not solid.still]
        self._corners = np.stack([solid.surface.corners for solid in solids])
        self._projections = np.stack([camera.projection for camera in cameras])
        self._background: tuple[bytes, Hits] | None = None

    def cast(self, poses: Array) -> Hits:
        """Cast the rays of all pixels.

        Args:
            poses: (L, 4, 4) poses of the solids in the base frame.
        """
        hits = self._stood(poses).copy()
        self._cast(self._moving, poses, hits)
        return hits

    def segmentation(self, face: npt.NDArray[np.int32]) -> npt.NDArray[np.int16]:
        """Return the segmentation id of each pixel. ``face`` is an array of any shape with the index of the face that
        each ray hits. The result has the same shape; it is 0 for a ray without a hit.
        """
        return self._ids[face]

    def normals(self, face: npt.NDArray[np.int32], poses: Array) -> npt.NDArray[np.float32]:
        """Return the unit normals (..., 3) of the hit triangles ``face``. ``poses`` (L, 4, 4) are the poses of the
        solids.
        """
        turns = poses[:, :3, :3].astype(np.float32)
        turned = [solid.surface.normals @ turn.T for solid, turn in zip(self._solids, turns, strict=True)]
        return np.asarray(np.concatenate(turned)[face])

    def colors(self, face: npt.NDArray[np.int32], u: npt.NDArray[np.float32], v: npt.NDArray[np.float32]) -> Color:
        """Return the colours (..., 3) at the hits, from material or texture; black without a hit."""
        found = self._colors[face]
        for start, texture in self._textures:
            _paint(found, face - start, u, v, texture)
        return found

    def _stood(self, poses: Array) -> Hits:
        key = poses[self._still].tobytes()
        if self._background is None or self._background[0] != key:
            hits = Hits.none(self.cameras)
            self._cast(self._still, poses, hits)
            self._background = key, hits
        return self._background[1]

    def _cast(self, which: list[int], poses: Array, hits: Hits) -> None:
        if not which:
            return
        boxes = self._boxes(which, poses)
        for number, index in enumerate(which):
            solid, pose = self._solids[index], poses[index].astype(np.float32)
            for view, camera in enumerate(self.cameras):
                left, top, right, bottom = boxes[view][number]
                if left < right and top < bottom:
                    window = (slice(top, bottom), slice(left, right))
                    self._meet(solid, int(self._first[index]), pose, camera, window, hits, view)

    def _meet(
        self,
        solid: CastSolid,
        first: int,
        pose: npt.NDArray[np.float32],
        camera: Camera,
        window: tuple[slice, slice],
        hits: Hits,
        view: int,
    ) -> None:
        depth, face = hits.depth[view][window], hits.face[view][window]
        turn = pose[:3, :3]
        rays = camera.rays[window].reshape(-1, 3) @ turn
        origins = np.empty_like(rays)
        origins[:] = (camera.position - pose[:3, 3]) @ turn
        # Embree writes the depths of the new hits into its input array, so pass a copy of the depths found so far.
        reach = depth.reshape(-1).copy()
        met = solid.surface.scene.run(origins, rays, reach, output=True)
        number = met["primID"].reshape(face.shape)
        new = number >= 0
        np.copyto(depth, reach.reshape(face.shape), where=new)
        np.copyto(face, number + first, where=new)
        if solid.surface.textures:
            np.copyto(hits.u[view][window], met["u"].reshape(face.shape), where=new)
            np.copyto(hits.v[view][window], met["v"].reshape(face.shape), where=new)

    def _boxes(self, which: list[int], poses: Array) -> list[list[list[int]]]:
        """Return, for each camera and solid, a rectangle of pixels that contains the image of the solid, as left, top,
        right and bottom pixel coordinates.
        """
        # shape (l, 4, 8): homogeneous box corners of l solids
        corners = poses[which] @ self._corners[which].transpose(0, 2, 1)
        seen = self._projections[:, None] @ corners  # shape (cameras, l, 3, 8): projected box corners
        ahead = seen[:, :, 2].clip(min=NEAR)
        pixels = seen[:, :, :2] / ahead[:, :, None]
        low, high = np.floor(pixels.min(axis=3)) - 1, np.ceil(pixels.max(axis=3)) + 1
        behind = seen[:, :, 2].min(axis=2) < NEAR
        low[behind], high[behind] = -np.inf, np.inf
        low[seen[:, :, 2].max(axis=2) < NEAR] = np.inf
        sizes = np.array([[camera.width, camera.height] for camera in self.cameras])[:, None]
        boxes = np.concatenate([low.clip(0, sizes), high.clip(0, sizes)], axis=2)
        found: list[list[list[int]]] = boxes.astype(np.int64).tolist()
        return found


def _paint(
    colors: Color,
    face: npt.NDArray[np.int32],
    u: npt.NDArray[np.float32],
    v: npt.NDArray[np.float32],
    texture: Texture,
) -> None:
    """Write the colours of a texture into ``colors``, for all pixels that show a face with this texture. For each
    pixel, ``face`` contains the index of the visible face, and ``u`` and ``v`` contain the barycentric coordinates of
    the visible point on this face.
    """
    row = np.searchsorted(texture.faces, face)
    wears = row < len(texture.faces)
    wears[wears] = texture.faces[row[wears]] == face[wears]
    if wears.any():
        colors[wears] = texture.at(row[wears], u[wears], v[wears])
