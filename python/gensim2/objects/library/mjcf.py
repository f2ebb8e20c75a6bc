"""Convert an MJCF file to a URDF with meshes, the form that :mod:`gensim2.objects.library.importer` reads.

MuJoCo's reader resolves classes, angles, frames and inertias. It never reads a file: this module passes it only the
elements of ``ELEMENTS``, and reads included files and meshes itself, with the limits for untrusted objects. These rules
apply:

- The object is the only body below the world that contains a hinge or a slide; its pose in the world is ignored.
- Geoms that can touch, by ``contype`` and ``conaffinity`` or in a contact pair, are collision elements, and meshes
  among them are convex hulls as in MuJoCo. All other geoms are visual. If a body has only one kind of geoms, they serve
  both purposes.
"""

from __future__ import annotations

import contextlib
import re
import tempfile
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from gensim2.core.errors import MissingExtraError
from gensim2.core.foreign.geometry import MAX_URDF, opened_mesh
from gensim2.core.foreign.library import read_by_library
from gensim2.core.foreign.limits import LONGEST_LINK_NAME, MAX_OBJECT, MAX_TRIANGLES
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.meshes import write_obj
from gensim2.objects.library.prepare import numbers, rpy_from_matrix
from gensim2.objects.library.urdf import URDF
from gensim2.objects.shapes import Look, Mesh, hull_mesh, pose
from gensim2.objects.types import Array, AssetError

SUFFIXES = (".xml", ".mjcf")
SECTIONS = ("compiler", "default", "asset", "worldbody")
ELEMENTS = frozenset(
    ("mujoco", *SECTIONS, "mesh", "material", "body", "frame", "geom", "joint", "freejoint", "inertial")
)
DECORATION = frozenset(("camera", "light", "site", "texture"))
"""MJCF elements that are ignored, because they do not affect an object."""
MAX_INCLUDES = 100


@contextlib.contextmanager
def as_urdf(source: Path) -> Iterator[Path]:
    """Convert an MJCF file, and yield the path of the temporary URDF file; yield ``source`` if it is no MJCF file.

    Raises:
        InputError: the file cannot be imported; the error names ``source`` also for errors inside the block.
        MissingExtraError: MuJoCo is not installed.
    """
    if source.suffix not in SUFFIXES or source.is_dir():
        yield source
        return
    with tempfile.TemporaryDirectory() as scratch:
        try:
            yield _Converter(source, Path(scratch)).write()
        except AssetError as error:
            if error.file is None or Path(scratch) not in Path(error.file).parents:
                raise
            raise AssetError(error.message, file=source, field=error.field, remedy=error.remedy) from error


class _Converter:
    def __init__(self, source: Path, scratch: Path) -> None:
        self._file, self._tree, self._scratch = source, ObjectFolder(source.parent), scratch
        self._included: set[str] = set()
        self._names: set[str] = set()

    def write(self) -> Path:
        try:
            import mujoco
        except ImportError as error:
            raise MissingExtraError("mujoco", "mujoco") from error
        root = self._read(self._file.name)
        if root.tag != "mujoco":
            raise AssetError(f"begins with <{root.tag[:40]}>, not <mujoco>", file=self._file)
        touching = {str(pair.get(each)) for pair in root.findall("contact/pair") for each in ("geom1", "geom2")}
        meshes = self._mesh_folder(root)
        for section in list(root):
            if section.tag not in SECTIONS:
                root.remove(section)
        self._check(root, in_default=False)
        with read_by_library(self._file, "correct the MJCF", "MuJoCo cannot read it"):
            spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
        for mesh in spec.meshes:
            if mesh.file:
                name = mesh.file if meshes is None else str(meshes / mesh.file)
                mesh.name = mesh.name or PurePosixPath(mesh.file).stem
                mesh.uservert, mesh.userface = self._mesh(name)
                mesh.file = ""
        spec.compiler.discardvisual = spec.compiler.fusestatic = False
        with warnings.catch_warnings(), read_by_library(self._file, "correct the MJCF", "MuJoCo cannot compile it"):
            warnings.simplefilter("ignore")  # ignore warnings about motion, because the model is not simulated
            self._model = spec.compile()
        return self._write(mujoco, touching)

    def _read(self, name: str) -> ET.Element:
        """Parse a file of the folder, and replace each ``include`` element by the content of the included file."""
        content = self._tree.read(name, MAX_URDF)
        if b"<!" in content.replace(b"<!--", b"").replace(b"<![CDATA[", b""):
            raise AssetError("declares a document type or entities", file=self._tree.path / name, remedy="remove them")
        try:
            root = ET.XML(content)
        except (ET.ParseError, ValueError, LookupError) as error:
            raise AssetError(f"not XML: {error}", file=self._tree.path / name) from error
        for parent in list(root.iter()):
            for place, child in reversed(list(enumerate(parent))):
                if child.tag == "include":
                    file = str(child.get("file"))
                    if file in self._included or len(self._included) >= MAX_INCLUDES:
                        raise AssetError(
                            f"is included twice, or more than {MAX_INCLUDES} files are included",
                            file=self._file,
                            field=file[:80],
                        )
                    self._included.add(file)
                    parent[place : place + 1] = list(self._read(file))
        for element in root.iter():
            if element.tag in ("plugin", "extension"):
                remedy = "remove it: an object needs no plugin"
                raise AssetError("loads code", file=self._tree.path / name, field=f"<{element.tag}>", remedy=remedy)
        return root

    @staticmethod
    def _mesh_folder(root: ET.Element) -> PurePosixPath | None:
        found = [each.get("meshdir") or each.get("assetdir") for each in root.findall("compiler")]
        folders = [PurePosixPath(folder) for folder in found if folder]
        return folders[-1] if folders else None

    def _check(self, element: ET.Element, in_default: bool) -> None:
        """Remove elements that an object does not need, and refuse unknown elements, such as ``replicate``."""
        in_default = in_default or element.tag == "default"
        element.attrib.pop("texture", None)
        for name, value in element.items():
            if "nan" in value.lower().split():  # MuJoCo's reader only warns of NaN.
                raise AssetError("is not a number", file=self._file, field=f"<{element.tag}> {name[:40]}")
        if "builtin" in element.attrib:  # Built-in meshes are refused, because they can have any number of triangles.
            raise AssetError(
                "cannot be imported", file=self._file, field=f"<{element.tag} builtin>", remedy="use a file"
            )
        for child in list(element):
            if child.tag in DECORATION or (in_default and child.tag not in ELEMENTS):
                element.remove(child)
            elif child.tag not in ELEMENTS:
                raise AssetError("cannot be imported", file=self._file, field=f"<{child.tag[:40]}>")
            else:
                self._check(child, in_default)

    def _mesh(self, name: str) -> tuple[Array, Array]:
        """Return vertices (3 V,) and triangles (3 F,) of a mesh file in the folder."""
        self._tree.read(name, MAX_OBJECT)  # refuses files outside the folder
        with opened_mesh(self._tree.inside(name)) as scene:
            mesh = scene.to_geometry()
            corners, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int)
        if len(faces) > MAX_TRIANGLES:
            raise AssetError(f"has over {MAX_TRIANGLES} triangles", file=self._file, field=name[:80])
        return corners.ravel(), faces.ravel()

    def _write(self, mujoco: Any, touching: set[str]) -> Path:
        model, kinds = self._model, mujoco.mjtJoint
        self._free, self._hinge, self._slide = (
            int(kind) for kind in (kinds.mjJNT_FREE, kinds.mjJNT_HINGE, kinds.mjJNT_SLIDE)
        )
        self._geoms = {
            int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")): kind
            for kind in ("mesh", "box", "sphere", "cylinder", "capsule")
        }
        geoms = range(model.ngeom)
        self._solid = {
            g for g in geoms if model.geom_contype[g] | model.geom_conaffinity[g] or model.geom(g).name in touching
        }
        moving = {
            int(model.body_rootid[model.jnt_bodyid[j]])
            for j in range(model.njnt)
            if model.jnt_type[j] in (self._hinge, self._slide)
        }
        if len(moving) != 1:
            remedy = "leave one object in the file, and join its static parts and moving parts to one body"
            raise AssetError(f"{len(moving)} bodies below the world have joints", file=self._file, remedy=remedy)
        self._root = ET.Element("robot", name="object")
        self._ends: dict[int, tuple[str, Array]] = {}
        for body in range(1, model.nbody):
            if model.body_rootid[body] in moving:
                self._add_body(body, is_root=body in moving)
        file = self._scratch / URDF
        ET.ElementTree(self._root).write(file, encoding="utf-8", xml_declaration=True)
        return file

    def _name(self, written: str, kind: str) -> str:
        """Return an unused name that is valid in a URDF."""
        plain = re.sub(r"[^\w.-]", "_", written.rpartition("/")[2])[: LONGEST_LINK_NAME - 8].strip(".") or kind
        name = next(
            each for n in range(len(self._names) + 1) if (each := f"{plain}_{n}" if n else plain) not in self._names
        )
        self._names.add(name)
        return name

    def _add_body(self, body: int, is_root: bool) -> None:
        """Add one link for each joint of a body. A link's origin is at the anchor of its joint. The shapes of the body
        belong to the last of these links.
        """
        model, name = self._model, self._name(self._model.body(body).name, "link")
        joints = [int(model.body_jntadr[body]) + n for n in range(model.body_jntnum[body])]
        if is_root:
            joints = [j for j in joints if model.jnt_type[j] != self._free]
            if not joints:
                self._ends[body] = name, np.zeros(3)
                self._fill(ET.SubElement(self._root, "link", name=name), body, np.zeros(3))
                return
            parent, at = self._name("base", "link"), np.zeros(3)
            ET.SubElement(self._root, "link", name=parent)
            T = np.eye(4)
        else:
            parent, at = self._ends[int(model.body_parentid[body])]
            T = _pose(model.body_pos[body] - at, model.body_quat[body])
        at = np.zeros(3)
        for number, joint in enumerate(joints):
            link = name if joint == joints[-1] else self._name(f"{name}_{number}", "link")
            T = T @ pose(model.jnt_pos[joint] - at)
            self._add_joint(joint, parent, link, T)
            parent, at, T = link, model.jnt_pos[joint].copy(), np.eye(4)
        if not joints:
            self._join("fixed", self._name(f"{name}_joint", "joint"), parent, name, T)
            ET.SubElement(self._root, "link", name=name)
        self._ends[body] = name, at
        self._fill(next(link for link in self._root.findall("link") if link.get("name") == name), body, at)

    def _add_joint(self, joint: int, parent: str, child: str, T: Array) -> None:
        model, name = self._model, self._model.joint(joint).name
        if model.jnt_type[joint] not in (self._hinge, self._slide):
            remedy = "an object has hinges and slides; its root body may be free"
            raise AssetError("is a ball or free joint", file=self._file, field=f"joint {name[:80]}", remedy=remedy)
        slides = model.jnt_type[joint] == self._slide
        kind = "prismatic" if slides else "revolute" if model.jnt_limited[joint] else "continuous"
        element = self._join(kind, self._name(name, "joint"), parent, child, T)
        ET.SubElement(element, "axis", xyz=numbers(model.jnt_axis[joint]))
        dof = model.jnt_dofadr[joint]
        friction, damping = model.dof_frictionloss[dof], float(np.ravel(model.dof_damping[dof])[0])
        ET.SubElement(element, "dynamics", friction=f"{friction:.9g}", damping=f"{damping:.9g}")
        if model.jnt_limited[joint]:
            lower, upper = model.jnt_range[joint] - model.qpos0[model.jnt_qposadr[joint]]
            ET.SubElement(element, "limit", lower=f"{lower:.9g}", upper=f"{upper:.9g}", effort="0", velocity="0")
        ET.SubElement(self._root, "link", name=child)

    def _join(self, kind: str, name: str, parent: str, child: str, T: Array) -> ET.Element:
        element = ET.SubElement(self._root, "joint", name=name, type=kind)
        ET.SubElement(element, "parent", link=parent)
        ET.SubElement(element, "child", link=child)
        element.append(_origin(T))
        return element

    def _fill(self, link: ET.Element, body: int, at: Array) -> None:
        """Add inertial and shapes of a body to a link. ``at`` (3,) is the link's origin in the body's frame."""
        model = self._model
        if model.body_mass[body] > 0:
            T = _pose(model.body_ipos[body] - at, model.body_iquat[body])
            inertial = ET.SubElement(link, "inertial")
            inertial.append(_origin(T))
            ET.SubElement(inertial, "mass", value=f"{model.body_mass[body]:.9g}")
            diagonal = dict(zip(("ixx", "iyy", "izz"), model.body_inertia[body], strict=True))
            crossed = dict.fromkeys(("ixy", "ixz", "iyz"), 0.0)
            ET.SubElement(inertial, "inertia", {key: f"{value:.9g}" for key, value in (diagonal | crossed).items()})
        start = model.body_geomadr[body]
        geoms = [int(start) + n for n in range(model.body_geomnum[body])]
        solid = [geom for geom in geoms if geom in self._solid]
        seen = [geom for geom in geoms if geom not in self._solid]
        for kind, which in (("visual", seen or solid), ("collision", solid or seen)):
            for geom in which:
                self._add_geom(ET.SubElement(link, kind), geom, at, is_solid=kind == "collision")

    def _add_geom(self, element: ET.Element, geom: int, at: Array, is_solid: bool) -> None:
        model, kind, size = self._model, self._geoms.get(int(self._model.geom_type[geom])), self._model.geom_size[geom]
        element.append(_origin(_pose(model.geom_pos[geom] - at, model.geom_quat[geom])))
        geometry = ET.SubElement(element, "geometry")
        material = model.geom_matid[geom]
        rgba = np.asarray(model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom], float).clip(0.0, 1.0)
        if kind == "mesh":
            number = model.geom_dataid[geom]
            first, count = model.mesh_vertadr[number], model.mesh_vertnum[number]
            corners = np.asarray(model.mesh_vert[first : first + count], float)
            first, count = model.mesh_faceadr[number], model.mesh_facenum[number]
            look = Look(tuple(rgba.tolist()))
            faces = np.asarray(model.mesh_face[first : first + count], np.int64)
            with read_by_library(self._file, "correct the mesh", f"mesh {model.mesh(number).name[:80]} has no volume"):
                mesh = hull_mesh(corners, look) if is_solid else Mesh(corners, faces, look)
            file = f"geom_{geom}_{element.tag}.obj"
            write_obj(self._scratch / file, [mesh])
            ET.SubElement(geometry, "mesh", filename=file)
            return
        if kind == "box":
            ET.SubElement(geometry, "box", size=numbers(2 * size))
        elif kind == "sphere":
            ET.SubElement(geometry, "sphere", radius=f"{size[0]:.9g}")
        elif kind is not None:
            ET.SubElement(geometry, kind, radius=f"{size[0]:.9g}", length=f"{2 * size[1]:.9g}")
        else:
            remedy = "use boxes, spheres, cylinders, capsules or meshes"
            field = f"geom {model.geom(geom).name[:80]}".strip()
            raise AssetError("has a type that cannot be imported", file=self._file, field=field, remedy=remedy)
        if element.tag == "visual":
            dressed = ET.SubElement(element, "material", name=f"look_{geom}")
            ET.SubElement(dressed, "color", rgba=numbers(rgba))


def _pose(position: Array, quaternion: Array) -> Array:
    """Return the (4, 4) pose of a position and a quaternion (w, x, y, z)."""
    from scipy.spatial.transform import Rotation

    T = pose(position)
    T[:3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    return T


def _origin(T: Array) -> ET.Element:
    return ET.Element("origin", xyz=numbers(T[:3, 3]), rpy=numbers(rpy_from_matrix(T[:3, :3])))
