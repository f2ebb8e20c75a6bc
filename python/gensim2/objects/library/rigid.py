"""Libraries of rigid objects: the generated ones, the GenSim2 release's, and ManiSkill's YCB download."""

from __future__ import annotations

import difflib
import hashlib
import io
import os
import reprlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.errors import InputError
from gensim2.objects.errors import AssetError, MissingFileError
from gensim2.objects.generators.generate import LICENSE as GENERATED_LICENSE
from gensim2.objects.generators.rigid.food import FOOD
from gensim2.objects.generators.rigid.household import HOUSEHOLD
from gensim2.objects.generators.rigid.parts import scaled
from gensim2.objects.library.articulated import BUILTIN
from gensim2.objects.library.cache import cached_hulls, file_name, source_digest
from gensim2.objects.library.folder import ObjectFolder, existing_folder, shortened
from gensim2.objects.library.info import is_number, numbers, read_info
from gensim2.objects.library.meshes import listed
from gensim2.objects.library.objfile import MOST_MESH, read_obj
from gensim2.objects.library.urdf import LONGEST_NAME, plain_name
from gensim2.objects.rigid import RigidKeypoint, RigidObject
from gensim2.objects.shapes import Mesh
from gensim2.objects.types import Array

CLASSES = dict(sorted({**FOOD, **HOUSEHOLD}.items()))
YCB_LICENSE = "YCB object and model set (CC BY 4.0)"
DENSITY = 500.0
"""kg/m³ of a real object's hulls where nothing says its mass."""
FRICTION = 0.6
SEEN = "textured.obj"
YCB_INFO = "info_pick_v0.json"
_MODULES = (
    "gensim2.objects.generators.rigid.blueprint",
    "gensim2.objects.generators.rigid.food",
    "gensim2.objects.generators.rigid.household",
    "gensim2.objects.generators.rigid.parts",
    "gensim2.objects.library.cache",
    "gensim2.objects.library.folder",
    "gensim2.objects.library.info",
    "gensim2.objects.library.objfile",
    "gensim2.objects.library.prepare",
    "gensim2.objects.library.rigid",
    "gensim2.objects.library.rigid_prepare",
    "gensim2.objects.meshwork.decompose",
    "gensim2.objects.physics",
    "gensim2.objects.rigid",
    "gensim2.objects.shapes",
)


class RigidLibrary(ABC):
    """A set of rigid objects by name. Pickles.

    Attributes:
        name: what to show.
        license: terms of its data.
    """

    name: str
    license: str

    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names, sorted."""

    @abstractmethod
    def describe(self, name: str) -> str:
        """One phrase about an object."""

    @abstractmethod
    def _load(self, name: str) -> RigidObject: ...

    def load(self, name: str) -> RigidObject:
        """A prepared object; the first time it is made and kept in the cache.

        Raises:
            InputError: no such object.
            AssetError: it cannot be used; says why.
        """
        self.check(name)
        return self._load(name)

    def chosen(self, names: Sequence[str]) -> tuple[str, ...]:
        """The objects of these names, all where there is none.

        Raises:
            InputError: no such object.
        """
        for name in names:
            self.check(name)
        return tuple(names) or self.names()

    def check(self, name: str) -> None:
        """Whether there is an object of this name; nothing is loaded.

        Raises:
            InputError: no such object.
        """
        if name not in self.names():
            near = difflib.get_close_matches(name[:LONGEST_NAME], self.names(), n=3, cutoff=0.4) or self.names()[:8]
            wrong = f"no rigid object {reprlib.repr(name)} in library {self.name}"
            raise InputError(wrong, field="rigid", remedy=f"there are {', '.join(near)}")


class GeneratedRigidLibrary(RigidLibrary):
    """Objects that the project makes itself, with the names, sizes and masses of the YCB set."""

    name = BUILTIN
    license = GENERATED_LICENSE

    def names(self) -> tuple[str, ...]:
        return tuple(CLASSES)

    def describe(self, name: str) -> str:
        return CLASSES[name].description

    def _load(self, name: str) -> RigidObject:
        # Here, as below: naming objects needs no mesh library.
        from gensim2.objects.library.rigid_prepare import prepare

        digest = source_digest(*_MODULES)
        rule = CLASSES[name]
        blueprint = rule.build()
        parts = [scaled(p, rule.scale) for p in blueprint.parts]
        points = {"rigidbody_object_head": blueprint.head}
        if blueprint.tail is not None:
            points["rigidbody_object_tail"] = blueprint.tail
        return prepare(
            f"rigid-generated-{name}-{digest}",
            name,
            "generated",
            [p.hull for p in parts if p.hull is not None],
            [p.mesh for p in parts if p.mesh is not None],
            {k: RigidKeypoint(np.asarray(at, float) * rule.scale, what) for k, (at, what) in points.items()},
            rule.mass * rule.scale**3,
            1000.0,
            rule.friction,
            self.license,
            digest,
        )


class FolderRigidLibrary(RigidLibrary):
    """Models of the GenSim2 release: ``<name>/{info.json, collision.obj, textured.obj}``."""

    license = YCB_LICENSE

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.name = folder, name
        self._names = tuple(sorted(p.name for p in folder.iterdir() if os.path.lexists(p / "collision.obj")))
        for found in self._names:
            plain_name(found, folder / found, "name of the folder")
        if not self._names:
            raise InputError("no rigid objects in it", file=folder, remedy="<name>/collision.obj and info.json")

    def names(self) -> tuple[str, ...]:
        return self._names

    def describe(self, name: str) -> str:
        return name.replace("_", " ")

    def _load(self, name: str) -> RigidObject:
        folder = ObjectFolder(self.folder / name)
        info = read_info(folder)
        if info.scale is None:
            raise AssetError("no scale", file=info.file, field="scale", remedy="write metres a unit, such as 1.0")
        keypoints = {
            point: RigidKeypoint(info.scale * at, info.descriptions.get(point, point.replace("_", " ")))
            for point, at in info.keypoints.items()
        }
        return _from_meshes(name, folder, "collision.obj", info.scale, keypoints, None, info.license or self.license)


class ManiSkillYcbLibrary(RigidLibrary):
    """The YCB models that ``python -m mani_skill.utils.download_asset ycb`` puts on the disk."""

    license = YCB_LICENSE

    def __init__(self, folder: Path) -> None:
        self.folder, self.name = folder, folder.name
        self._info = ObjectFolder(folder).read_json(YCB_INFO)
        there = sorted(p.name for p in (folder / "models").glob("*") if os.path.lexists(p / "collision.ply"))
        self._names = tuple(name for name in there if name in self._info)
        if not self._names:
            raise InputError("no rigid objects in it", file=folder, remedy="models/<name>/collision.ply")

    def names(self) -> tuple[str, ...]:
        return self._names

    def describe(self, name: str) -> str:
        return name.split("_", 1)[-1].replace("_", " ")

    def _load(self, name: str) -> RigidObject:
        entry, file = self._info[name], self.folder / YCB_INFO
        if not isinstance(entry, dict):
            raise AssetError("holds no fields", file=file, field=name)
        scales, box = entry.get("scales") or [1.0], entry.get("bbox")
        scale, density = scales[0] if isinstance(scales, list) else scales, entry.get("density", 1000.0)
        for field, value in (("scales", scale), ("density", density)):
            if not is_number(value) or not value > 0:
                raise AssetError("not a positive number", file=file, field=f"{name}.{field}")
        if not isinstance(box, dict):
            raise AssetError("no corners", file=file, field=f"{name}.bbox", remedy="write min and max")
        low, high = (scale * numbers(box.get(end), 3, file, f"{name}.bbox.{end}") for end in ("min", "max"))
        middle = (low + high) / 2
        keypoints = {
            "rigidbody_object_head": RigidKeypoint(np.array([*middle[:2], high[2]]), "the top of the object"),
            "rigidbody_object_tail": RigidKeypoint(np.array([*middle[:2], low[2]]), "the bottom of the object"),
        }
        folder = ObjectFolder(self.folder / "models" / name)
        return _from_meshes(name, folder, "collision.ply", scale, keypoints, density, self.license)


def _from_meshes(
    name: str,
    folder: ObjectFolder,
    collision: str,
    scale: float,
    keypoints: dict[str, RigidKeypoint],
    density: float | None,
    license: str,
) -> RigidObject:
    """Collision: each connected piece as its hull where that fills no cavity, else taken apart."""
    from gensim2.objects.library.released import within
    from gensim2.objects.library.rigid_prepare import prepare

    warnings: list[str] = []
    file = folder.path / collision
    told = {key: point.position.tolist() for key, point in keypoints.items()}
    made_of = (source_digest(*_MODULES), folder.fingerprint(), scale, density, told, license)
    content = hashlib.sha256(repr(made_of).encode()).hexdigest()[:16]
    try:
        pieces = [(scale * vertices, faces) for vertices, faces in _read(folder, collision)]
    except ValueError as error:
        raise AssetError(f"cannot be read: {shortened(str(error))}", file=file) from error
    within("geometry", max(float(np.abs(vertices).max()) for vertices, _ in pieces), file, "scale")
    for key, point in keypoints.items():
        within("keypoint", float(np.abs(point.position).max()), folder.path, key)
    visual: list[Mesh] = []
    try:
        meshes, materials = read_obj(folder, SEEN)
        visual = [Mesh(scale * m.vertices, m.faces, m.look) for m in meshes]
        missing = [material for material, there in materials.items() if not there]
        if missing:
            warnings.append(f"{len(missing)} material files missing: {listed(missing)}")
    except (ValueError, MissingFileError) as error:
        warnings.append(f"{SEEN} cannot be read, nothing to look at: {shortened(str(error))}")
    hulls, counts = cached_hulls(f"rigid-{content}", lambda: _hulls(pieces))
    if not hulls:
        raise AssetError("holds no part that can collide", file=file, remedy="see its size and the scale")
    if counts["dropped"]:
        warnings.append(f"{counts['dropped']} parts of {collision} under 1 mm are left out")
    known = CLASSES.get(name) or next((CLASSES[k] for k in CLASSES if name.endswith(f"_{k}")), None)
    mass = known.mass * scale**3 if known is not None else None
    return prepare(
        f"rigid-real-{file_name(name)}-{content}", name, "real", hulls, visual, keypoints,
        mass, density or DENSITY, FRICTION, license, content, warnings,
    )  # fmt: skip


def _read(folder: ObjectFolder, name: str) -> list[tuple[Array, Any]]:
    """Vertices (N, 3) and faces (M, 3) of an OBJ file's meshes, or of a PLY file.

    Raises:
        AssetError: the file cannot be read.
        ValueError: it holds no triangles.
    """
    if name.endswith(".obj"):
        return [(mesh.vertices, mesh.faces) for mesh in read_obj(folder, name).meshes]
    content = folder.read(name, MOST_MESH)
    import trimesh

    try:
        mesh = trimesh.load_mesh(io.BytesIO(content), file_type="ply", process=False)
        vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    except Exception as error:  # trimesh's reader of PLY checks nothing, and fails in any way
        raise ValueError(f"not PLY: {error or type(error).__name__}") from error
    if not (len(faces) and faces.min() >= 0 and faces.max() < len(vertices) and np.isfinite(vertices).all()):
        raise ValueError("holds no triangles of finite vertices")
    return [(vertices, faces)]


def _hulls(pieces: list[tuple[Array, Any]]) -> tuple[list[Array], dict[str, int]]:
    """The files are convex decompositions already: a piece is its own hull unless that adds much to it."""
    from gensim2.objects.meshwork.decompose import components, decompose, make_hull, weld

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


def maniskill_ycb() -> Path:
    """Where ManiSkill keeps its YCB download: ``$MS_ASSET_DIR/data/assets/mani_skill2_ycb``."""
    root = Path(os.environ.get("MS_ASSET_DIR") or Path.home() / ".maniskill")
    return root / "data" / "assets" / "mani_skill2_ycb"


def has_rigid_objects(folder: Path) -> bool:
    """Whether a folder in the layout of the GenSim2 release holds rigid objects beside the articulated ones."""
    return any((existing_folder(folder) / "rigidbody_objs" / "models").glob("*/collision.obj"))


def open_rigid_library(where: Path | str | None = None) -> RigidLibrary:
    """Open a library of rigid objects.

    Args:
        where: None: ``$GENSIM2_ASSETS`` where set, else the generated one; ``"builtin"``: the generated one; ``"ycb"``:
            ManiSkill's download; otherwise a folder in the layout of the GenSim2 release, or its
            ``rigidbody_objs/models``.

    Raises:
        InputError: the folder is missing or holds no rigid objects.
    """
    field = None
    if where is None:
        where = os.environ.get("GENSIM2_ASSETS") or BUILTIN
        field = "GENSIM2_ASSETS"
    if str(where) == BUILTIN:
        return GeneratedRigidLibrary()
    remedy = 'give an existing one, "builtin", or "ycb" after `python -m mani_skill.utils.download_asset ycb`'
    folder = existing_folder(maniskill_ycb() if str(where) == "ycb" else where, field, remedy)
    if (folder / YCB_INFO).is_file():
        return ManiSkillYcbLibrary(folder)
    inner = folder / "rigidbody_objs" / "models"
    return FolderRigidLibrary((inner if inner.is_dir() else folder).resolve(), folder.resolve().name)
