"""Convert an MJCF file to a URDF file with meshes, which :mod:`gensim2.objects.library.importer` reads.

This module reads the MJCF file, its includes and its meshes with the limits for untrusted objects. MuJoCo's parser then
resolves defaults, angles, frames and inertias. It gets a text with only the ``ELEMENTS`` and opens no file. The rules
are:

- The object is the only body below the world that contains a hinge or a slide. Its pose in the world is ignored.
- A geom becomes a collision element if it can touch other geoms, according to ``contype``, ``conaffinity`` or a contact
  pair. Meshes among the collision elements become convex hulls, as in MuJoCo. All other geoms become visual elements.
- If a body has only collision elements or only visual elements, each of them becomes an element of both kinds.
"""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from gensim2.core.errors import required
from gensim2.core.foreign.geometry import MAX_URDF, opened_mesh
from gensim2.core.foreign.library import read_by_library
from gensim2.core.foreign.limits import MAX_MJCF_INCLUDES, MAX_OBJECT, MAX_TRIANGLES
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.urdf_writer import UrdfWriter
from gensim2.objects.shapes import Look, Mesh, hull_mesh, pose
from gensim2.objects.types import Array, AssetError

SUFFIXES = (".xml", ".mjcf")
SECTIONS = ("compiler", "default", "asset", "worldbody")
ELEMENTS = frozenset(
    ("mujoco", *SECTIONS, "mesh", "material", "body", "frame", "geom", "joint", "freejoint", "inertial")
)
DECORATION = frozenset(("camera", "light", "site", "texture"))
"""MJCF elements that are ignored, because they do not affect an object."""


def convert(source: Path, scratch: Path) -> Path:
    """Convert an MJCF file, and return the URDF file in the existing folder ``scratch``.

    Raises:
        InputError: the file cannot be imported.
        MissingExtraError: MuJoCo is not installed.
    """
    return _Converter(source, scratch).write()


class _Converter:
    def __init__(self, source: Path, scratch: Path) -> None:
        self._file, self._tree = source, ObjectFolder(source.parent)
        self._urdf = UrdfWriter(scratch)
        self._included: set[str] = set()

    def write(self) -> Path:
        mujoco = required("mujoco", "mujoco")
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
            # ignore MuJoCo's warnings about the dynamics, because the model is not simulated
            warnings.simplefilter("ignore")
            self._model = spec.compile()
        return self._write(mujoco, touching)

    def _read(self, name: str) -> ET.Element:
        """Parse a file of the folder, and replace each ``include`` element by the content of the included file."""
        content = self._tree.read(name, MAX_URDF)
        if b"<!" in content.replace(b"<!--", b"").replace(b"<![CDATA[", b""):
            wrong = "the file declares a document type or entities"
            raise AssetError(wrong, file=self._tree.path / name, remedy="remove them")
        try:
            root = ET.XML(content)
        except (ET.ParseError, ValueError, LookupError) as error:
            raise AssetError(f"not XML: {error}", file=self._tree.path / name) from error
        for parent in list(root.iter()):
            for place, child in reversed(list(enumerate(parent))):
                if child.tag == "include":
                    file = str(child.get("file"))
                    if file in self._included or len(self._included) >= MAX_MJCF_INCLUDES:
                        wrong = (
                            f"either the file is included twice, or more than {MAX_MJCF_INCLUDES} files are included"
                        )
                        raise AssetError(wrong, file=self._file, field=file[:80])
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
        """Remove lights, cameras and other irrelevant elements.

        Refuse elements without support, such as ``replicate``.
        """
        in_default = in_default or element.tag == "default"
        element.attrib.pop("texture", None)
        for name, value in element.items():
            if "nan" in value.lower().split():  # MuJoCo's parser only warns about NaN, so NaN is refused here
                wrong = "contains NaN instead of a number"
                raise AssetError(wrong, file=self._file, field=f"<{element.tag}> {name[:40]}")
        if "builtin" in element.attrib:  # Built-in meshes are refused, because they can have any number of triangles.
            said = "cannot be imported"
            raise AssetError(said, file=self._file, field=f"<{element.tag} builtin>", remedy="use a file")
        for child in list(element):
            if child.tag in DECORATION or (in_default and child.tag not in ELEMENTS):
                element.remove(child)
            elif child.tag not in ELEMENTS:
                raise AssetError("cannot be imported", file=self._file, field=f"<{child.tag[:40]}>")
            else:
                self._check(child, in_default)

    def _mesh(self, name: str) -> tuple[Array, Array]:
        """Read a mesh in the folder.

        Return flat arrays of the coordinates of its vertices and of the indices of its triangles.
        """
        self._tree.read(name, MAX_OBJECT)  # ``read`` raises an error for a file outside the folder
        with opened_mesh(self._tree.inside(name)) as scene:
            mesh = scene.to_geometry()
            corners, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int)
        if len(faces) > MAX_TRIANGLES:
            raise AssetError(f"the mesh has over {MAX_TRIANGLES} triangles", file=self._file, field=name[:80])
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
            wrong = f"the file must contain exactly one object with joints, but contains {len(moving)}"
            raise AssetError(wrong, file=self._file, remedy=remedy)
        self._ends: dict[int, tuple[str, Array]] = {}
        for body in range(1, model.nbody):
            if model.body_rootid[body] in moving:
                self._add_body(body, is_root=body in moving)
        return self._urdf.write()

    def _add_body(self, body: int, is_root: bool) -> None:
        """Add a body as a link for each joint, at its anchor; the last link gets the body's shapes."""
        model, urdf = self._model, self._urdf
        name = urdf.name(model.body(body).name, "link")
        joints = [int(model.body_jntadr[body]) + n for n in range(model.body_jntnum[body])]
        if is_root:
            joints = [j for j in joints if model.jnt_type[j] != self._free]
            if not joints:
                self._ends[body] = name, np.zeros(3)
                self._fill(urdf.link(name), body, np.zeros(3))
                return
            parent, at = urdf.name("base", "link"), np.zeros(3)
            urdf.link(parent)
            T = np.eye(4)
        else:
            parent, at = self._ends[int(model.body_parentid[body])]
            T = _pose(model.body_pos[body] - at, model.body_quat[body])
        at = np.zeros(3)
        for number, joint in enumerate(joints):
            link = name if joint == joints[-1] else urdf.name(f"{name}_{number}", "link")
            T = T @ pose(model.jnt_pos[joint] - at)
            last = self._add_joint(joint, parent, link, T)
            parent, at, T = link, model.jnt_pos[joint].copy(), np.eye(4)
        if not joints:
            urdf.join("fixed", urdf.name(f"{name}_joint", "joint"), parent, name, T)
            last = urdf.link(name)
        self._ends[body] = name, at
        self._fill(last, body, at)

    def _add_joint(self, joint: int, parent: str, child: str, T: Array) -> ET.Element:
        """Add a joint and its child link, and return the link."""
        model, name = self._model, self._model.joint(joint).name
        if model.jnt_type[joint] not in (self._hinge, self._slide):
            remedy = "use only hinges and slides; the root body may be free"
            wrong = "a ball or free joint cannot be imported"
            raise AssetError(wrong, file=self._file, field=f"joint {name[:80]}", remedy=remedy)
        slides = model.jnt_type[joint] == self._slide
        kind = "prismatic" if slides else "revolute" if model.jnt_limited[joint] else "continuous"
        element = self._urdf.join(kind, self._urdf.name(name, "joint"), parent, child, T)
        dof = model.jnt_dofadr[joint]
        limits = None
        if model.jnt_limited[joint]:
            lower, upper = model.jnt_range[joint] - model.qpos0[model.jnt_qposadr[joint]]
            limits = float(lower), float(upper)
        damping = float(np.ravel(model.dof_damping[dof])[0])
        self._urdf.move(element, model.jnt_axis[joint], limits, float(model.dof_frictionloss[dof]), damping)
        return self._urdf.link(child)

    def _fill(self, link: ET.Element, body: int, at: Array) -> None:
        """Add the mass, inertia and shapes of a body to a link.

        ``at`` (3,) is the origin of the link in the frame of the body.
        """
        model = self._model
        if model.body_mass[body] > 0:
            T = _pose(model.body_ipos[body] - at, model.body_iquat[body])
            self._urdf.weigh(link, float(model.body_mass[body]), T, np.diag(model.body_inertia[body]))
        start = model.body_geomadr[body]
        geoms = [int(start) + n for n in range(model.body_geomnum[body])]
        solid = [geom for geom in geoms if geom in self._solid]
        seen = [geom for geom in geoms if geom not in self._solid]
        for kind, which in (("visual", seen or solid), ("collision", solid or seen)):
            for geom in which:
                self._add_geom(link, kind, geom, at)

    def _add_geom(self, link: ET.Element, element: str, geom: int, at: Array) -> None:
        model, kind, size = self._model, self._geoms.get(int(self._model.geom_type[geom])), self._model.geom_size[geom]
        T = _pose(model.geom_pos[geom] - at, model.geom_quat[geom])
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
                mesh = hull_mesh(corners, look) if element == "collision" else Mesh(corners, faces, look)
            self._urdf.add_mesh(link, element, T, mesh)
        elif kind is not None:
            sizes = {"box": 2 * size, "sphere": size[:1]}.get(kind, np.array([size[0], 2 * size[1]]))
            self._urdf.add_primitive(link, element, T, kind, sizes, rgba)
        else:
            remedy = "use boxes, spheres, cylinders, capsules or meshes"
            field = f"geom {model.geom(geom).name[:80]}".strip()
            wrong = "the shape has a type that cannot be imported"
            raise AssetError(wrong, file=self._file, field=field, remedy=remedy)


def _pose(position: Array, quaternion: Array) -> Array:
    """Return the (4, 4) pose of a position and a quaternion (w, x, y, z)."""
    from scipy.spatial.transform import Rotation

    T = pose(position)
    T[:3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    return T
