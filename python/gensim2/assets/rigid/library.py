"""Libraries of rigid objects: the generated ones, the GenSim2 release's, and ManiSkill's YCB download."""

from __future__ import annotations

import difflib
import hashlib
import json
import os
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.assets.cache import cached_hulls, source_digest
from gensim2.assets.decompose import components, decompose, make_hull, weld
from gensim2.assets.errors import AssetError
from gensim2.assets.generate import LICENSE as GENERATED_LICENSE
from gensim2.assets.library import BUILTIN
from gensim2.assets.objfile import read_obj
from gensim2.assets.rigid.food import FOOD
from gensim2.assets.rigid.household import HOUSEHOLD
from gensim2.assets.rigid.parts import scaled
from gensim2.assets.rigid.prepare import prepare
from gensim2.assets.rigid.types import RigidKeypoint, RigidObject
from gensim2.assets.shapes import Mesh
from gensim2.assets.types import Array
from gensim2.errors import InputError

CLASSES = dict(sorted({**FOOD, **HOUSEHOLD}.items()))
YCB_LICENSE = "YCB object and model set (CC BY 4.0)"
DENSITY = 500.0
"""kg/m³ of a real object's hulls where nothing says its mass."""
FRICTION = 0.6
_RIGID = ("blueprint", "food", "household", "library", "parts", "prepare", "types")
_MODULES = ("cache", "decompose", "objfile", "physics", "prepare", "shapes", *(f"rigid/{m}" for m in _RIGID))


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
        if name not in self.names():
            near = difflib.get_close_matches(name, self.names(), n=3, cutoff=0.4) or self.names()[:8]
            raise InputError(
                f"no rigid object {name!r} in library {self.name}", field="rigid", remedy=f"there are {', '.join(near)}"
            )
        return self._load(name)


class GeneratedRigidLibrary(RigidLibrary):
    """Objects that the project makes itself, with the names, sizes and masses of the YCB set."""

    name = BUILTIN
    license = GENERATED_LICENSE

    def names(self) -> tuple[str, ...]:
        return tuple(CLASSES)

    def describe(self, name: str) -> str:
        return CLASSES[name].description

    def _load(self, name: str) -> RigidObject:
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
        self._names = tuple(sorted(p.name for p in folder.iterdir() if (p / "collision.obj").is_file()))
        if not self._names:
            raise InputError("no rigid objects in it", file=folder, remedy="<name>/collision.obj and info.json")

    def names(self) -> tuple[str, ...]:
        return self._names

    def describe(self, name: str) -> str:
        return name.replace("_", " ")

    def _load(self, name: str) -> RigidObject:
        folder = self.folder / name
        file = folder / "info.json"
        try:
            info: dict[str, Any] = json.loads(file.read_text())
            scale = float(info["scale"])
            descriptions = info.get("keypoint_descriptions", {})
            keypoints = {
                k: RigidKeypoint(scale * np.array(p, float).reshape(3), str(descriptions.get(k, k.replace("_", " "))))
                for k, p in info["keypoints"].items()
            }
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise AssetError(f"cannot be read: {error!r}", file=file, remedy="scale and keypoints") from error
        if not (np.isfinite(scale) and scale > 0):
            raise AssetError(f"must be positive, is {scale}", file=file, field="scale")
        return _from_meshes(
            name, folder / "collision.obj", folder / "textured.obj", scale, keypoints, None, self.license
        )


class ManiSkillYcbLibrary(RigidLibrary):
    """The YCB models that ``python -m mani_skill.utils.download_asset ycb`` puts on the disk."""

    license = YCB_LICENSE

    def __init__(self, folder: Path) -> None:
        self.folder, self.name = folder, folder.name
        file = folder / "info_pick_v0.json"
        try:
            self._info: dict[str, Any] = json.loads(file.read_text())
        except (OSError, ValueError) as error:
            raise InputError(f"cannot be read: {error}", file=file) from error
        self._names = tuple(sorted(k for k in self._info if (folder / "models" / k / "collision.ply").is_file()))
        if not self._names:
            raise InputError("no rigid objects in it", file=folder, remedy="models/<name>/collision.ply")

    def names(self) -> tuple[str, ...]:
        return self._names

    def describe(self, name: str) -> str:
        return name.split("_", 1)[-1].replace("_", " ")

    def _load(self, name: str) -> RigidObject:
        entry, folder = self._info[name], self.folder / "models" / name
        try:
            scale = float((entry.get("scales") or [1.0])[0])
            density = float(entry.get("density", 1000.0))
            low, high = (np.array(entry["bbox"][end], float).reshape(3) * scale for end in ("min", "max"))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise AssetError(
                f"cannot be read: {error!r}", file=self.folder / "info_pick_v0.json", field=name
            ) from error
        middle = (low + high) / 2
        keypoints = {
            "rigidbody_object_head": RigidKeypoint(np.array([*middle[:2], high[2]]), "the top of the object"),
            "rigidbody_object_tail": RigidKeypoint(np.array([*middle[:2], low[2]]), "the bottom of the object"),
        }
        seen = folder / "textured.obj"
        return _from_meshes(name, folder / "collision.ply", seen, scale, keypoints, density, self.license)


def _from_meshes(
    name: str,
    collision: Path,
    seen: Path,
    scale: float,
    keypoints: dict[str, RigidKeypoint],
    density: float | None,
    license: str,
) -> RigidObject:
    """Collision: each connected piece as its hull where that fills no cavity, else taken apart."""
    warnings: list[str] = []
    digest = hashlib.sha256(source_digest(*_MODULES).encode())
    try:
        for file in (collision, seen, collision.parent / "info.json"):
            if file.is_file():
                digest.update(file.read_bytes())
        meshes = _read(collision)
    except (OSError, ValueError) as error:
        raise AssetError(f"cannot be read: {error}", file=collision) from error
    pieces = [(scale * v, f) for v, f in meshes]
    visual: list[Mesh] = []
    try:
        visual = [Mesh(scale * m.vertices, m.faces, m.look) for m in read_obj(seen)]
    except (OSError, ValueError, IndexError) as error:
        warnings.append(f"{seen.name} cannot be read, nothing to look at: {error}")
    content = digest.hexdigest()[:16]
    hulls, counts = cached_hulls(f"rigid-{content}-{scale:g}", lambda: _hulls(pieces))
    if not hulls:
        raise AssetError("holds no part that can collide", file=collision)
    if counts["dropped"]:
        warnings.append(f"{counts['dropped']} parts of {collision.name} under 1 mm are left out")
    known = CLASSES.get(name) or next((CLASSES[k] for k in CLASSES if name.endswith(f"_{k}")), None)
    mass = known.mass * scale**3 if known is not None else None
    return prepare(
        f"rigid-real-{name}-{content}", name, "real", hulls, visual, keypoints,
        mass, density or DENSITY, FRICTION, license, content, warnings,
    )  # fmt: skip


def _read(file: Path) -> list[tuple[Array, Any]]:
    if file.suffix == ".obj":
        return [(m.vertices, m.faces) for m in read_obj(file)]
    import trimesh

    mesh = trimesh.load(file, force="mesh", process=False)
    return [(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64))]


def _hulls(pieces: list[tuple[Array, Any]]) -> tuple[list[Array], dict[str, int]]:
    """The files are convex decompositions already: a piece is its own hull unless that adds much to it."""
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
    return any((folder.expanduser() / "rigidbody_objs" / "models").glob("*/collision.obj"))


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
    folder = maniskill_ycb() if str(where) == "ycb" else Path(where).expanduser()
    if not folder.is_dir():
        remedy = 'give an existing one, "builtin", or "ycb" after `python -m mani_skill.utils.download_asset ycb`'
        raise InputError("no such folder", file=folder, field=field, remedy=remedy)
    if (folder / "info_pick_v0.json").is_file():
        return ManiSkillYcbLibrary(folder)
    inner = folder / "rigidbody_objs" / "models"
    return FolderRigidLibrary((inner if inner.is_dir() else folder).resolve(), folder.resolve().name)
