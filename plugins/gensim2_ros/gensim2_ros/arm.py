"""A robot of the solver with the names that messages refer to."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import gensim2_kpam as kpam

from .poses import Array, inverse

File = str | os.PathLike[str]


@dataclass(frozen=True)
class Arm:
    """A robot, its planning frame and the joints that move its hand.

    Attributes:
        robot: the solver's robot.
        group: name of the planning group in requests.
        hand_link: link that carries the tool.
        base_frames: names of the planning frame: the base link, and parents of fixed virtual joints in the SRDF.
        joints: names of the joints that move the hand, in the order of joint vectors.
        mimics: source of each mimic joint.
        chains: names of the joints between the base and each link; mimic joints count as their source.
    """

    robot: kpam.Robot
    group: str
    hand_link: str
    base_frames: tuple[str, ...]
    joints: tuple[str, ...]
    mimics: dict[str, str]
    chains: dict[str, frozenset[str]]

    @staticmethod
    def from_urdf(
        urdf: File,
        *,
        group: str,
        hand_link: str,
        srdf: File | None = None,
        base_link: str | None = None,
        package_dirs: Sequence[File] = (),
    ) -> Arm:
        """Read a robot.

        Args:
            urdf: URDF file.
            group: name of the planning group in requests.
            hand_link: link that carries the tool.
            srdf: SRDF file, as used by MoveIt.
            base_link: link of the planning frame; default: the only link without a parent.
            package_dirs: folders in which ``package://`` paths are searched.

        Raises:
            gensim2_kpam.UrdfError: a file cannot be read or used.

        Example:
            ```python
            arm = Arm.from_urdf("ur5e.urdf", group="manipulator", hand_link="flange")
            ```
        """
        robot = kpam.Robot.from_urdf(
            urdf, hand_link=hand_link, srdf=srdf, base_link=base_link, package_dirs=list(package_dirs)
        )
        joints = kpam.read_urdf(Path(urdf).read_bytes(), str(urdf))["joints"]
        above = {joint["child"]: joint for joint in joints}
        base = base_link or next(each for each in robot.link_names if each not in above)
        chains = {link: _chain(above, base, link) for link in robot.link_names}
        moving = tuple(name for name in robot.joint_names if name in chains[hand_link])
        mimics = {joint["name"]: joint["mimic"]["joint"] for joint in joints if joint["mimic"]}
        return Arm(robot, group, hand_link, (base, *_virtual_parents(srdf, base)), moving, mimics, chains)

    def moves_with_hand(self, link: str) -> bool:
        """Return whether a link keeps its pose relative to the hand during motions."""
        return self.chains[link] & set(self.joints) == set(self.joints)

    def is_fixed(self, link: str) -> bool:
        """Return whether motions do not move a link."""
        return not self.chains[link] & set(self.joints)

    def in_hand(self, link: str, q: Array) -> Array:
        """Return the pose (4, 4) of a link in the hand frame at joints ``q`` (n,)."""
        return inverse(self.robot.forward_kinematics(q)) @ self.robot.forward_kinematics(q, link)

    @cached_property
    def unchecked(self) -> list[tuple[str, str]]:
        """Pairs of links that move relative to each other and that the solver does not check for collisions."""
        pairs = [pair["links"] for pair in self.robot.self_collisions() if not pair["checked"]]
        return [(a, b) for a, b in pairs if self.chains[a] != self.chains[b]]

    def vector(self, joints: dict[str, float]) -> Array:
        """Return the joint vector (n,) of joint values by name. Mimic joints follow their sources, and missing values
        are NaN."""
        names = self.robot.joint_names
        q = np.array([joints.get(self.mimics.get(name, name), np.nan) for name in names])
        followed = self.robot.apply_mimic(np.nan_to_num(q))
        return np.where(np.isnan(q), np.nan, followed)


def _chain(above: dict[str, Any], base: str, link: str) -> frozenset[str]:
    found = set()
    while link != base and link in above:
        joint = above[link]
        if joint["kind"] != "fixed":
            found.add(joint["mimic"]["joint"] if joint["mimic"] else joint["name"])
        link = joint["parent"]
    return frozenset(found)


def _virtual_parents(srdf: File | None, base: str) -> list[str]:
    if srdf is None:
        return []
    virtual = ElementTree.parse(srdf).getroot().iter("virtual_joint")
    return [
        joint.get("parent_frame", "")
        for joint in virtual
        if joint.get("type") == "fixed" and joint.get("child_link") == base
    ]
