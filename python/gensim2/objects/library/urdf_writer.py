"""Write the URDF of a model that is converted from another format."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gensim2.core.foreign.limits import LONGEST_LINK_NAME
from gensim2.objects.library.meshes import write_obj
from gensim2.objects.library.prepare import numbers, rpy_from_matrix
from gensim2.objects.library.urdf import URDF
from gensim2.objects.shapes import Mesh
from gensim2.objects.types import Array


class UrdfWriter:
    """Builds a URDF and its meshes in an existing folder.

    Args:
        folder: folder of the files.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._root = ET.Element("robot", name="object")
        self._names: set[str] = set()
        self._meshes = 0

    def name(self, written: str, kind: str) -> str:
        """Return a name that is valid in a URDF and that no other element of this URDF has.

        Args:
            written: name of the element in the source file. Only the last part of a path such as ``"/World/door"``
                counts.
            kind: kind of the element, such as ``"link"``. It serves as the name if ``written`` has no valid character.
        """
        plain = re.sub(r"[^\w.-]", "_", written.rpartition("/")[2])[: LONGEST_LINK_NAME - 8].strip(".") or kind
        name = next(
            each for n in range(len(self._names) + 1) if (each := f"{plain}_{n}" if n else plain) not in self._names
        )
        self._names.add(name)
        return name

    def link(self, name: str) -> ET.Element:
        return ET.SubElement(self._root, "link", name=name)

    def join(self, kind: str, name: str, parent: str, child: str, T: Array) -> ET.Element:
        """Add a joint; ``T`` (4, 4) is the pose of the child link in the frame of the parent link."""
        element = ET.SubElement(self._root, "joint", name=name, type=kind)
        ET.SubElement(element, "parent", link=parent)
        ET.SubElement(element, "child", link=child)
        element.append(_origin(T))
        return element

    @staticmethod
    def move(
        joint: ET.Element,
        axis: Sequence[float] | Array,
        limits: tuple[float, float] | None,
        friction: float = 0.0,
        damping: float = 0.0,
    ) -> None:
        """Set the axis, the limits (rad or m), the Coulomb friction and the damping of a joint."""
        ET.SubElement(joint, "axis", xyz=numbers(np.asarray(axis)))
        ET.SubElement(joint, "dynamics", friction=f"{friction:.9g}", damping=f"{damping:.9g}")
        if limits is not None:
            lower, upper = limits
            ET.SubElement(joint, "limit", lower=f"{lower:.9g}", upper=f"{upper:.9g}", effort="0", velocity="0")

    @staticmethod
    def weigh(link: ET.Element, mass: float, T: Array, inertia: Array) -> None:
        """Set the mass (kg), the pose (4, 4) of the inertial frame, and the inertia (3, 3) in that frame (kg m²)."""
        inertial = ET.SubElement(link, "inertial")
        inertial.append(_origin(T))
        ET.SubElement(inertial, "mass", value=f"{mass:.9g}")
        places = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
        ET.SubElement(inertial, "inertia", {key: f"{inertia[place]:.9g}" for key, place in places.items()})

    def add_mesh(self, link: ET.Element, kind: str, T: Array, mesh: Mesh) -> None:
        """Add a mesh as a ``visual`` or ``collision`` element at the pose ``T`` (4, 4)."""
        file = f"mesh_{self._meshes}.obj"
        self._meshes += 1
        write_obj(self._folder / file, [mesh])
        self._add(link, kind, T, "mesh", {"filename": file})

    def add_primitive(
        self,
        link: ET.Element,
        kind: str,
        T: Array,
        shape: str,
        size: Sequence[float] | Array,
        rgba: Sequence[float] | Array,
    ) -> None:
        """Add a primitive as a ``visual`` or ``collision`` element.

        Args:
            T: (4, 4) pose in the link's frame.
            shape: ``box``, ``sphere``, ``cylinder`` or ``capsule``.
            size: dimensions, m: sides of a box, radius of a sphere, or radius and length of a cylinder or capsule.
            rgba: (4,) colour of a visual element, 0 to 1.
        """
        names = {"box": (), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}
        sizes = {name: f"{value:.9g}" for name, value in zip(names[shape], size, strict=False)}
        element = self._add(link, kind, T, shape, sizes or {"size": numbers(np.asarray(size))})
        if kind == "visual":
            dressed = ET.SubElement(element, "material", name=self.name("look", "look"))
            ET.SubElement(dressed, "color", rgba=numbers(np.asarray(rgba)))

    @staticmethod
    def _add(link: ET.Element, kind: str, T: Array, shape: str, attributes: dict[str, str]) -> ET.Element:
        element = ET.SubElement(link, kind)
        element.append(_origin(T))
        ET.SubElement(ET.SubElement(element, "geometry"), shape, attributes)
        return element

    def write(self) -> Path:
        """Write the URDF file and return its path."""
        file = self._folder / URDF
        ET.ElementTree(self._root).write(file, encoding="utf-8", xml_declaration=True)
        return file


def _origin(T: Array) -> ET.Element:
    return ET.Element("origin", xyz=numbers(T[:3, 3]), rpy=numbers(rpy_from_matrix(T[:3, :3])))
