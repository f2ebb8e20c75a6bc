"""Define the profile of the Panda with the long fingers and the soft finger drives of the original GenSim2."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np

from gensim2.robots.description import read_description, stored
from gensim2.robots.gripper import SlidingGripper
from gensim2.robots.panda import panda, panda_files
from gensim2.robots.profile import JointDrive, RobotFiles, RobotProfile, Simulation, finger_keypoints

FINGER_X, FINGER_Y, FINGER_Z = (-0.014, 0.014), (-0.009, 0.031), (0.0, 0.1176)
"""Bounds (m) of a finger in its link's frame; y points away from the other finger. They are the bounding box of the
original GenSim2's finger, a hull with ten vertices.
"""

FINGER_MASS = 0.1
"""Mass of a finger, kg: the hull of the original GenSim2 at a density of 1000 kg/m3."""

UNLIMITED = 1e10
"""Value that stands for an unlimited drive force (N m or N)."""


def panda_long_files() -> RobotFiles:
    """Write the Panda with long fingers to the user's cache folder and return the paths of its files.

    The description is ManiSkill's description of the Panda, in which each finger is replaced by a longer finger.

    Raises:
        InputError: the cache folder cannot be written to.
    """
    source = panda_files()
    root = read_description(source.urdf)
    for link in root.findall("link"):
        side = {"panda_leftfinger": 1.0, "panda_rightfinger": -1.0}.get(str(link.get("name")))
        if side is not None:
            _lengthen(link, side)
    return stored("panda_long", root, source.srdf.read_text(encoding="utf-8"))


def _lengthen(link: ET.Element, side: float) -> None:
    """Replace the shapes of a finger by a box. ``side`` is 1 if the finger opens towards positive y, else -1."""
    for kind in ("visual", "collision", "inertial"):
        for element in link.findall(kind):
            link.remove(element)
    bounds = np.array([FINGER_X, FINGER_Y, FINGER_Z])
    size, middle = bounds[:, 1] - bounds[:, 0], bounds.mean(axis=1) * [1.0, side, 1.0]
    for kind in ("visual", "collision"):
        element = ET.SubElement(link, kind)
        ET.SubElement(element, "origin", xyz=_text(middle), rpy="0 0 0")
        ET.SubElement(ET.SubElement(element, "geometry"), "box", size=_text(size))
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=_text(middle), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(FINGER_MASS))
    x, y, z = FINGER_MASS / 12.0 * (np.sum(size**2) - size**2)
    moments = {"ixx": repr(float(x)), "iyy": repr(float(y)), "izz": repr(float(z)), "ixy": "0", "ixz": "0", "iyz": "0"}
    ET.SubElement(inertial, "inertia", moments)


def _text(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    return " ".join(repr(float(value)) for value in values)


def panda_long() -> RobotProfile:
    """Return the profile: the Panda with the tool keypoints and drives of the original GenSim2."""
    short = panda()
    assert isinstance(short.gripper, SlidingGripper)
    return replace(
        short,
        name="panda_long",
        files=panda_long_files,
        gripper=replace(short.gripper, closed=0.0),
        tool_keypoints=finger_keypoints(tip=0.165, side=0.045, base=0.075),
        simulation=Simulation(
            agent="panda_long", arm=JointDrive(1e3, 2e2, UNLIMITED), gripper=JointDrive(20.0, 0.0, UNLIMITED)
        ),
    )
