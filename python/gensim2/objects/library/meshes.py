"""Surfaces of one object, in the frames that its URDF puts them in."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gensim2.core.foreign.tree import Reference, shortened
from gensim2.objects.errors import AssetError, MissingFileError
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.objfile import DEFAULT_LOOK, read_obj
from gensim2.objects.library.urdf import URDF, Primitive, ShapeElement
from gensim2.objects.shapes import Look, Mesh, transform

Array = npt.NDArray[np.float64]

MAX_TRIANGLES = 2_000_000  # of all elements together
LISTED = 8  # names in a warning


class MeshReader:
    """Mesh files of one instance, each read once; what cannot be read is noted."""

    def __init__(self, folder: ObjectFolder) -> None:
        self._folder, self._read = folder, {}  # type: tuple[ObjectFolder, dict[str, list[Mesh]]]
        self._triangles = 0
        self._missing: list[str] = []
        self._broken: dict[str, str] = {}
        self._materials: dict[str, bool] = {}

    def get(self, element: ShapeElement, scale: float, T: Array) -> list[Mesh]:
        """Meshes of an element in the frame that ``T`` (unscaled) maps its link to, scaled.

        Raises:
            AssetError: the file is no OBJ file by its name, is no regular file inside the folder, or there are too many
                triangles.
        """
        place, shape = T @ element.T, element.shape
        if isinstance(shape, Primitive):
            surface = shape.mesh()
            look = DEFAULT_LOOK if element.rgba is None else Look(tuple(element.rgba.tolist()))
            meshes = [Mesh(np.asarray(surface.vertices), np.asarray(surface.faces, np.int64), look)]
        else:
            if shape not in self._read:
                self._read[shape] = self._meshes(shape, element.field)
            meshes = self._read[shape]
        found = [Mesh(scale * transform(place, element.scale * m.vertices), m.faces, m.look) for m in meshes]
        self._triangles += sum(len(m.faces) for m in found)
        if self._triangles > MAX_TRIANGLES:
            raise AssetError(
                f"its meshes have over {MAX_TRIANGLES:,} triangles",
                file=self._folder.path / URDF,
                field=element.field,
                remedy="simplify them",
            )
        return found

    def _meshes(self, name: str, field: str) -> list[Mesh]:
        if not name.lower().endswith(".obj"):
            raise AssetError(
                f"{reprlib.repr(name)} is no .obj file",
                file=self._folder.path / URDF,
                field=field,
                remedy="convert meshes to Wavefront OBJ",
            )
        try:
            meshes, materials = read_obj(self._folder, name, Reference(URDF, field))
        except MissingFileError:
            self._missing.append(name)
            return []
        except ValueError as error:
            self._broken[name] = shortened(str(error))
            return []
        self._materials |= materials
        return meshes

    @property
    def files(self) -> list[str]:
        """Mesh and material files so far, missing ones among them."""
        return [*self._read, *self._materials]

    def warnings(self) -> list[str]:
        """Parts that could not be read so far, a line a kind."""
        broken = [f"{name} ({why})" for name, why in self._broken.items()]
        kinds = {"mesh files missing": self._missing, "mesh files unreadable": broken}
        kinds["material files missing"] = [name for name, there in self._materials.items() if not there]
        return [f"{len(names)} {what}: {listed(names)}" for what, names in kinds.items() if names]


def listed(names: Sequence[str], max_count: int = LISTED) -> str:
    """The first names of several, and how many more there are."""
    more = f" and {len(names) - max_count} more" if len(names) > max_count else ""
    return ", ".join(names[:max_count]) + more
