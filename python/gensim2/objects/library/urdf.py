"""Read the URDF files of objects and the links of robots with ``gensim2_kpam.read_urdf``.

Lengths are in the unit of the file.

A file is refused if its links do not form a tree or if its numbers are implausible.
"""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

import gensim2_kpam
from gensim2.core.arrays import Array
from gensim2.core.foreign.geometry import MAX_URDF
from gensim2.core.foreign.limits import LARGEST_VALUE, LONGEST_LINK_NAME, MAX_MIMICS
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.physics import Inertial
from gensim2.objects.types import AssetError

if TYPE_CHECKING:
    import trimesh


URDF = "mobility.urdf"
MOVABLE = ("revolute", "prismatic", "continuous")
SPHERE_DETAIL = 2  # subdivisions of a collision sphere; physics engines accept its 162 vertices as one hull

T_FROM_Y_UP: Array = np.array([[0.0, 0, -1, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""Pose of a model whose y axis points up and whose front faces z, in a frame with z up and the front at -x."""


@dataclass(frozen=True)
class Primitive:
    """A shape without a mesh file.

    Attributes:
        kind: ``box``, ``cylinder``, ``capsule`` or ``sphere``.
        size: dimensions: sides of a box; radius and length along z of a cylinder; radius of a capsule and distance of
            the centres of its caps; radius of a sphere.
    """

    kind: str
    size: tuple[float, ...]

    def mesh(self, sphere_detail: int = SPHERE_DETAIL) -> trimesh.Trimesh:
        """Return the surface of the shape, centred at the origin."""
        from trimesh import creation

        if self.kind == "box":
            return creation.box(self.size)
        if self.kind == "cylinder":
            return creation.cylinder(*self.size)
        if self.kind == "capsule":
            return creation.capsule(radius=self.size[0], height=self.size[1], count=(16, 16))
        return creation.icosphere(sphere_detail, self.size[0])


@dataclass(frozen=True)
class ShapeElement:
    """A visual or collision element.

    Attributes:
        shape: a mesh file, relative to the URDF's folder, or a primitive.
        field: the URDF element, for error messages.
        T: (4, 4) pose in the frame of the element's link, unscaled.
        scale: (3,) scale of a mesh file's vertices.
        label: name of the element, if any.
        rgba: (4,) colour of the material, if any.
    """

    shape: str | Primitive
    field: str
    T: Array
    scale: Array
    label: str | None
    rgba: Array | None


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """Joint of an unscaled URDF file.

    ``T`` (4, 4) is its frame in the frame of the parent link. ``axis`` (3,) is the axis that the file states, which may
    be zero. ``limits`` are in rad or in the unit of length of the file.
    """

    name: str
    type: str
    parent: str
    child: str
    T: Array
    axis: Array
    limits: tuple[float, float] | None
    mimics: str | None = None


@dataclass(frozen=True)
class Urdf:
    """Content of a URDF file whose links form one tree.

    Attributes:
        links: links by name, as ``gensim2_kpam.read_urdf`` returns them.
        joints: joints in the order of the file, with distinct names.
        materials: colours (4,) by name.
    """

    file: Path
    links: Mapping[str, Mapping[str, Any]]
    joints: tuple[UrdfJoint, ...]
    materials: Mapping[str, Array]


def read_urdf(folder: ObjectFolder) -> Urdf:
    """Read the URDF of an object.

    Raises:
        AssetError: the file is unreadable, not XML or too large, or has invalid names, implausible numbers, mimic
            joints in a loop, or links that form no tree.
    """
    return parse_urdf(folder.read(URDF, MAX_URDF), folder.path / URDF)


def parse_urdf(content: bytes, file: Path) -> Urdf:
    """Parse the content of a URDF file; the errors are those of :func:`read_urdf`."""
    try:
        written = gensim2_kpam.read_urdf(content, str(file))
    except gensim2_kpam.UrdfError as error:
        field = None if error.field in ("XML", "robot") else error.field
        raise AssetError(str(error.message), file=file, field=field) from error
    links = {plain_name(link["name"], file, "link"): link for link in written["links"]}
    joints = {joint["name"]: _joint(joint, file) for joint in written["joints"]}
    _refuse_mimic_loops(joints, file)
    children = {joint.child for joint in joints.values()}
    roots = [name for name in links if name not in children]
    if len(roots) != 1:
        raise AssetError(f"the file has {len(roots)} root links instead of one", file=file, field="link")
    materials = {name: np.array(rgba) for name, rgba in written["materials"]}
    return Urdf(file, links, tuple(joints.values()), materials)


def plain_name(name: str | None, file: Path, field: str) -> str:
    """Return ``name`` after checking that it can appear in files, in file names and on the terminal.

    Raises:
        AssetError: the name is missing or too long, or contains a slash or unprintable characters.
    """
    if not name or len(name) > LONGEST_LINK_NAME or not name.isprintable() or "/" in name or name in (".", ".."):
        raise AssetError(
            f"{reprlib.repr(name or '')} is not a valid name",
            file=file,
            field=field,
            remedy=f"1 to {LONGEST_LINK_NAME} printable characters, no slash",
        )
    return name


def _refuse_mimic_loops(joints: dict[str, UrdfJoint], file: Path) -> None:
    for joint in joints.values():
        chain, leader = [joint.name], joint.mimics
        while leader is not None:
            if leader not in joints:
                raise AssetError(f"no joint {reprlib.repr(leader)}", file=file, field=f"joint {chain[-1]}: mimic")
            if leader in chain:
                loop = " -> ".join([*chain[-3:], leader])
                wrong = f"the joints mimic each other in a loop ({loop})"
                raise AssetError(wrong, file=file, field=f"joint {leader}: mimic")
            chain.append(leader)
            if len(chain) > MAX_MIMICS:
                wrong = f"more than {MAX_MIMICS} joints mimic each other in a chain"
                raise AssetError(wrong, file=file, field=f"joint {joint.name}: mimic")
            leader = joints[leader].mimics


def _joint(written: Mapping[str, Any], file: Path) -> UrdfJoint:
    name = plain_name(written["name"], file, "joint")
    field = f"joint {name}"
    limit = written["limit"] or {}
    lower, upper = (
        None if limit.get(end) is None else float(_bounded([limit[end]], file, f"{field}: limit.{end}")[0])
        for end in ("lower", "upper")
    )
    return UrdfJoint(
        name,
        written["kind"],
        written["parent"],
        written["child"],
        _pose(written["origin"], file, f"{field}: origin"),
        _bounded(written["axis"], file, f"{field}: axis"),
        None if lower is None or upper is None else (lower, upper),
        None if written["mimic"] is None else written["mimic"]["joint"],
    )


def _bounded(numbers: npt.ArrayLike, file: Path, field: str) -> Array:
    value = np.array(numbers, float)
    if not np.abs(value).max() <= LARGEST_VALUE:
        wrong = f"contains a number of magnitude {np.abs(value).max():.3g}, but at most {LARGEST_VALUE:g} is permitted"
        raise AssetError(wrong, file=file, field=field)
    return value


def _pose(origin: Mapping[str, Any], file: Path, field: str) -> Array:
    T = np.eye(4)
    T[:3, 3] = _bounded(origin["xyz"], file, f"{field}.xyz")
    turn = _bounded(origin["rpy"], file, f"{field}.rpy")
    if origin["quat_xyzw"] is not None or turn.any():
        from scipy.spatial.transform import Rotation  # imported here because naming objects does not need SciPy

        quaternion = origin["quat_xyzw"]
        rotation = Rotation.from_euler("xyz", turn) if quaternion is None else Rotation.from_quat(quaternion)
        T[:3, :3] = rotation.as_matrix()
    return T


def shape_elements(urdf: Urdf, link: str, kind: str) -> list[ShapeElement]:
    """Return the visual or collision elements of a link: meshes, boxes, cylinders, capsules and spheres.

    Args:
        urdf: the parsed file.
        kind: ``visual`` or ``collision``.

    Raises:
        AssetError: a number is implausible, or a mesh's scale is not positive.
    """
    found = []
    for element in urdf.links[link][f"{kind}s"]:
        field = f"link {link}: {kind}"
        ((shape, size),) = element["geometry"].items()
        scale, is_mesh = np.ones(3), shape == "mesh"
        if is_mesh:
            scale = _bounded(size["scale"], urdf.file, f"{field}: mesh.scale")
            if not scale.min() > 0:
                raise AssetError("must be positive", file=urdf.file, field=f"{field}: mesh.scale")
        else:
            size = tuple(_bounded(np.atleast_1d(size), urdf.file, f"{field}: {shape}").tolist())
        found.append(
            ShapeElement(
                _mesh_file(size["paths"], urdf.file.parent) if is_mesh else Primitive(shape, size),
                field,
                _pose(element["origin"], urdf.file, f"{field}.origin"),
                scale,
                element["name"],
                _color(urdf, element, is_mesh),
            )
        )
    return found


def _mesh_file(paths: Sequence[str], folder: Path) -> str:
    """Return the first existing path among a mesh's candidate paths; if none exists, the first path."""
    if len(paths) == 1:
        return paths[0]
    return next((path for path in paths if (folder / path).is_file()), paths[0])


def _color(urdf: Urdf, element: Mapping[str, Any], is_mesh: bool) -> Array | None:
    """Return a shape's colour (4,), maybe by the name of a material at the top of the URDF, or None."""
    if element["rgba"] is not None:
        return np.array(element["rgba"])
    return None if is_mesh else urdf.materials.get(element["material"])


def link_inertial(urdf: Urdf, link: str) -> Inertial | None:
    """Return the mass, centre of mass and inertia of a link; None if the URDF gives none.

    Raises:
        AssetError: a number is implausible.
    """
    written = urdf.links[link]["inertial"]
    if written is None:
        return None
    field = f"link {link}: inertial"
    T = _pose(written["origin"], urdf.file, f"{field}: origin")
    ixx, ixy, ixz, iyy, iyz, izz = _bounded(written["inertia"], urdf.file, f"{field}: inertia")
    about = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    mass = float(_bounded([written["mass"]], urdf.file, f"{field}: mass")[0])
    return Inertial(mass, T[:3, 3], T[:3, :3] @ about @ T[:3, :3].T)


def movable_joint(urdf: Urdf) -> UrdfJoint:
    """Return the only movable joint.

    Raises:
        AssetError: there is not exactly one movable joint, it is neither revolute nor prismatic, or it mimics another
            joint.
    """
    movable = [joint for joint in urdf.joints if joint.type != "fixed"]
    if len(movable) != 1:
        wrong = f"the model has {len(movable)} movable joints instead of one"
        raise AssetError(wrong, file=urdf.file, field="joint", remedy="fix all joints but one")
    joint = movable[0]
    field = f"joint {joint.name}"
    if joint.type not in ("revolute", "prismatic"):
        raise AssetError(f"unsupported type {reprlib.repr(joint.type)}", file=urdf.file, field=f"{field}: type")
    if joint.mimics is not None:
        wrong = f"the joint mimics {joint.mimics}, which is a fixed joint"
        raise AssetError(wrong, file=urdf.file, field=f"{field}: mimic", remedy="remove the mimic element")
    return joint


def unit_axis(joint: UrdfJoint, file: Path) -> Array:
    """Return the unit axis (3,) of a joint.

    Raises:
        AssetError: the axis is zero.
    """
    length = float(np.linalg.norm(joint.axis))
    if length < 1e-9:
        raise AssetError("zero axis", file=file, field=f"joint {joint.name}: axis")
    return np.asarray(joint.axis / length)


def fixed_frames(urdf: Urdf, movable: UrdfJoint) -> dict[str, dict[str, Array]]:
    """Return the unscaled poses of the body's links in the root frame, and of the moving part's links in its own frame.

    Raises:
        AssetError: the links form no tree.
    """
    children: dict[str, list[UrdfJoint]] = {}
    for joint in urdf.joints:
        children.setdefault(joint.parent, []).append(joint)
    hanging = {joint.child for joint in urdf.joints}
    frames: dict[str, dict[str, Array]] = {}
    for group, start in (("body", next(n for n in urdf.links if n not in hanging)), ("moving", movable.child)):
        frames[group] = {start: np.eye(4)}
        waiting = [start]
        while waiting:
            parent = waiting.pop()
            for joint in children.get(parent, []):
                if joint is movable:
                    continue
                if joint.child in frames[group]:
                    raise AssetError("joints form a loop", file=urdf.file, field=f"joint {joint.name}")
                frames[group][joint.child] = frames[group][parent] @ joint.T
                waiting.append(joint.child)
    lost = [name for name in urdf.links if name not in frames["body"] and name not in frames["moving"]]
    if lost or movable.parent not in frames["body"]:
        name = next((j.name for j in urdf.joints if j.child in lost), movable.name)
        raise AssetError("joints form a loop", file=urdf.file, field=f"joint {name}")
    return frames
