"""Convert the URDF of a mobile robot to the URDF of a fixed arm with this package's hand frame."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from gensim2.core.arrays import Array
from gensim2.core.foreign.geometry import read_xml
from gensim2.robots.description import read_description


def fixed_base(
    urdf: Path,
    *,
    base: str,
    standing: Mapping[str, float],
    turns: float,
    palm: str,
    hand: str,
    pitch: float,
    tool: str,
    tool_at: float,
) -> str:
    """Return the text of a URDF with a fixed base.

    Links before ``base`` are left out, ``standing`` joints are fixed, and continuous joints get limits. Mesh paths are
    absolute.

    Args:
        urdf: URDF file, with mesh paths relative to the file.
        base: link that becomes the root.
        standing: names of the joints to fix, with the joint values (rad or m) at which they are fixed.
        turns: limit of continuous joints, rad.
        palm: link that carries the fingers.
        hand: name of the new hand link at the origin of the palm. The link has no geometry and becomes the parent of
            the palm.
        pitch: pitch of the hand in the palm's frame, rad.
        tool: name of the new tool link, added without geometry on the hand's z axis.
        tool_at: position of the tool link along the hand's z axis, m.
    """
    root = read_description(urdf)
    _drop_above(root, base)
    for joint in root.findall("joint"):
        value = standing.get(str(joint.get("name")))
        if value is not None:
            _place(joint, _origin(joint) * _motion(joint, value))
            joint.set("type", "fixed")
        elif joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            assert limit is not None, "a continuous joint of a robot that we know"
            limit.attrib.update(lower=repr(-turns), upper=repr(turns))
    over = next(joint for joint in root.findall("joint") if _link(joint, "child") == palm)
    turn = RigidTransform.from_rotation(Rotation.from_euler("y", pitch))
    _join(root, _link(over, "parent"), hand, _origin(over) * turn, over)
    _join(root, hand, palm, turn.inv())
    _join(root, hand, tool, RigidTransform.from_translation([0.0, 0.0, tool_at]))
    return ET.tostring(root, encoding="unicode")


def never_touching(srdf: Path, *pairs: tuple[str, str]) -> str:
    """Return the text of an SRDF file, extended by pairs of links whose collisions are ignored.

    Collisions between neighbours are ignored. The SRDF must exclude pairs that an inserted link separates.
    """
    root = read_xml(srdf)
    for one, other in pairs:
        ET.SubElement(root, "disable_collisions", link1=one, link2=other, reason="Default")
    return ET.tostring(root, encoding="unicode")


def _drop_above(root: ET.Element, base: str) -> None:
    above = {_link(joint, "child"): joint for joint in root.findall("joint")}
    links = {link.get("name"): link for link in root.findall("link")}
    while base in above:
        joint = above[base]
        base = _link(joint, "parent")
        root.remove(joint)
        root.remove(links[base])


def _join(root: ET.Element, parent: str, child: str, pose: RigidTransform, joint: ET.Element | None = None) -> None:
    """Attach ``child`` to ``parent`` with a fixed joint; create the link and the joint if they do not exist."""
    if all(link.get("name") != child for link in root.findall("link")):
        ET.SubElement(root, "link", name=child)
    if joint is None:
        joint = ET.SubElement(root, "joint", name=f"{child}_fixed", type="fixed")
    for tag, link in (("parent", parent), ("child", child)):
        end = joint.find(tag)
        end = ET.SubElement(joint, tag) if end is None else end
        end.set("link", link)
    _place(joint, pose)


def _link(joint: ET.Element, end: str) -> str:
    return next(str(element.get("link")) for element in joint.findall(end))


def _numbers(joint: ET.Element, tag: str, name: str, default: str) -> Array:
    element = joint.find(tag)
    return np.array((default if element is None else element.get(name, default)).split(), dtype=np.float64)


def _origin(joint: ET.Element) -> RigidTransform:
    turn = Rotation.from_euler("xyz", _numbers(joint, "origin", "rpy", "0 0 0"))
    return RigidTransform.from_components(_numbers(joint, "origin", "xyz", "0 0 0"), turn)


def _motion(joint: ET.Element, value: float) -> RigidTransform:
    step = value * _numbers(joint, "axis", "xyz", "1 0 0")
    if joint.get("type") == "prismatic":
        return RigidTransform.from_translation(step)
    return RigidTransform.from_rotation(Rotation.from_rotvec(step))


def _place(joint: ET.Element, pose: RigidTransform) -> None:
    origin = joint.find("origin")
    origin = ET.SubElement(joint, "origin") if origin is None else origin
    with warnings.catch_warnings():
        # SciPy warns in gimbal lock. Any of the possible angles is correct there.
        warnings.simplefilter("ignore", UserWarning)
        turn = pose.rotation.as_euler("xyz")
    origin.set("xyz", " ".join(map(repr, pose.translation.tolist())))
    origin.set("rpy", " ".join(map(repr, turn.tolist())))
