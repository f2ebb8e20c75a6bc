"""Links of robots and objects as the builder of MuJoCo models takes them: inertias and convex shapes, read once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gensim2.core.foreign.geometry import opened_mesh, read_xml
from gensim2.objects import RigidObject
from gensim2.objects.library.prepare import box_of
from gensim2.objects.library.urdf import ShapeElement, UrdfJoint, link_inertial, shape_elements, unit_axis
from gensim2.objects.physics import Inertial
from gensim2.objects.shapes import convex_hull
from gensim2.objects.types import BODY
from gensim2.perception.raycast.kinematics import read_urdf

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CollisionShape:
    """A convex collision shape.

    Attributes:
        kind: ``"box"`` (size: half sides), ``"sphere"`` (radius), ``"cylinder"`` or ``"capsule"`` (radius, half length)
            or ``"mesh"``.
        size: m; empty of a mesh.
        vertices: (N, 3) of a mesh, m.
        T: (4, 4) pose in its link.
    """

    kind: str
    size: tuple[float, ...]
    vertices: Array | None
    T: Array


@dataclass(frozen=True, eq=False)
class Link:
    """A link of a robot or of an object.

    Attributes:
        name: in its URDF; ``"body"`` of a rigid object.
        parent: name of the link above; None of the root.
        joint: above it; None of the root.
        axis: (3,) unit axis of a joint that moves, in its own frame; None otherwise.
        inertial: None of a frame without a mass.
        solids: that collide.
    """

    name: str
    parent: str | None
    joint: UrdfJoint | None
    axis: Array | None
    inertial: Inertial | None
    solids: tuple[CollisionShape, ...]


@lru_cache(maxsize=256)
def links_of(urdf: Path, content_hash: str = "") -> tuple[Link, ...]:
    """Read the links of a URDF; parents come before their children.

    Args:
        urdf: the file.
        content_hash: of what it was made from.

    Raises:
        InputError: it cannot be read, or is none.
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
    """Return the only link of a rigid object."""
    inertial = Inertial(rigid.mass, rigid.center_of_mass, rigid.inertia)
    return Link(BODY, None, None, None, inertial, tuple(_hull(hull) for hull in rigid.hulls[BODY]))


@cache
def never_touching(srdf: Path) -> frozenset[frozenset[str]]:
    """Read the pairs of links that an SRDF exempts from collision.

    Raises:
        InputError: it cannot be read.
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
    """(N, 3) vertices of the convex hull of a mesh file."""
    with opened_mesh(file) as scene:
        vertices = np.asarray(scene.to_geometry().vertices, dtype=np.float64)
        return np.asarray(vertices[convex_hull(vertices).vertices])
