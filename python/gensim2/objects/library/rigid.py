"""Define the sources of rigid objects: generated objects, the GenSim2 release, and ManiSkill's YCB download."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from gensim2.objects.generators.generate import LICENSE as GENERATED_LICENSE
from gensim2.objects.generators.rigid.food import FOOD
from gensim2.objects.generators.rigid.household import HOUSEHOLD
from gensim2.objects.generators.rigid.parts import scaled
from gensim2.objects.library.cache import source_digest
from gensim2.objects.library.folder import ObjectFolder, maniskill_data
from gensim2.objects.library.info import UNSTATED, is_number, numbers, read_info
from gensim2.objects.library.shelf import RigidShelf
from gensim2.objects.library.urdf import plain_name
from gensim2.objects.types import AssetError, Hulls, RigidObject, Source

CLASSES = dict(sorted({**FOOD, **HOUSEHOLD}.items()))
YCB_LICENSE = "YCB object and model set (CC BY 4.0)"
YCB_INFO = "info_pick_v0.json"
WATER = 1000.0  # kg/m³, density of water
_MODULES = (
    "gensim2.objects.generators.rigid.parts",
    "gensim2.objects.generators.rigid.food",
    "gensim2.objects.generators.rigid.household",
    "gensim2.objects.library.cache",
    "gensim2.core.foreign.tree",
    "gensim2.objects.library.folder",
    "gensim2.objects.library.info",
    "gensim2.objects.library.meshes",
    "gensim2.objects.library.prepare",
    "gensim2.objects.library.rigid",
    "gensim2.objects.library.rigid_prepare",
    "gensim2.objects.meshwork.decompose",
    "gensim2.objects.physics",
    "gensim2.objects.types",
    "gensim2.objects.shapes",
)


class GeneratedRigidShelf(RigidShelf):
    """Generated objects with the names, sizes and masses of the YCB set."""

    source: Source = "generated"
    license = GENERATED_LICENSE

    def classes(self) -> tuple[str, ...]:
        return tuple(CLASSES)

    def describe(self, asset_class: str) -> str:
        return CLASSES[asset_class].description

    def load_rigid(self, asset_class: str, hulls: Hulls = "default") -> RigidObject:
        # Import late: naming objects does not need a mesh library.
        from gensim2.objects.library.rigid_prepare import RigidModel, prepare

        digest, rule = source_digest(*_MODULES), CLASSES[asset_class]
        blueprint = rule.build()
        parts = [scaled(p, rule.scale) for p in blueprint.parts]
        points = {"rigidbody_object_head": blueprint.head}
        if blueprint.tail is not None:
            points["rigidbody_object_tail"] = blueprint.tail
        model = RigidModel(
            asset_class=asset_class,
            source=self.source,
            hulls=[p.hull for p in parts if p.hull is not None],
            meshes=[p.mesh for p in parts if p.mesh is not None],
            keypoints={k: (np.asarray(at, float) * rule.scale, what) for k, (at, what) in points.items()},
            mass=rule.mass * rule.scale**3,
            density=WATER,
            friction=rule.friction,
            license=self.license,
            content_hash=digest,
        )
        return prepare(f"rigid-generated-{asset_class}-{digest}", model)


class FolderRigidShelf(RigidShelf):
    """Rigid models of the GenSim2 release: ``<name>/{info.json, collision.obj, textured.obj}``.

    Raises:
        AssetError: a folder has an invalid name.
        OSError: the folder cannot be read.
    """

    source: Source = "real"

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._names = tuple(sorted(p.name for p in folder.iterdir() if os.path.lexists(p / "collision.obj")))
        for name in self._names:
            plain_name(name, folder / name, "name of the folder")
        self.license = "; ".join(dict.fromkeys(_usual_license(name) for name in self._names)) or YCB_LICENSE

    def classes(self) -> tuple[str, ...]:
        return self._names

    def describe(self, asset_class: str) -> str:
        return asset_class.replace("_", " ")

    def load_rigid(self, asset_class: str, hulls: Hulls = "default") -> RigidObject:
        from gensim2.objects.library.rigid_prepare import load_from_meshes

        folder = ObjectFolder(self._folder / asset_class)
        info = read_info(folder)
        if info.scale is None:
            remedy = "write the length in metres of one unit of the meshes, such as 1.0"
            raise AssetError("is missing", file=info.file, field="scale", remedy=remedy)
        keypoints = {
            point: (info.scale * at, info.descriptions.get(point, point.replace("_", " ")))
            for point, at in info.keypoints.items()
        }
        # The real mass needs the real size. If the scale is outside ``NATURAL``, the unit of the file is not the metre,
        # so the real size is unknown.
        mass = known_mass(asset_class, info.scale) if NATURAL[0] <= info.scale <= NATURAL[1] else None
        terms = info.license or _usual_license(asset_class)
        return load_from_meshes(
            asset_class, folder, "collision.obj", info.scale, keypoints, mass, None, terms, source_digest(*_MODULES),
            hulls,
        )  # fmt: skip


class YcbShelf(RigidShelf):
    """YCB models that ``python -m mani_skill.utils.download_asset ycb`` downloads.

    Raises:
        AssetError: the file that lists the models cannot be read.
    """

    source: Source = "real"
    license = YCB_LICENSE

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._info = ObjectFolder(folder).read_json(YCB_INFO)
        there = sorted(p.name for p in (folder / "models").glob("*") if os.path.lexists(p / "collision.ply"))
        self._names = tuple(name for name in there if name in self._info)

    def classes(self) -> tuple[str, ...]:
        return self._names

    def describe(self, asset_class: str) -> str:
        return asset_class.split("_", 1)[-1].replace("_", " ")

    def load_rigid(self, asset_class: str, hulls: Hulls = "default") -> RigidObject:
        from gensim2.objects.library.rigid_prepare import load_from_meshes

        entry, file = self._info[asset_class], self._folder / YCB_INFO
        if not isinstance(entry, dict):
            raise AssetError("holds no fields", file=file, field=asset_class)
        scales, box = entry.get("scales") or [1.0], entry.get("bbox")
        scale, density = scales[0] if isinstance(scales, list) else scales, entry.get("density", WATER)
        for field, value in (("scales", scale), ("density", density)):
            if not is_number(value) or not value > 0:
                raise AssetError("the value is not a positive number", file=file, field=f"{asset_class}.{field}")
        if not isinstance(box, dict):
            raise AssetError("no corners", file=file, field=f"{asset_class}.bbox", remedy="write min and max")
        low, high = (scale * numbers(box.get(end), 3, file, f"{asset_class}.bbox.{end}") for end in ("min", "max"))
        middle = (low + high) / 2
        keypoints = {
            "rigidbody_object_head": (np.array([*middle[:2], high[2]]), "the top of the object"),
            "rigidbody_object_tail": (np.array([*middle[:2], low[2]]), "the bottom of the object"),
        }
        folder, mass = ObjectFolder(self._folder / "models" / asset_class), known_mass(asset_class, scale)
        return load_from_meshes(
            asset_class, folder, "collision.ply", scale, keypoints, mass, density, self.license,
            source_digest(*_MODULES), hulls,
        )  # fmt: skip


def _usual_license(name: str) -> str:
    """Return the licence of a model whose files state no licence: the YCB licence for objects of the YCB set."""
    return YCB_LICENSE if name in CLASSES else UNSTATED


NATURAL = (0.3, 3.0)
"""Range of scales, relative to the natural size, of an object whose file is in metres."""


def known_mass(name: str, scale: float) -> float | None:
    """Return the mass in kg of a real object at ``scale`` times its natural size; None if its mass is unknown.

    ManiSkill prefixes names with numbers of the YCB set, as in ``004_sugar_box``.
    """
    known = CLASSES.get(re.sub(r"^\d{3}_", "", name))
    return None if known is None else known.mass * scale**3


def maniskill_ycb() -> Path:
    """Return the folder of ManiSkill's YCB download: ``$MS_ASSET_DIR/data/assets/mani_skill2_ycb``."""
    return maniskill_data() / "assets" / "mani_skill2_ycb"
