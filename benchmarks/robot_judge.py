"""Judge configurations and motions of any URDF arm with Pinocchio's kinematics and coal's collision checks.

The module uses no code of the solver. Link meshes are checked twice: as convex hulls, and as the triangles of the file.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
from mechanism import link_of, mesh_file
from sampling import connect

Array = np.ndarray
Pairs = Iterable[tuple[str, str]]

#: Depth (m) of an overlap of hulls that is not reported.
DEPTH = 1e-4
#: Motion (m) of the arm between two samples that are checked, bounded by joint steps times the arm's reach.
STEP = 5e-3
#: Relative tolerance of velocity and acceleration limits, and tolerance of positions, rad or m.
RELATIVE, POSITION = 1e-3, 1e-9
#: Largest joint step (rad or m) of the other planner's checks, and of the final check of its path.
COARSE, FINE = 0.03, 0.003


@dataclass(frozen=True)
class Box:
    """A box in the base frame, with half extents (3,) in m and a pose (4, 4)."""

    half: Array
    pose: Array


class RobotModel:
    """Pinocchio's model of a URDF. Joint vectors have the order ``names``.

    Args:
        urdf: the file.
        names: names of all moving joints.
        planned: names of the joints that motions move.
    """

    def __init__(self, urdf: Path, names: list[str], planned: list[str]) -> None:
        root = ElementTree.fromstring(re.sub(rb"(</?|\s)\w+:(?=\w)", rb"\1", urdf.read_bytes()))
        joints = root.findall("joint")
        self.parent = {link_of(joint, "child"): joint for joint in joints}
        self.mimics = {
            joint.get("name", ""): (
                mimic.get("joint", ""),
                float(mimic.get("multiplier", "1")),
                float(mimic.get("offset", "0")),
            )
            for joint in joints
            for mimic in joint.findall("mimic")
        }
        self.names, self.planned = names, planned
        self.links = [link.get("name", "") for link in root.findall("link")]
        self._movers = {link: self._find_movers(link) for link in self.links}
        self.text = _plain(root, urdf.parent)
        self.model = pin.buildModelFromXML(self.text)
        self.data = self.model.createData()
        self.order = np.array([self.model.joints[self.model.getJointId(name)].idx_q for name in names])

    def vector(self, q: Array) -> Array:
        """Return Pinocchio's joint vector of ``q`` (n,); mimic joints follow their sources."""
        values = dict(zip(self.names, q, strict=True))

        def value(name: str) -> float:
            if name not in self.mimics:
                return float(values[name])
            source, factor, offset = self.mimics[name]
            return factor * value(source) + offset

        out = np.zeros(self.model.nq)
        out[self.order] = [value(name) for name in self.names]
        return out

    def poses(self, q: Array) -> dict[str, Array]:
        """Return the poses (4, 4) of all links in the base frame."""
        pin.framesForwardKinematics(self.model, self.data, self.vector(q))
        return {name: self.data.oMf[self.model.getFrameId(name, pin.BODY)].homogeneous for name in self.links}

    def jacobian(self, q: Array, link: str) -> Array:
        """Return the Jacobian (6, n) of a link in base axes; columns of mimic joints are added to their sources."""
        frame = self.model.getFrameId(link, pin.BODY)
        raw = pin.computeFrameJacobian(self.model, self.data, self.vector(q), frame, pin.LOCAL_WORLD_ALIGNED)
        out = raw[:, self.order].copy()
        for name in self.names:
            source, factor, column = name, 1.0, self.names.index(name)
            while source in self.mimics:
                source, step, _ = self.mimics[source]
                factor *= step
            if source != name:
                out[:, self.names.index(source)] += factor * raw[:, self.order[column]]
                out[:, column] = 0.0
        return out

    def movers(self, link: str) -> frozenset[str]:
        """Return the planned joints that move a link; none if ``link`` is the name of a box."""
        return self._movers.get(link, frozenset())

    def _find_movers(self, link: str) -> frozenset[str]:
        found = set()
        while link in self.parent:
            name = self.parent[link].get("name", "")
            while name in self.mimics:
                name = self.mimics[name][0]
            found.add(name)
            link = link_of(self.parent[link], "parent")
        return frozenset(found & set(self.planned))


class Shapes:
    """Collision shapes of the links and of boxes, with the pairs that must not collide.

    Args:
        robot: the model.
        pairs: pairs of links that are checked.
        hulls: whether a mesh counts as its convex hull.
    """

    def __init__(self, robot: RobotModel, pairs: Pairs, *, hulls: bool) -> None:
        self.robot = robot
        self.geometry = pin.buildGeomFromUrdfString(robot.model, robot.text, pin.GeometryType.COLLISION)
        self.of_link: dict[str, list[int]] = {}
        for index, each in enumerate(self.geometry.geometryObjects):
            self.of_link.setdefault(robot.model.frames[each.parentFrame].name, []).append(index)
            if hulls and isinstance(each.geometry, coal.BVHModelBase):
                each.geometry.buildConvexHull(True, "Qt")
                each.geometry = each.geometry.convex
        self.moving = [link for link in self.of_link if robot.movers(link)]
        self.pairs: list[tuple[str, str]] = []
        for one, two in pairs:
            self._add(one, two, self.of_link.get(one, []), self.of_link.get(two, []))
        self.depth = DEPTH if hulls else 0.0
        self._own, self._own_pairs = self.geometry.ngeoms, list(self.pairs)
        self._refresh()

    def place(self, boxes: list[Box]) -> None:
        """Replace the boxes."""
        for index in range(self.geometry.ngeoms - self._own):
            self.geometry.removeGeometryObject(f"box {index}")
        self.pairs = list(self._own_pairs)
        for index, box in enumerate(boxes):
            shape, pose = coal.Box(*(2 * box.half)), pin.SE3(box.pose)
            added = self.geometry.addGeometryObject(pin.GeometryObject(f"box {index}", 0, pose, shape))
            for link in self.moving:
                self._add(link, f"box {index}", self.of_link[link], [added])
        self._refresh()

    def _add(self, one: str, two: str, ones: list[int], twos: list[int]) -> None:
        for a in ones:
            for b in twos:
                self.geometry.addCollisionPair(pin.CollisionPair(a, b))
                self.pairs.append((one, two))

    def _refresh(self) -> None:
        self.data = pin.GeometryData(self.geometry)
        self.margins = np.full(len(self.pairs), -self.depth)
        for request in self.data.collisionRequests:
            request.security_margin = -self.depth
        shapes = [each.geometry for each in self.geometry.geometryObjects]
        for shape in shapes:
            shape.computeLocalAABB()
        #: Spheres around the shapes, with which distant pairs are skipped; a call to coal takes much longer.
        self._centers = np.array([shape.aabb_center for shape in shapes])
        self._radii = np.array([shape.aabb_radius for shape in shapes])
        self._ends = np.array([(pair.first, pair.second) for pair in self.geometry.collisionPairs]).reshape(-1, 2)

    def keep(self, margin: float, ends: list[Array]) -> None:
        """Require ``margin`` (m) from the boxes, or the distance at one of the configurations ``ends``, if smaller."""
        wide = [index for index, pair in enumerate(self.pairs) if pair[1].startswith("box ")]
        near = dict.fromkeys(wide, margin)
        for q in ends:
            pin.computeDistances(self.robot.model, self.robot.data, self.geometry, self.data, self.robot.vector(q))
            for index in wide:
                near[index] = min(near[index], self.data.distanceResults[index].min_distance - DEPTH)
        for index in wide:
            self.data.collisionRequests[index].security_margin = self.margins[index] = near[index]

    def _near(self, q: Array) -> list[int]:
        """Return the indices of the pairs whose spheres are close to each other at joints ``q`` (n,)."""
        pin.updateGeometryPlacements(self.robot.model, self.robot.data, self.geometry, self.data, self.robot.vector(q))
        places = np.array([place.homogeneous for place in self.data.oMg])
        centers = np.einsum("kij,kj->ki", places[:, :3, :3], self._centers) + places[:, :3, 3]
        one, two = self._ends.T
        apart = np.linalg.norm(centers[one] - centers[two], axis=1) - self._radii[one] - self._radii[two]
        return np.flatnonzero(apart <= np.maximum(self.margins, 0.0) + DEPTH).tolist()

    def _collide(self, pair: int) -> bool:
        return bool(pin.computeCollision(self.geometry, self.data, pair))

    def collides(self, q: Array) -> bool:
        """Return whether a pair collides at joints ``q`` (n,)."""
        return any(self._collide(pair) for pair in self._near(q))

    def colliding(self, q: Array) -> set[tuple[str, str]]:
        """Return the pairs that collide at joints ``q`` (n,)."""
        return {self.pairs[pair] for pair in self._near(q) if self._collide(pair)}


def limit_errors(
    positions: Array, dt: float, lower: Array, upper: Array, velocity: Array, acceleration: float
) -> list[str]:
    """Check positions (N, n), which are ``dt`` (s) apart, by finite differences, and return the limits exceeded."""
    errors = []
    if (positions < lower - POSITION).any() or (positions > upper + POSITION).any():
        errors.append("position")
    if (np.abs(np.diff(positions, axis=0)) / dt > velocity * (1 + RELATIVE) + 1e-9).any():
        errors.append("velocity")
    if (np.abs(np.diff(positions, 2, axis=0)) / dt**2 > acceleration * (1 + RELATIVE) + 1e-6).any():
        errors.append("acceleration")
    return errors


def thinned(positions: Array, reach: float) -> Array:
    """Return samples of a motion between which the joints move the arm by about ``STEP``."""
    moved = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(positions, axis=0)).sum(axis=1) * max(reach, 1.0))])
    kept = np.flatnonzero(np.diff(np.floor(moved / STEP), prepend=-1.0))
    return positions[np.union1d(kept, [len(positions) - 1])]


def along(one: Array, two: Array, step: float) -> Array:
    """Return points (K, n) of the straight line between two joint vectors, at most ``step`` apart in each joint."""
    count = max(1, int(np.ceil(np.abs(two - one).max() / step)))
    return one + np.linspace(0.0, 1.0, count + 1)[:, None] * (two - one)


def other_planner(
    shapes: Shapes, start: Array, goal: Array, sample: Callable[[], Array], late: Callable[[], bool]
) -> list[Array] | None:
    """Search a path by RRT-Connect with coal's collision checks; the path found is checked again with smaller steps."""

    def free(q: Array) -> bool:
        return not shapes.collides(q)

    while not late():
        path = connect(start, goal, free, sample, late)
        if path is None:
            return None
        if all(free(q) for one, two in pairwise(path) for q in along(one, two, FINE)):
            return path
    return None


def _plain(root: ElementTree.Element, folder: Path) -> str:
    """Return a URDF with absolute mesh paths, without visuals, masses and mimic, and with bounded joints only."""
    for link in root.findall("link"):
        for element in [*link.findall("visual"), *link.findall("inertial")]:
            link.remove(element)
    for mesh in root.iter("mesh"):
        mesh.set("filename", str(mesh_file(mesh.get("filename", ""), folder)))
    for joint in root.findall("joint"):
        for element in joint.findall("mimic"):
            joint.remove(element)
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
        if joint.get("type") != "fixed":
            for element in joint.findall("limit"):
                joint.remove(element)
            ElementTree.SubElement(joint, "limit", lower="-1e9", upper="1e9", effort="1", velocity="1")
    for element in [child for child in root if child.tag not in ("link", "joint")]:
        root.remove(element)
    return ElementTree.tostring(root, encoding="unicode")
