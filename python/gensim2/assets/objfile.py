"""Just enough of Wavefront OBJ and MTL: vertices, polygons, one diffuse colour a group."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gensim2.assets.shapes import Look, Mesh

DEFAULT_LOOK = Look((0.7, 0.7, 0.7, 1.0))


def read_materials(path: Path) -> dict[str, Look]:
    """Materials of an MTL file by name; empty where the file is missing.

    Raises:
        OSError: the file cannot be read.
        ValueError: a colour is not a finite number.
    """
    if not path.is_file():
        return {}
    looks: dict[str, Look] = {}
    name, colour, alpha, specular = "", (0.7, 0.7, 0.7), 1.0, 0.0

    def keep() -> None:
        if name:
            rgb = tuple(round(min(max(c, 0.0), 1.0), 3) for c in colour)
            looks[name] = Look((rgb[0], rgb[1], rgb[2], min(max(alpha, 0.15), 1.0)), 0.0, 0.7 - 0.4 * min(specular, 1))

    for line in path.read_text(errors="replace").splitlines():
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
            raise ValueError(f"{path.name}: material {name} has a colour that is no number")
    keep()
    return looks


def read_obj(path: Path) -> list[Mesh]:
    """Meshes of an OBJ file, one a material, each with the file's whole vertex list thinned to what it uses.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not OBJ, or has vertices that are not numbers.
    """
    vertices: list[list[float]] = []
    looks: dict[str, Look] = {}
    groups: dict[str, list[tuple[int, int, int]]] = {}
    material = ""
    for line in path.read_text(errors="replace").splitlines():
        if line.startswith("v "):
            vertices.append([float(x) for x in line.split()[1:4]])
        elif line.startswith("f "):
            corners = [int(word.split("/", 1)[0]) for word in line.split()[1:]]
            corners = [c - 1 if c > 0 else len(vertices) + c for c in corners]
            faces = groups.setdefault(material, [])
            faces.extend((corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1))
        elif line.startswith("usemtl"):
            material = line[6:].strip()
        elif line.startswith("mtllib"):
            looks.update(read_materials(path.parent / line[6:].strip()))
    points = np.array(vertices, float).reshape(-1, 3)
    if not np.isfinite(points).all():
        raise ValueError("a vertex is not finite")
    meshes = []
    for name, faces in groups.items():
        index = np.array(faces, np.int64)
        if index.size and (index.min() < 0 or index.max() >= len(points)):
            raise ValueError("a face refers to a vertex that is not there")
        used, renumbered = np.unique(index, return_inverse=True)
        meshes.append(Mesh(points[used], renumbered.reshape(-1, 3), looks.get(name, DEFAULT_LOOK)))
    return meshes


def write_obj(path: Path, meshes: Sequence[Mesh]) -> None:
    """Write meshes as one OBJ file with its MTL beside it, a material a look.

    MTL has no roughness: its specular share stands for it, as in :func:`read_materials`.
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
