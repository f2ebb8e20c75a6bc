"""Read the links of robots and objects for MuJoCo models: inertias and convex shapes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import numpy as np

from gensim2.core.arrays import Array
from gensim2.core.foreign.geometry import opened_mesh, read_xml
from gensim2.objects import RigidObject
from gensim2.objects.library.prepare import box_of
from gensim2.objects.library.urdf import ShapeElement, UrdfJoint, link_inertial, shape_elements, unit_axis
from gensim2.objects.physics import Inertial
from gensim2.objects.shapes import convex_hull
from gensim2.objects.types import BODY
from gensim2.perception.raycast.kinematics import read_urdf


@dataclass(frozen=True, eq=False)
class CollisionShape:
    """A convex collision shape.

    Attributes:
        kind: ``"box"``, ``"sphere"``, ``"cylinder"``, ``"capsule"`` or ``"mesh"``.
        size: half lengths of a box, radius of a sphere, or radius and half length of a cylinder or capsule, metres;
            empty for other shapes.
        vertices: (N, 3) vertices of a mesh, m.
        T: (4, 4) pose in the link frame.
    """

    kind: str
    size: tuple[float, ...]
    vertices: Array | None
    T: Array


@dataclass(frozen=True, eq=False)
class Link:
    """A link of a robot or an object.

    Attributes:
        name: name in the URDF; ``"body"`` for a rigid object.
        parent: name of the parent link; None for the root.
        joint: joint to the parent; None for the root.
        axis: (3,) unit axis of a moving joint, in the joint frame; None for a fixed joint or the root.
        inertial: inertia; None for a frame without mass.
    """

    name: str
    parent: str | None
    joint: UrdfJoint | None
    axis: Array | None
    inertial: Inertial | None
    solids: tuple[CollisionShape, ...]


@lru_cache(maxsize=256)
def links_of(urdf: Path, content_hash: str = "") -> tuple[Link, ...]:
    """Read the links of a URDF. Each link comes after its parent link.

    Args:
        content_hash: hash of the object's files; results are cached by it.

    Raises:
        InputError: the file cannot be read or is not a URDF.
    """
    description = read_urdf(urdf)
    above = {joint.child: joint for joint in description.joints}
    below: dict[str, list[str]] = {}
    for joint in description.joints:
        below.setdefault(joint.parent, []).append(joint.child)
    waiting = [name for name in description.links if name not in above]
    links = []
    while waiting:
        name = waiting.pop(0)
        waiting += below.get(name, [])
        joint_above = above.get(name)
        moves = joint_above is not None and joint_above.type != "fixed"
        links.append(
            Link(
                name,
                None if joint_above is None else joint_above.parent,
                joint_above,
                unit_axis(joint_above, urdf) if joint_above is not None and moves else None,
                link_inertial(description, name),
                tuple(_solid(each, urdf) for each in shape_elements(description, name, "collision")),
            )
        )
    return tuple(links)


def rigid_link(rigid: RigidObject) -> Link:
    inertial = Inertial(rigid.mass, rigid.center_of_mass, rigid.inertia)
    return Link(BODY, None, None, None, inertial, tuple(_hull(hull) for hull in rigid.hulls[BODY]))


@cache
def never_touching(srdf: Path) -> frozenset[frozenset[str]]:
    """Read the pairs of links that an SRDF exempts from collision.

    Raises:
        InputError: the file cannot be read.
    """
    pairs = read_xml(srdf).iter("disable_collisions")
    return frozenset(frozenset((str(pair.get("link1")), str(pair.get("link2")))) for pair in pairs)


def _solid(element: ShapeElement, urdf: Path) -> CollisionShape:
    shape = element.shape
    if isinstance(shape, str):
        hull = _hull(_mesh_vertices(urdf.parent / shape) * element.scale)
        return CollisionShape(hull.kind, hull.size, hull.vertices, element.T @ hull.T)
    size = shape.size
    if shape.kind == "box":
        size = tuple(0.5 * side for side in size)
    elif shape.kind in ("cylinder", "capsule"):
        size = (size[0], 0.5 * size[1])
    return CollisionShape(shape.kind, size, None, element.T)


def _hull(vertices: Array) -> CollisionShape:
    box = box_of(vertices)
    if box is not None:
        T, size = box
        return CollisionShape("box", tuple(float(0.5 * side) for side in size), None, T)
    return CollisionShape("mesh", (), vertices, np.eye(4))


def _mesh_vertices(file: Path) -> Array:
    """Return the vertices (N, 3) of the convex hull of a mesh file."""
    with opened_mesh(file) as scene:
        vertices = np.asarray(scene.to_geometry().vertices, dtype=np.float64)
        return np.asarray(vertices[convex_hull(vertices).vertices])
