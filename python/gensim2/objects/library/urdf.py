"""URDF of an object as it was written: links, joints and mesh elements, unscaled.

What is no tree of links, or holds an implausible number, is refused here, for the reader and the importer alike.
"""

from __future__ import annotations

import reprlib
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gensim2.objects.errors import AssetError
from gensim2.objects.library.folder import ObjectFolder

Array = npt.NDArray[np.float64]

URDF = "mobility.urdf"
MAX_URDF = 16 * 2**20  # bytes
MAX_ELEMENTS = 50_000
DEEPEST = 64  # elements in each other
LARGEST = 1e6  # units or radians: what is beyond is a mistake, and squares of it would lose all digits
LONGEST_NAME = 100
MOVABLE = ("revolute", "prismatic", "continuous")


class _Builder(ET.TreeBuilder):
    """An element tree of bounded size and depth, without declarations that could expand."""

    def __init__(self) -> None:
        super().__init__()
        self._count = self._depth = 0

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Called before any entity is known."""
        raise AssetError("has a DOCTYPE, which a URDF does not need", remedy="remove it")

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:
        self._count += 1
        self._depth += 1
        if self._count > MAX_ELEMENTS:
            raise AssetError(f"has over {MAX_ELEMENTS} elements")
        if self._depth > DEEPEST:
            raise AssetError(f"has elements over {DEEPEST} levels deep")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        self._depth -= 1
        return super().end(tag)


@dataclass(frozen=True)
class MeshElement:
    """A visual or collision element.

    Attributes:
        name: of the mesh file, relative to the object's folder.
        field: of the URDF that names it, for errors.
        T: (4, 4) pose in its link, unscaled.
        scale: (3,) of the file's vertices.
        label: name of the element, if any.
    """

    name: str
    field: str
    T: Array
    scale: Array
    label: str | None


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """A joint; ``T`` (4, 4) and ``axis`` (3,), which may be zero, unscaled; ``limits`` in units or rad."""

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
    """A URDF whose links form one tree.

    Attributes:
        file: it was read from.
        root: its XML.
        links: by name.
        joints: in the order of the file; names differ.
    """

    file: Path
    root: ET.Element
    links: dict[str, ET.Element]
    joints: tuple[UrdfJoint, ...]


def read_urdf(folder: ObjectFolder) -> Urdf:
    """The URDF of an object.

    Raises:
        AssetError: it cannot be read, is not XML or not bounded; names are missing, doubled or unfit; links form no
            tree; joints that mimic form a loop; a number is none or absurd.
    """
    file, content = folder.path / URDF, folder.read(URDF, MAX_URDF)
    try:
        root = ET.XML(content, parser=ET.XMLParser(target=_Builder()))
    except AssetError as error:
        raise AssetError(error.message, file=file, remedy=error.remedy) from error
    except (ET.ParseError, ValueError, LookupError) as error:
        raise AssetError(f"not XML: {error}", file=file) from error
    return parse_urdf(root, file)


def parse_urdf(root: ET.Element, file: Path) -> Urdf:
    """As :func:`read_urdf`, of XML."""
    links: dict[str, ET.Element] = {}
    for link in root.findall("link"):
        name = plain_name(link.get("name"), file, "link")
        if name in links:
            raise AssetError("two links have this name", file=file, field=f"link {name}", remedy="rename one")
        links[name] = link
    joints: dict[str, UrdfJoint] = {}
    parents: dict[str, str] = {}
    for element in root.findall("joint"):
        joint = _joint(element, file)
        field = f"joint {joint.name}"
        if joint.name in joints:
            raise AssetError("two joints have this name", file=file, field=field, remedy="rename one")
        for name in (joint.parent, joint.child):
            if name not in links:
                raise AssetError(f"no link {reprlib.repr(name)}", file=file, field=field)
        if joint.child in parents:
            other = parents[joint.child]
            raise AssetError(f"link {joint.child} hangs on {other} already", file=file, field=field)
        joints[joint.name], parents[joint.child] = joint, joint.name
    _refuse_mimic_loops(joints, file)
    roots = [name for name in links if name not in parents]
    if len(roots) != 1:
        raise AssetError(f"{len(roots)} root links, one is needed", file=file, field="link")
    return Urdf(file, root, links, tuple(joints.values()))


def plain_name(name: str | None, file: Path, field: str) -> str:
    """A name that can stand in other files, name files and be printed.

    Raises:
        AssetError: it is missing, too long, or holds other characters than printable ones, or a slash.
    """
    if not name or len(name) > LONGEST_NAME or not name.isprintable() or "/" in name or name in (".", ".."):
        raise AssetError(
            f"{reprlib.repr(name or '')} is no name",
            file=file,
            field=field,
            remedy=f"1 to {LONGEST_NAME} printable characters, no slash",
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
                raise AssetError(f"joints mimic each other: {loop}", file=file, field=f"joint {leader}: mimic")
            chain.append(leader)
            if len(chain) > DEEPEST:
                raise AssetError(f"a chain of over {DEEPEST} joints mimics", file=file, field=f"joint {joint.name}")
            leader = joints[leader].mimics


def _joint(element: ET.Element, file: Path) -> UrdfJoint:
    name = plain_name(element.get("name"), file, "joint")
    field = f"joint {name}"
    parent, child, limit, axis, mimic = (element.find(k) for k in ("parent", "child", "limit", "axis", "mimic"))
    if parent is None or child is None:
        raise AssetError("a joint needs a parent and a child", file=file, field=field)
    limits = None
    if limit is not None and limit.get("lower") is not None and limit.get("upper") is not None:
        low, high = (_numbers(limit.get(k), file, f"{field}: limit.{k}", 1)[0] for k in ("lower", "upper"))
        limits = (float(low), float(high))
    return UrdfJoint(
        name,
        element.get("type") or "",
        parent.get("link") or "",
        child.get("link") or "",
        _origin(element.find("origin"), file, f"{field}: origin"),
        _numbers(None if axis is None else axis.get("xyz"), file, f"{field}: axis", 3, "1 0 0"),
        limits,
        None if mimic is None else mimic.get("joint") or "",
    )


def _numbers(text: str | None, file: Path, field: str, count: int, default: str = "") -> Array:
    wanted = {1: "one finite number", 3: "three finite numbers", 4: "four finite numbers"}[count]
    try:
        value = np.array([float(x) for x in (text or default).split()])
    except ValueError as error:
        raise AssetError(f"not {wanted}", file=file, field=field) from error
    if value.shape != (count,) or not np.isfinite(value).all():
        raise AssetError(f"not {wanted}", file=file, field=field)
    if not np.abs(value).max() <= LARGEST:
        raise AssetError(f"{np.abs(value).max():.3g} is beyond {LARGEST:g}", file=file, field=field)
    return value


def _origin(element: ET.Element | None, file: Path, field: str) -> Array:
    T = np.eye(4)
    if element is not None:
        from scipy.spatial.transform import Rotation  # here: whoever only names objects needs no SciPy

        roll_pitch_yaw = _numbers(element.get("rpy"), file, f"{field}.rpy", 3, "0 0 0")
        T[:3, :3] = Rotation.from_euler("xyz", roll_pitch_yaw).as_matrix()
        T[:3, 3] = _numbers(element.get("xyz"), file, f"{field}.xyz", 3, "0 0 0")
    return T


def mesh_elements(urdf: Urdf, link: str, kind: str) -> list[MeshElement]:
    """Elements of a link; ``kind`` is ``visual`` or ``collision``.

    Raises:
        AssetError: one is something else than a mesh file, or its scale is not positive.
    """
    found = []
    for element in urdf.links[link].findall(kind):
        field = f"link {link}: {kind}"
        mesh = element.find("geometry/mesh")
        if mesh is None or not mesh.get("filename"):
            raise AssetError("only mesh geometry is read", file=urdf.file, field=field)
        scale = _numbers(mesh.get("scale"), urdf.file, f"{field}: mesh.scale", 3, "1 1 1")
        if not scale.min() > 0:
            raise AssetError("must be positive", file=urdf.file, field=f"{field}: mesh.scale")
        T = _origin(element.find("origin"), urdf.file, f"{field}.origin")
        found.append(MeshElement(str(mesh.get("filename")), field, T, scale, element.get("name")))
    return found


@dataclass(frozen=True)
class Primitive:
    """A shape without a file.

    Attributes:
        kind: ``box`` (size: its three sides), ``cylinder`` (radius, length along z) or ``sphere`` (radius).
        size: m.
    """

    kind: str
    size: tuple[float, ...]


@dataclass(frozen=True)
class VisualElement:
    """Visual element of a link.

    Attributes:
        shape: file name of a mesh, or a primitive.
        T: (4, 4) in the link's frame.
        scale: (3,) of a mesh.
        rgba: (4,) where the material has a colour.
    """

    shape: str | Primitive
    T: Array
    scale: Array
    rgba: Array | None


_PRIMITIVES = {"box": (("size", 3),), "cylinder": (("radius", 1), ("length", 1)), "sphere": (("radius", 1),)}


def visual_elements(urdf: Urdf, link: str) -> list[VisualElement]:
    """Return the visual elements of a link: meshes, boxes, cylinders and spheres.

    Raises:
        AssetError: one is something else, or a number is none.
    """
    found = []
    for element in urdf.links[link].findall("visual"):
        field = f"link {link}: visual"
        T = _origin(element.find("origin"), urdf.file, f"{field}.origin")
        mesh = element.find("geometry/mesh")
        scale = np.ones(3)
        shape: str | Primitive
        if mesh is not None and mesh.get("filename"):
            shape = str(mesh.get("filename"))
            scale = _numbers(mesh.get("scale"), urdf.file, f"{field}: mesh.scale", 3, "1 1 1")
        else:
            shape = _primitive(element, urdf.file, field)
        found.append(VisualElement(shape, T, scale, _color(urdf, element, field)))
    return found


def _primitive(element: ET.Element, file: Path, field: str) -> Primitive:
    for kind, numbers in _PRIMITIVES.items():
        shape = element.find(f"geometry/{kind}")
        if shape is not None:
            sizes = [
                float(each)
                for name, count in numbers
                for each in _numbers(shape.get(name), file, f"{field}: {kind}.{name}", count)
            ]
            if min(sizes) <= 0.0:
                raise AssetError("must be positive", file=file, field=f"{field}: {kind}")
            return Primitive(kind, tuple(sizes))
    raise AssetError("is no mesh file, box, cylinder or sphere", file=file, field=field)


def _color(urdf: Urdf, element: ET.Element, field: str) -> Array | None:
    """Colour of the element's material; a primitive may also name one of the robot's (meshes bring their own)."""
    material = element.find("material")
    if material is None:
        return None
    paint = material.find("color")
    if paint is None and element.find("geometry/mesh") is None:
        named = (each for each in urdf.root.findall("material") if each.get("name") == material.get("name"))
        paint = next((color for each in named if (color := each.find("color")) is not None), None)
    return None if paint is None else _numbers(paint.get("rgba"), urdf.file, f"{field}: material.color", 4)


def movable_joint(urdf: Urdf) -> UrdfJoint:
    """The one joint that moves.

    Raises:
        AssetError: there are none or several, it is neither revolute nor prismatic, or it follows another.
    """
    movable = [joint for joint in urdf.joints if joint.type != "fixed"]
    if len(movable) != 1:
        raise AssetError(
            f"{len(movable)} movable joints, one is needed",
            file=urdf.file,
            field="joint",
            remedy="fix all joints but one",
        )
    joint = movable[0]
    field = f"joint {joint.name}"
    if joint.type not in ("revolute", "prismatic"):
        raise AssetError(f"joint type {reprlib.repr(joint.type)}", file=urdf.file, field=f"{field}: type")
    if joint.mimics is not None:
        raise AssetError(
            f"mimics {joint.mimics}, which is fixed", file=urdf.file, field=f"{field}: mimic", remedy="remove mimic"
        )
    return joint


def unit_axis(joint: UrdfJoint, file: Path) -> Array:
    """(3,) unit axis of a joint.

    Raises:
        AssetError: the axis is zero.
    """
    length = float(np.linalg.norm(joint.axis))
    if length < 1e-9:
        raise AssetError("zero axis", file=file, field=f"joint {joint.name}: axis")
    return np.asarray(joint.axis / length)


def fixed_frames(urdf: Urdf, movable: UrdfJoint) -> dict[str, dict[str, Array]]:
    """Links by what moves them, each with its unscaled pose: body links in the root, moving ones in the child link.

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
