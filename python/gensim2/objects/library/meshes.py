"""Read an object's meshes: OBJ files of limited size with this module's reader, other formats with trimesh."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

import gensim2_kpam
from gensim2.core.arrays import Array
from gensim2.core.foreign.limits import FARTHEST_VERTEX, MAX_LOOKS, MAX_MATERIALS, MAX_OBJ, MAX_TRIANGLES
from gensim2.core.foreign.tree import Reference, shortened
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.urdf import URDF, Primitive, ShapeElement
from gensim2.objects.shapes import Look, Mesh, transform
from gensim2.objects.types import AssetError, MissingFileError

DEFAULT_LOOK = Look((0.7, 0.7, 0.7, 1.0))


class ObjFile(NamedTuple):
    """Content of an OBJ file.

    ``meshes`` has a mesh for each material. ``materials`` has each referenced file and whether it exists.
    """

    meshes: list[Mesh]
    materials: dict[str, bool]


def read_materials(text: str, file: str) -> dict[str, Look]:
    """Return the materials of an MTL file by name.

    Raises:
        ValueError: a colour is not a finite number.
    """
    looks: dict[str, Look] = {}
    name, colour, alpha, specular = "", (0.7, 0.7, 0.7), 1.0, 0.0

    def keep() -> None:
        if name:
            rgb = tuple(round(min(max(c, 0.0), 1.0), 3) for c in colour)
            shine = min(max(specular, 0.0), 1.0)
            looks[name] = Look((rgb[0], rgb[1], rgb[2], min(max(alpha, 0.15), 1.0)), 0.0, 0.7 - 0.4 * shine)

    for line in text.splitlines():
        word, *rest = line.split() or [""]
        if word == "newmtl":
            keep()
            name, colour, alpha, specular = " ".join(rest), (0.7, 0.7, 0.7), 1.0, 0.0
        elif word == "Kd" and len(rest) >= 3:
            colour = (float(rest[0]), float(rest[1]), float(rest[2]))
        elif word == "d" and rest:
            alpha = float(rest[-1])
        elif word == "Ks" and rest:
            specular = float(rest[0])
        if not np.isfinite([*colour, alpha, specular]).all():
            raise ValueError(f"{file}: material {name[:40]} has a colour that is not a number")
    keep()
    return looks


def read_obj(folder: ObjectFolder, name: str, named_by: Reference | None = None) -> ObjFile:
    """Return the meshes of an OBJ file, each with only the vertices that it uses.

    Args:
        name: file name relative to the object's folder.
        named_by: place that names the file, for error messages.

    Raises:
        AssetError: the file, or a material file that it names, cannot be read.
        ValueError: the file is not OBJ, contains no triangle, or has vertices that are not finite numbers.
    """
    vertices, groups, libraries = gensim2_kpam.read_obj(folder.read(name, MAX_OBJ, named_by))
    looks: dict[str, Look] = {}
    there: dict[str, bool] = {}
    for library in libraries:
        path = str(PurePosixPath(name).parent / library)
        try:
            found = folder.read(path, MAX_MATERIALS, Reference(name, "mtllib"))
            looks.update(read_materials(found.decode(errors="replace"), PurePosixPath(path).name))
            there[path] = True
        except MissingFileError:
            there[path] = False
    return ObjFile(_meshes(vertices, groups, looks), there)


def _meshes(points: Array, groups: Sequence[tuple[str, npt.NDArray[np.int64]]], looks: dict[str, Look]) -> list[Mesh]:
    if not groups:
        raise ValueError("contains no triangle")
    if len(groups) > MAX_LOOKS:
        raise ValueError(f"the file has {len(groups)} materials, more than {MAX_LOOKS}")
    if not np.isfinite(points).all():
        raise ValueError("the file has a vertex coordinate that is not a finite number")
    if np.abs(points).max() > FARTHEST_VERTEX:
        raise ValueError(f"the file has a vertex coordinate beyond {FARTHEST_VERTEX:g}")
    meshes = []
    for name, faces in groups:
        used, renumbered = np.unique(faces, return_inverse=True)
        meshes.append(Mesh(points[used], renumbered.reshape(-1, 3), looks.get(name, DEFAULT_LOOK)))
    return meshes


def write_obj(path: Path, meshes: Sequence[Mesh]) -> None:
    """Write meshes as an OBJ file and an MTL file in the same folder, with one material for each appearance.

    An MTL file cannot contain roughness. The roughness is stored in the specular colour, where :func:`read_materials`
    finds it.
    """
    looks = list(dict.fromkeys(mesh.look for mesh in meshes))
    lines, first = [f"mtllib {path.with_suffix('.mtl').name}"], 1
    for number, look in enumerate(looks):
        lines.append(f"usemtl look_{number}")
        for mesh in meshes:
            if mesh.look == look:
                lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices + 0.0]
                lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + first]
                first += len(mesh.vertices)
    path.write_text("\n".join(lines) + "\n")
    materials = []
    for number, look in enumerate(looks):
        red, green, blue, alpha = look.rgba
        specular = min(max((0.7 - look.roughness) / 0.4, 0.0), 1.0)
        materials += [
            f"newmtl look_{number}",
            f"Kd {red:g} {green:g} {blue:g}",
            f"Ks {specular:g} {specular:g} {specular:g}",
            f"d {alpha:g}",
        ]
    path.with_suffix(".mtl").write_text("\n".join(materials) + "\n")


LISTED = 8  # maximum number of names in a warning


class MeshReader:
    """Reads each mesh file of an object only once, and records unreadable files."""

    def __init__(self, folder: ObjectFolder) -> None:
        self._folder, self._read = folder, {}  # type: tuple[ObjectFolder, dict[str, list[Mesh]]]
        self._triangles = 0
        self._missing: list[str] = []
        self._broken: dict[str, str] = {}
        self._materials: dict[str, bool] = {}

    def get(self, element: ShapeElement, scale: float, T: Array) -> list[Mesh]:
        """Return the meshes of a visual or collision element in another frame, multiplied by ``scale``.

        ``T`` (4, 4) is the unscaled pose of the element's link in the frame of the result.

        Raises:
            AssetError: there is no regular ``.obj`` file inside the folder, or the object has too many triangles.
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
            wrong = f"its meshes have over {MAX_TRIANGLES:,} triangles"
            raise AssetError(wrong, file=self._folder.path / URDF, field=element.field, remedy="simplify them")
        return found

    def _meshes(self, name: str, field: str) -> list[Mesh]:
        if not name.lower().endswith(".obj"):
            raise AssetError(
                f"{reprlib.repr(name)} is not an .obj file",
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
        """Return the names of all mesh and material files requested so far, including missing files."""
        return [*self._read, *self._materials]

    def warnings(self) -> list[str]:
        """Return up to three warnings, about missing meshes, unreadable meshes and missing material files."""
        broken = [f"{name} ({why})" for name, why in self._broken.items()]
        kinds = {"mesh files missing": self._missing, "mesh files unreadable": broken}
        kinds["material files missing"] = [name for name, there in self._materials.items() if not there]
        return [f"{len(names)} {what}: {listed(names)}" for what, names in kinds.items() if names]


def listed(names: Sequence[str], max_count: int = LISTED) -> str:
    """Join the first ``max_count`` names, and add the number of remaining names."""
    more = f" and {len(names) - max_count} more" if len(names) > max_count else ""
    return ", ".join(names[:max_count]) + more
