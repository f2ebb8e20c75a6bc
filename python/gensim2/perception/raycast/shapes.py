"""Read the visible surfaces of links: triangles with the colour of a material or with a texture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from gensim2.core.arrays import Array
from gensim2.core.foreign.geometry import opened_mesh
from gensim2.objects.library.urdf import Urdf, shape_elements
from gensim2.perception.raycast.kinematics import read_urdf

Color = npt.NDArray[np.uint8]

SPHERE_DETAIL = 3  # subdivisions of a sphere
WHITE = (255, 255, 255)

NEARLY = 0.01
"""Maximum difference of a node's transform from the identity at which SAPIEN's mesh reader (assimp) ignores the
transform. This module ignores such transforms, too, so that its images equal SAPIEN's; one of them shifts the Panda's
link 4 by 3 mm.
"""


@dataclass(frozen=True, eq=False)
class Texture:
    """A texture on some faces of a shape.

    Attributes:
        image: (h, w, 3) image; the first row is on top.
        faces: (n,) indices of the faces with this texture.
        corners: (n, 3, 2) texture coordinates of the faces' corners, 0 to 1, from the lower left.
    """

    image: Color
    faces: npt.NDArray[np.int64]
    corners: npt.NDArray[np.float32]

    def at(self, rows: npt.NDArray[np.int64], u: npt.NDArray[np.float32], v: npt.NDArray[np.float32]) -> Color:
        """Look up the texture's colours (k, 3) at points on the textured faces. The nearest pixel of the texture is
        used.

        Args:
            rows: (k,) indices into ``faces``.
            u, v: (k,) position of each point on its face: barycentric weights of the face's second and third corners.
        """
        weights = np.stack([1.0 - u - v, u, v], axis=-1)
        place = np.einsum("kc,kcx->kx", weights, self.corners[rows])
        height, width = self.image.shape[:2]
        column = np.floor((place[:, 0] % 1.0) * width).astype(np.int64).clip(0, width - 1)
        row = np.floor(((1.0 - place[:, 1]) % 1.0) * height).astype(np.int64).clip(0, height - 1)
        return np.asarray(self.image[row, column])


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles in the frame of a link.

    Attributes:
        vertices: (V, 3) vertices, m.
        faces: (F, 3) vertex indices.
        colors: (F, 3) colours of the material; ``textures`` override them.
        textures: textures of some faces.
    """

    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.int32]
    colors: Color
    textures: tuple[Texture, ...] = ()

    @cached_property
    def scene(self) -> Any:
        """Embree scene of the triangles."""
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        scene = EmbreeScene()
        TriangleMesh(scene, self.vertices, self.faces)
        return scene

    @cached_property
    def corners(self) -> Array:
        """Corners (8, 4) of the surface's bounding box in homogeneous coordinates, m."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        signs = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).T.reshape(-1, 3)
        return np.column_stack([np.where(signs, high, low), np.ones(8)]).astype(np.float64)

    @cached_property
    def normals(self) -> npt.NDArray[np.float32]:
        """(F, 3) unit normals of the faces; zero for a face without an area."""
        corners = self.vertices[self.faces]
        found = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True).clip(min=1e-12), dtype=np.float32)

    def moved(self, T: Array, scale: float | Array = 1.0) -> Surface:
        """Return the surface scaled and transformed by ``T`` (4, 4)."""
        vertices = (scale * self.vertices.astype(np.float64)) @ T[:3, :3].T + T[:3, 3]
        return Surface(vertices.astype(np.float32), self.faces, self.colors, self.textures)

    def painted(self, color: Sequence[int] | None) -> Surface:
        """Return the surface in the colour ``color``; None keeps the colours."""
        if color is None:
            return self
        return Surface(self.vertices, self.faces, np.tile(np.array(color, dtype=np.uint8), (len(self.faces), 1)))

    @staticmethod
    def box(center: Sequence[float], half_size: Sequence[float], color: Sequence[int]) -> Surface:
        """Return an axis-aligned box in one colour."""
        shape = trimesh.creation.box(2.0 * np.asarray(half_size))
        bare = _surface(np.asarray(shape.vertices) + center, np.asarray(shape.faces))
        return bare.painted(color)

    @staticmethod
    def joined(surfaces: Sequence[Surface]) -> Surface | None:
        """Join surfaces into one surface; None if there is no surface."""
        if not surfaces:
            return None
        first_vertex = np.cumsum([0, *(len(each.vertices) for each in surfaces)])
        first_face = np.cumsum([0, *(len(each.faces) for each in surfaces)])
        return Surface(
            np.concatenate([each.vertices for each in surfaces]),
            np.concatenate(
                [each.faces + start for each, start in zip(surfaces, first_vertex[:-1], strict=True)], dtype=np.int32
            ),
            np.concatenate([each.colors for each in surfaces]),
            tuple(
                Texture(texture.image, texture.faces + start, texture.corners)
                for each, start in zip(surfaces, first_face[:-1], strict=True)
                for texture in each.textures
            ),
        )


@lru_cache(maxsize=512)
def read_mesh(file: Path) -> Surface | None:
    """Read the surface of a mesh file, in the frame of the mesh; None for a mesh without triangles.

    Raises:
        InputError: the file cannot be read.
    """
    with opened_mesh(file) as scene:
        surfaces = []
        for node in scene.graph.nodes_geometry:
            T, name = scene.graph[node]
            mesh = scene.geometry[name]
            if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                dressed = _dressed(mesh)
                surfaces.append(dressed if np.abs(T - np.eye(4)).max() <= NEARLY else dressed.moved(np.asarray(T)))
        return Surface.joined(surfaces)


@lru_cache(maxsize=128)
def read_links(file: Path) -> Mapping[str, Surface | None]:
    """Read the visible surface of each link of a URDF, in the link's frame; None for invisible links.

    Raises:
        InputError: a visual cannot be read.
    """
    urdf = read_urdf(file)
    return {link: _read_link(urdf, link) for link in urdf.links}


def _read_link(urdf: Urdf, link: str) -> Surface | None:
    surfaces = []
    for element in shape_elements(urdf, link, "visual"):
        shape = element.shape
        if isinstance(shape, str):
            surface = read_mesh(urdf.file.parent / shape)
        else:
            mesh = shape.mesh(SPHERE_DETAIL)
            surface = _surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))
        if surface is not None:
            color = None if element.rgba is None else _rgb(element.rgba)
            surfaces.append(surface.moved(element.T, element.scale).painted(color))
    return Surface.joined(surfaces)


def _surface(vertices: Array, faces: npt.NDArray[np.integer]) -> Surface:
    colors = np.full((len(faces), 3), WHITE, dtype=np.uint8)
    return Surface(vertices.astype(np.float32), faces.astype(np.int32), colors)


def _rgb(rgba: Array) -> tuple[int, ...]:
    return tuple(int(value) for value in np.round(255.0 * rgba[:3]))


def _dressed(mesh: trimesh.Trimesh) -> Surface:
    bare = _surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    material: Any = getattr(mesh.visual, "material", None)
    if material is None:
        colors = np.asarray(mesh.visual.face_colors)[:, :3] if mesh.visual.defined else bare.colors
        return Surface(bare.vertices, bare.faces, np.ascontiguousarray(colors, dtype=np.uint8))
    image, uv = _image(material), getattr(mesh.visual, "uv", None)
    if image is not None and uv is not None:
        texture = Texture(image, np.arange(len(bare.faces)), np.asarray(uv, dtype=np.float32)[bare.faces])
        return Surface(bare.vertices, bare.faces, bare.colors, (texture,))
    return bare.painted(tuple(int(value) for value in material.main_color[:3]))


def _image(material: Any) -> Color | None:
    picture = getattr(material, "baseColorTexture", None)
    if picture is None:
        picture = getattr(material, "image", None)
    return None if picture is None else np.asarray(picture.convert("RGB"))
