"""Combine URDF files, such as an arm and a hand, and store the combined URDF for simulator and planner."""

from __future__ import annotations

import copy
import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import gensim2_kpam
from gensim2.core.errors import InputError
from gensim2.core.files import cache_dir, write_changed
from gensim2.core.foreign.geometry import MAX_URDF, read_xml
from gensim2.core.foreign.tree import read_input
from gensim2.robots.profile import RobotFiles


def read_description(urdf: Path) -> ET.Element:
    """Read a URDF, and make the paths of its meshes absolute.

    Raises:
        InputError: the file cannot be read.
        gensim2_kpam.UrdfError: the planner cannot read the URDF.

    Example:
        ```python
        arm = read_description(Path("ur5e.urdf"))
        print([link.get("name") for link in arm.iter("link")])
        ```
    """
    gensim2_kpam.read_urdf(read_input(urdf, MAX_URDF), str(urdf))
    root = read_xml(urdf)
    for mesh in root.iter("mesh"):
        mesh.set("filename", str(urdf.parent.absolute() / str(mesh.get("filename"))))
    return root


def mounted(
    arm: ET.Element,
    flange: str,
    hand: ET.Element,
    palm: str,
    *,
    xyz: Sequence[float] = (0.0, 0.0, 0.0),
    rpy: Sequence[float] = (0.0, 0.0, 0.0),
) -> ET.Element:
    """Return the URDF of an arm with a hand: ``palm`` and its descendants, fixed to the arm's ``flange``.

    Args:
        arm, hand: results of :func:`read_description`; neither is changed.
        flange: link of the arm.
        palm: link of the hand's URDF; links above the palm are left out.
        xyz, rpy: position (m) and roll, pitch, yaw (rad) of the palm in the flange's frame.

    Raises:
        InputError: a link does not exist, or both URDFs have a link or a joint of the same name.

    Example:
        ```python
        arm = read_description(Path("ur5e.urdf"))
        hand = read_description(robot_folder("panda") / "panda_v2.urdf")
        both = mounted(arm, "flange", hand, "panda_hand")
        ```
    """
    root = copy.deepcopy(arm)
    for element, link in ((root, flange), (hand, palm)):
        if link not in _links(element):
            raise InputError(f"the URDF {element.get('name')!r} has no link {link!r}", field="link")
    names = {palm}
    # A child may precede its parent in the file. One pass for each joint finds all links in any order.
    for joint in (joints := hand.findall("joint")) * len(joints):
        if _end(joint, "parent") in names:
            names.add(_end(joint, "child"))
    hanging = [joint for joint in joints if _end(joint, "parent") in names]
    there = _links(root) | {str(joint.get("name")) for joint in root.findall("joint")}
    twice = sorted((names | {str(joint.get("name")) for joint in hanging}) & there)
    if twice:
        wrong = f"arm and hand both have a link or joint named {twice[0]!r}"
        raise InputError(wrong, field="name", remedy="rename one")
    for material in hand.findall("material"):
        root.append(copy.deepcopy(material))
    mount = ET.SubElement(root, "joint", name=f"{palm}_mount", type="fixed")
    ET.SubElement(mount, "origin", xyz=" ".join(map(repr, xyz)), rpy=" ".join(map(repr, rpy)))
    ET.SubElement(mount, "parent", link=flange)
    ET.SubElement(mount, "child", link=palm)
    root.extend(copy.deepcopy(link) for link in hand.findall("link") if link.get("name") in names)
    root.extend(copy.deepcopy(joint) for joint in hanging)
    return root


def touching_neighbours(root: ET.Element, *pairs: tuple[str, str]) -> str:
    """Return an SRDF that excludes joined links and the pairs ``pairs`` from collision checks.

    Example:
        ```python
        srdf = touching_neighbours(read_description(Path("ur5e.urdf")), ("wrist_1_link", "wrist_3_link"))
        ```
    """
    srdf = ET.Element("robot", name=str(root.get("name")))
    joined = [(_end(joint, "parent"), _end(joint, "child")) for joint in root.findall("joint")]
    for one, other in (*joined, *pairs):
        # SAPIEN ignores a disable_collisions element if its reason is not "Default".
        ET.SubElement(srdf, "disable_collisions", link1=one, link2=other, reason="Default")
    return ET.tostring(srdf, encoding="unicode")


def stored(name: str, urdf: ET.Element | str, srdf: str) -> RobotFiles:
    """Write a robot description into the user's cache folder, in a subfolder named by the description's hash.

    Args:
        name: file name without suffix.
        urdf: URDF.
        srdf: SRDF.

    Raises:
        InputError: the cache folder cannot be written to.

    Example:
        ```python
        arm = read_description(Path("ur5e.urdf"))
        files = stored("ur5e", arm, touching_neighbours(arm))
        ```
    """
    text = urdf if isinstance(urdf, str) else ET.tostring(urdf, encoding="unicode")
    folder = cache_dir() / "robots" / hashlib.sha256((text + srdf).encode()).hexdigest()[:16]
    files = RobotFiles(folder / f"{name}.urdf", folder / f"{name}.srdf")
    for path, content in ((files.urdf, text), (files.srdf, srdf)):
        write_changed(path, content)
    return files


def _links(root: ET.Element) -> set[str]:
    return {str(link.get("name")) for link in root.findall("link")}


def _end(joint: ET.Element, end: str) -> str:
    return next(str(element.get("link")) for element in joint.findall(end))
