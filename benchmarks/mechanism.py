"""Kinematics and collision shapes of any URDF arm, for checks that are independent of gensim2's solver.

Forward kinematics is computed with NumPy for all samples of a motion at once, and can be compared with Pinocchio.
Collision shapes are coal objects. Joint vectors follow the order of the URDF's joints, without fixed joints.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import trimesh
from parts import Part, hull, part, shape_distance, transform

Array = np.ndarray

#: Two links count as touching at the middle of all joint ranges if they are closer than this distance, m.
TOUCHING = 1e-3


@dataclass(frozen=True)
class MovingJoint:
    """A joint that is not fixed: revolute (rad; a continuous joint has infinite limits) or prismatic (m)."""

    name: str
    turns: bool
    axis: Array
    lower: float
    upper: float
    velocity: float


@dataclass(frozen=True)
class Coupling:
    """A mimic joint: ``value = factor * value of source + offset``. The source is never a mimic joint itself."""

    source: int
    factor: float
    offset: float


@dataclass(frozen=True)
class TreeLink:
    """A link, with the frame of its joint in the parent link. In lists, a parent precedes its children."""

    name: str
    parent: int
    origin: Array
    joint: int


def numbers(text: str | None, default: str) -> Array:
    """Parse the numbers of an XML attribute."""
    return np.array([float(value) for value in (text or default).split()])


def pose_of(element: ElementTree.Element | None) -> Array:
    """Return the pose (4, 4) of an ``origin`` element."""
    pose = np.eye(4)
    if element is not None:
        pose[:3, :3] = pin.rpy.rpyToMatrix(*numbers(element.get("rpy"), "0 0 0"))
        pose[:3, 3] = numbers(element.get("xyz"), "0 0 0")
    return pose


def collision_part(element: ElementTree.Element, folder: Path) -> Part:
    """Return the coal shape of a ``collision`` element; a mesh becomes its convex hull."""
    geometry = element.find("geometry")
    assert geometry is not None
    kind = geometry[0]
    pose = pose_of(element.find("origin"))
    if kind.tag == "box":
        return part(coal.Box(*numbers(kind.get("size"), "")), pose)
    if kind.tag == "sphere":
        return part(coal.Sphere(float(kind.get("radius", ""))), pose)
    if kind.tag in ("cylinder", "capsule"):
        shape = coal.Cylinder if kind.tag == "cylinder" else coal.Capsule
        return part(shape(float(kind.get("radius", "")), float(kind.get("length", ""))), pose)
    points = np.asarray(trimesh.load(mesh_file(kind.get("filename", ""), folder), force="mesh").vertices)
    shape = hull(points * numbers(kind.get("scale"), "1 1 1"))
    assert shape is not None
    return part(shape, pose)


def mesh_file(name: str, folder: Path) -> Path:
    """Return the path of a mesh: relative to the URDF's folder or, for ``package://``, to one of its parent folders."""
    plain = name.removeprefix("file://")
    if not plain.startswith("package://"):
        return folder / plain
    inside = plain.removeprefix("package://")
    for above in (folder, *folder.parents):
        for candidate in (above / inside, above / inside.partition("/")[2]):
            if candidate.is_file():
                return candidate
    raise FileNotFoundError(name)


class Mechanism:
    """A robot from URDF text.

    Args:
        text: the URDF.
        folder: folder to which mesh paths are relative.
        hand: name of the hand link.
        srdf: SRDF text with the pairs of links that are not checked. Without SRDF, neighbours and pairs of links that
            touch at the middle of all joint ranges are not checked.
        base: name of the base link; links that are not its descendants are ignored. Default: the root.
    """

    def __init__(self, text: str, folder: Path, hand: str, srdf: str | None = None, base: str | None = None) -> None:
        root = ElementTree.fromstring(text)
        if base is not None:
            keep_below(root, base)
            text = ElementTree.tostring(root, encoding="unicode")
        self.text, self.hand_link = text, hand
        moving = [joint for joint in root.findall("joint") if joint.get("type") != "fixed"]
        self.joints = [_moving_joint(joint) for joint in moving]
        self.joint_names = [joint.name for joint in self.joints]
        self.lower = np.array([joint.lower for joint in self.joints])
        self.upper = np.array([joint.upper for joint in self.joints])
        self.velocity = np.array([joint.velocity for joint in self.joints])
        self.links = _tree(root, self.joint_names)
        self.index = {link.name: index for index, link in enumerate(self.links)}
        self.couplings = _couplings(moving, self.joint_names)
        self.parts: dict[str, list[Part]] = {}
        for link in root.findall("link"):
            parts = [collision_part(element, folder) for element in link.findall("collision")]
            if parts:
                self.parts[link.get("name", "")] = parts
        #: Names of the links that have collision shapes and are moved by a joint.
        self.moving_links = [name for name in self.parts if self.movers(name)]
        #: Links that hold an attached object: the hand and its descendants. If the hand has no collision shapes, also
        #: the link that carries it, with the descendants of that link.
        self.holding_links = self.below(self._holder())
        #: Links that may touch the manipulated object: ``holding_links``. If a joint moves the carrying link, this link
        #: belongs to the arm, so only the hand and its descendants may touch.
        own = self.links[self.index[self._holder()]].joint >= 0
        self.touching_links = self.below(hand) if own else self.holding_links
        self.self_pairs = self._checked_pairs(srdf)

    def above(self, name: str) -> list[str]:
        """Return the names of a link and all its ancestors, up to the base."""
        found, index = [], self.index[name]
        while index >= 0:
            found.append(self.links[index].name)
            index = self.links[index].parent
        return found

    def below(self, name: str) -> set[str]:
        """Return the names of a link and all its descendants."""
        return {link.name for link in self.links if name in self.above(link.name)}

    def _holder(self) -> str:
        """Return the nearest link with collision shapes that is the hand, or carries the hand; else the hand."""
        for name in self.above(self.hand_link):
            if name in self.parts:
                return name
            if self.links[self.index[name]].joint >= 0:
                break
        return self.hand_link

    def movers(self, name: str) -> frozenset[int]:
        """Return the indices of the independent joints that move a link."""
        joints = {self.links[self.index[each]].joint for each in self.above(name)} - {-1}
        return frozenset(self.couplings[j].source if j in self.couplings else j for j in joints)

    def coupled(self, q: Array) -> Array:
        """Return joint vectors (..., n) in which every mimic joint has the value that follows from its source joint."""
        q = np.array(q, dtype=float)
        for joint, coupling in self.couplings.items():
            q[..., joint] = coupling.factor * q[..., coupling.source] + coupling.offset
        return q

    def place(self, q: Array) -> dict[str, Array]:
        """Return the poses (M, 4, 4) of every link in the base frame at joint vectors (M, n)."""
        placed: list[Array] = []
        for link in self.links:
            if link.parent < 0:
                placed.append(np.broadcast_to(np.eye(4), (len(q), 4, 4)))
                continue
            frame = placed[link.parent] @ link.origin
            placed.append(frame if link.joint < 0 else frame @ motion(self.joints[link.joint], q[:, link.joint]))
        return {link.name: pose for link, pose in zip(self.links, placed, strict=True)}

    def hand_poses(self, q: Array) -> Array:
        """Return the poses (M, 4, 4) of the hand in the base frame at joint vectors (M, n)."""
        return self.place(np.atleast_2d(q))[self.hand_link]

    def pinocchio(self) -> pin.Model:
        """Return Pinocchio's model, with mimic joints as independent joints; its joint order may differ."""
        root = ElementTree.fromstring(re.sub(r"<mimic[^>]*/>", "", self.text))
        for link in root.findall("link"):
            for element in list(link):
                link.remove(element)
        for joint in root.findall("joint"):
            limit = joint.find("limit")
            if joint.get("type") == "continuous":
                joint.set("type", "revolute")
                limit = None
            if limit is None and joint.get("type") != "fixed":
                for old in joint.findall("limit"):
                    joint.remove(old)
                ElementTree.SubElement(joint, "limit", lower="-1e9", upper="1e9", effort="1", velocity="1")
        return pin.buildModelFromXML(ElementTree.tostring(root, encoding="unicode"))

    def disagreement(self, q: Array) -> float:
        """Return the largest difference (matrix entry) from Pinocchio's link poses at joint vectors (M, n)."""
        model = self.pinocchio()
        data, worst = model.createData(), 0.0
        order = [self.joint_names.index(name) for name in list(model.names)[1:]]
        placed = self.place(q)
        for row, values in enumerate(q):
            pin.framesForwardKinematics(model, data, values[order])
            for name, poses in placed.items():
                worst = max(worst, float(np.abs(data.oMf[model.getFrameId(name)].homogeneous - poses[row]).max()))
        return worst

    def _checked_pairs(self, srdf: str | None) -> list[tuple[str, str]]:
        """Return the pairs of links that must not touch: pairs with relative motion that no rule excludes."""
        disabled: set[frozenset[str | None]] = set()
        if srdf is not None:
            entries = ElementTree.fromstring(srdf).findall("disable_collisions")
            disabled |= {frozenset((entry.get("link1"), entry.get("link2"))) for entry in entries}
        for link in self.links:
            for name in self.above(link.name)[1:]:
                disabled.add(frozenset((link.name, name)))
                if name in self.parts:
                    break
        limited = np.isfinite(self.lower) & np.isfinite(self.upper)
        middle = np.where(limited, 0.5 * (np.where(limited, self.lower, 0.0) + np.where(limited, self.upper, 0.0)), 0.0)
        placed = self.place(middle[None])
        names, found = list(self.parts), []
        for index, one in enumerate(names):
            for two in names[index + 1 :]:
                if frozenset((one, two)) in disabled or self.movers(one) == self.movers(two):
                    continue
                if srdf is None and touches(self.parts[one], placed[one][0], self.parts[two], placed[two][0]):
                    continue
                found.append((one, two))
        return found


def keep_below(root: ElementTree.Element, base: str) -> None:
    """Remove the links and joints of a URDF that are not descendants of the link ``base``."""
    kept, joints = {base}, root.findall("joint")
    for _ in joints:
        kept |= {link_of(joint, "child") for joint in joints if link_of(joint, "parent") in kept}
    for joint in joints:
        if link_of(joint, "parent") not in kept:
            root.remove(joint)
    for link in root.findall("link"):
        if link.get("name") not in kept:
            root.remove(link)


def link_of(joint: ElementTree.Element, which: str) -> str:
    """Return the name of a joint's parent or child link."""
    element = joint.find(which)
    assert element is not None
    return element.get("link", "")


def touches(ones: list[Part], at_one: Array, twos: list[Part], at_two: Array) -> bool:
    """Return whether the distance of two bodies is at most ``TOUCHING``."""
    return any(
        shape_distance(a.shape, transform(at_one @ a.pose), b.shape, transform(at_two @ b.pose)) < TOUCHING
        for a in ones
        for b in twos
    )


def _moving_joint(element: ElementTree.Element) -> MovingJoint:
    kind, limit = element.get("type"), element.find("limit")
    axis = element.find("axis")
    direction = numbers(None if axis is None else axis.get("xyz"), "1 0 0")

    def get(name: str) -> float:
        return 0.0 if limit is None else float(limit.get(name, "0"))

    bounded = kind != "continuous"
    return MovingJoint(
        element.get("name", ""),
        kind != "prismatic",
        direction / np.linalg.norm(direction),
        get("lower") if bounded else -np.inf,
        get("upper") if bounded else np.inf,
        get("velocity") or np.inf,
    )


def _tree(root: ElementTree.Element, moving: list[str]) -> list[TreeLink]:
    joints = {link_of(joint, "child"): joint for joint in root.findall("joint")}
    waiting = [link.get("name", "") for link in root.findall("link")]
    links: list[TreeLink] = []
    index: dict[str, int] = {}
    while waiting:
        name = waiting.pop(0)
        joint = joints.get(name)
        if joint is None:
            index[name] = len(links)
            links.append(TreeLink(name, -1, np.eye(4), -1))
            continue
        parent = link_of(joint, "parent")
        if parent not in index:
            waiting.append(name)
            continue
        index[name] = len(links)
        at = moving.index(joint.get("name", "")) if joint.get("name") in moving else -1
        links.append(TreeLink(name, index[parent], pose_of(joint.find("origin")), at))
    return links


def _couplings(moving: list[ElementTree.Element], names: list[str]) -> dict[int, Coupling]:
    """Return the mimic joints by their index, each expressed by the independent joint at the end of its mimic chain."""
    raw: dict[int, Coupling] = {}
    for index, joint in enumerate(moving):
        mimic = joint.find("mimic")
        if mimic is not None:
            factor, offset = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
            raw[index] = Coupling(names.index(mimic.get("joint", "")), factor, offset)
    found = {}
    for index, coupling in raw.items():
        source, factor, offset = coupling.source, coupling.factor, coupling.offset
        while source in raw:
            step = raw[source]
            source, factor, offset = step.source, factor * step.factor, factor * step.offset + offset
        found[index] = Coupling(source, factor, offset)
    return found


def motion(joint: MovingJoint, values: Array) -> Array:
    """Return the poses (M, 4, 4) of the child link in the joint frame at joint values (M,)."""
    out = np.broadcast_to(np.eye(4), (len(values), 4, 4)).copy()
    if not joint.turns:
        out[:, :3, 3] = values[:, None] * joint.axis
        return out
    x, y, z = joint.axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(values)[:, None, None], (1.0 - np.cos(values))[:, None, None]
    out[:, :3, :3] += sine * cross + versine * (cross @ cross)
    return out
