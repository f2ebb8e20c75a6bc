"""Export an object as a folder in the layout of the GenSim2 release, so that other tools can load the object.

The folder ``<class>/<id>`` has ``mobility.urdf``, ``info.json`` and ``textured_objs/``, in metres (``scale`` 1). Each
collision element is one convex mesh (``"collision": "convex"``: readers do not decompose it). Masses, inertias and
joint limits are always written.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.core.foreign.geometry import opened_mesh, read_xml
from gensim2.objects.library.meshes import write_obj
from gensim2.objects.library.prepare import numbers, rpy_from_matrix
from gensim2.objects.shapes import Look, Mesh, hull_mesh, transform
from gensim2.objects.types import ArticulatedObject

MESHES = "textured_objs"
OCCUPIED = "choose another folder with --out, or replace it with --force"


def export(instance: ArticulatedObject, library: Path, replace: bool = False) -> Path:
    """Write an instance to ``library/articulated_objs/<class>/<id>`` atomically, and return that folder.

    Args:
        replace: whether to replace an existing object.

    Raises:
        InputError: the object exists already, or the folder cannot be written to.
    """
    return write_folder(
        library / "articulated_objs" / instance.asset_class / instance.id,
        lambda folder: _write(instance, folder),
        replace,
    )


def write_folder(target: Path, write: Callable[[Path], object], replace: bool) -> Path:
    """Call ``write(folder)`` with a temporary folder, and rename the folder to ``target``.

    Raises:
        InputError: ``target`` exists and may not be replaced, or cannot be written to.
    """
    try:
        if os.path.lexists(target) and not replace:
            raise InputError("already exists", file=target, remedy=OCCUPIED)
        target.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(dir=target.parent, prefix=".new."))
        try:
            folder = scratch / "object"
            folder.mkdir()
            write(folder)
            if os.path.lexists(target):
                target.rename(scratch / "replaced")
            folder.rename(target)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
    except OSError as error:
        wrong = f"cannot write: {error.strerror or error}"
        raise InputError(wrong, file=target, remedy="choose another folder with --out") from error
    return target


def _write(instance: ArticulatedObject, folder: Path) -> None:
    (folder / MESHES).mkdir()
    root = read_xml(instance.urdf)
    for link in root.findall("link"):
        name = str(link.get("name"))
        frame = instance.T_link_object if name == instance.joint.child_link else np.eye(4)
        for element in (*link.findall("visual"), *link.findall("collision")):
            link.remove(element)
        seen = read_glb(instance.urdf.parent / "visual" / f"{name}.glb")
        if seen:
            write_obj(folder / MESHES / f"{name}_visual.obj", seen)
            link.append(_element("visual", f"{name}_visual", np.eye(4)))
        for number, hull in enumerate(instance.hulls.get(name, ())):
            file = f"{name}_collision_{number}"
            solid = hull_mesh(transform(np.asarray(np.linalg.inv(frame), float), hull), Look())
            corners, index = np.unique(solid.vertices, axis=0, return_inverse=True)
            write_obj(folder / MESHES / f"{file}.obj", [Mesh(corners, index[solid.faces], Look())])
            link.append(_element("collision", file, frame))
    ET.indent(root)
    ET.ElementTree(root).write(folder / "mobility.urdf", encoding="utf-8", xml_declaration=True)
    (folder / "info.json").write_text(json.dumps(info(instance), indent=2, allow_nan=False) + "\n")


def info(instance: ArticulatedObject) -> dict[str, Any]:
    """Return the content of ``info.json`` for an instance."""
    T_object_link = np.asarray(np.linalg.inv(instance.T_link_object), float)
    return {
        "keypoints": {
            name: (
                k.position if k.link != instance.joint.child_link else transform(T_object_link, k.position[None])[0]
            ).tolist()
            for name, k in instance.keypoints.items()
        },
        "keypoint_descriptions": {name: k.description for name, k in instance.keypoints.items()},
        "scale": 1.0,
        "axis": instance.object_axis,
        "joint_position_range": [instance.joint.lower, instance.joint.upper],
        "collision": "convex",
        "license": instance.license,
    }


def _element(kind: str, file: str, T: Array) -> ET.Element:
    element = ET.Element(kind)
    ET.SubElement(element, "origin", xyz=numbers(T[:3, 3]), rpy=numbers(rpy_from_matrix(T[:3, :3])))
    ET.SubElement(ET.SubElement(element, "geometry"), "mesh", filename=f"{MESHES}/{file}.obj")
    return element


def read_glb(path: Path) -> list[Mesh]:
    """Read the meshes of a GLB file that this package wrote, in the link's frame; empty if the file is missing."""
    if not path.is_file():
        return []
    found = []
    with opened_mesh(path) as scene:
        for shape in scene.dump():
            material = shape.visual.material
            colour = (np.asarray(material.baseColorFactor, float) / 255).round(4).tolist()
            look = Look(
                (colour[0], colour[1], colour[2], colour[3]),
                float(material.metallicFactor),
                float(material.roughnessFactor),
            )
            found.append(Mesh(np.asarray(shape.vertices, float), np.asarray(shape.faces, np.int64), look))
    return found
