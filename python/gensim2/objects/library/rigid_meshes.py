"""Real rigid objects from their collision meshes, whoever laid out the folder."""

from __future__ import annotations

import hashlib
import io
from typing import Any

import numpy as np

from gensim2.core.foreign.tree import shortened
from gensim2.objects.errors import AssetError, MissingFileError
from gensim2.objects.library.cache import cached_hulls, file_name
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.meshes import listed
from gensim2.objects.library.objfile import MAX_MESH, read_obj
from gensim2.objects.library.released import within
from gensim2.objects.library.rigid_prepare import RigidModel, prepare
from gensim2.objects.meshwork.decompose import components, decompose, make_hull, weld
from gensim2.objects.meshwork.pieces import piece_hulls
from gensim2.objects.rigid import RigidObject
from gensim2.objects.shapes import Mesh
from gensim2.objects.types import Array, Hulls

DENSITY = 500.0
"""kg/m³ of a real object's hulls where nothing says its mass."""
FRICTION = 0.6
SEEN = "textured.obj"


def load_from_meshes(
    name: str,
    folder: ObjectFolder,
    collision: str,
    scale: float,
    keypoints: dict[str, tuple[Array, str]],
    mass: float | None,
    density: float | None,
    license: str,
    code: str,
    rule: Hulls = "default",
) -> RigidObject:
    """Prepare a real object. Collision: each connected piece as its hull where that fills no cavity, else taken apart.

    Args:
        name: its class.
        folder: with its meshes.
        collision: OBJ or PLY file in it.
        scale: metres a unit of the meshes.
        keypoints: name to (position (3,) in metres, phrase).
        mass: kg; None: by ``density`` (kg/m³), or ``DENSITY``.
        license: terms of the data.
        code: digest of the code that prepares it.
        rule: ``"original"`` takes nothing apart.

    Raises:
        AssetError: it cannot be used; says why.
    """
    warnings: list[str] = []
    file = folder.path / collision
    told = {key: position.tolist() for key, (position, _) in keypoints.items()}
    made_of = (code, folder.fingerprint(), scale, mass, density, told, license)
    content = hashlib.sha256(repr(made_of).encode()).hexdigest()[:16]
    entry = content if rule == "default" else f"{content}-{rule}"
    try:
        pieces = [(scale * vertices, faces) for vertices, faces in _read(folder, collision)]
    except ValueError as error:
        raise AssetError(f"cannot be read: {shortened(str(error))}", file=file) from error
    within("geometry", max(float(np.abs(vertices).max()) for vertices, _ in pieces), file, "scale")
    for key, (position, _) in keypoints.items():
        within("keypoint", float(np.abs(position).max()), folder.path, key)
    visual: list[Mesh] = []
    try:
        meshes, materials = read_obj(folder, SEEN)
        visual = [Mesh(scale * m.vertices, m.faces, m.look) for m in meshes]
        missing = [material for material, there in materials.items() if not there]
        if missing:
            warnings.append(f"{len(missing)} material files missing: {listed(missing)}")
    except (ValueError, MissingFileError) as error:
        warnings.append(f"{SEEN} cannot be read, nothing to look at: {shortened(str(error))}")
    hulls, counts = cached_hulls(f"rigid-{entry}", lambda: _hulls(pieces, rule))
    if not hulls:
        raise AssetError("holds no part that can collide", file=file, remedy="see its size and the scale")
    if counts["dropped"]:
        warnings.append(f"{counts['dropped']} parts of {collision} under 1 mm are left out")
    model = RigidModel(
        name, "real", hulls, visual, keypoints, mass, density or DENSITY, FRICTION, license, content, warnings
    )
    return prepare(f"rigid-real-{file_name(name)}-{entry}", model)


def _read(folder: ObjectFolder, name: str) -> list[tuple[Array, Any]]:
    """Vertices (N, 3) and faces (M, 3) of an OBJ file's meshes, or of a PLY file.

    Raises:
        AssetError: the file cannot be read.
        ValueError: it holds no triangles.
    """
    if name.endswith(".obj"):
        return [(mesh.vertices, mesh.faces) for mesh in read_obj(folder, name).meshes]
    content = folder.read(name, MAX_MESH)
    import trimesh

    try:
        mesh = trimesh.load_mesh(io.BytesIO(content), file_type="ply", process=False)
        vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    except Exception as error:  # trimesh's reader of PLY checks nothing, and fails in any way
        raise ValueError(f"not PLY: {error or type(error).__name__}") from error
    if not (len(faces) and faces.min() >= 0 and faces.max() < len(vertices) and np.isfinite(vertices).all()):
        raise ValueError("holds no triangles of finite vertices")
    return [(vertices, faces)]


def _hulls(pieces: list[tuple[Array, Any]], rule: Hulls) -> tuple[list[Array], dict[str, int]]:
    """The files are convex decompositions already: a piece is its own hull unless that adds much to it."""
    if rule == "original":
        whole, flat = piece_hulls(pieces)
        return whole, {"dropped": flat}
    kept: list[Array] = []
    dropped, hollow = 0, []
    for vertices, faces in pieces:
        for points, triangles in components(*weld(vertices, faces)):
            hull = make_hull(points)
            if hull is None:
                dropped += 1
            elif hull.volume > 1.2 * _volume(points, triangles) + 1e-6:
                hollow.append((points, triangles))
            else:
                kept.append(hull.points)
    if hollow:
        result = decompose(hollow)
        kept += result.hulls
    return kept, {"dropped": dropped}


def _volume(points: Array, faces: Any) -> float:
    """Volume that a closed surface encloses (m³)."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    return abs(float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6)
