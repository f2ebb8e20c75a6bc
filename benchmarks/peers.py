"""Independent kinematics, geometry and collision: Pinocchio, trimesh and coal. Nothing here knows gensim2's solver.

Frames and units as in the problem files: metres, radians, poses (4, 4), everything in the robot base frame.
"""

from __future__ import annotations

import importlib.util
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import trimesh

Array = np.ndarray
HAND_LINKS = ("panda_hand", "panda_leftfinger", "panda_rightfinger")
ARM_LINKS = tuple(f"panda_link{index}" for index in range(8))
TABLE_HALF = np.array([0.65, 0.65, 0.025])
FLAT = 5e-4


def panda_files() -> tuple[Path, Path]:
    """Return ManiSkill's Panda: URDF and SRDF; the environment variable-free way, from the installed wheel."""
    spec = importlib.util.find_spec("mani_skill")
    if spec is None or not spec.submodule_search_locations:
        raise SystemExit("mani_skill is not installed: its wheel holds the Panda (pip install 'gensim2[sim]')")
    folder = Path(spec.submodule_search_locations[0]) / "assets" / "robots" / "panda"
    return folder / "panda_v2.urdf", folder / "panda_v2.srdf"


def transform(pose: Array) -> coal.Transform3s:
    """(4, 4) as coal's transform."""
    return coal.Transform3s(np.ascontiguousarray(pose[:3, :3]), np.ascontiguousarray(pose[:3, 3]))


def hull(points: Array) -> coal.ConvexBase | None:
    """Convex hull of (N, 3) points; a flat set is thickened to 0.5 mm; None where there is no area."""
    if len(points) < 3:
        return None
    center = points.mean(axis=0)
    axes = np.linalg.svd(points - center, full_matrices=False)[2]
    if len(axes) < 3:
        axes = np.vstack([axes, np.cross(axes[0], axes[1])])
    spread = np.ptp((points - center) @ axes.T, axis=0)
    if spread[1] < 1e-6:
        return None
    if spread[2] < FLAT:
        shift = 0.5 * (FLAT - spread[2]) * axes[2]
        points = np.concatenate([points + shift, points - shift])
    solid = trimesh.convex.convex_hull(points)
    vertices = coal.StdVec_Vec3s()
    vertices.extend([np.asarray(vertex, dtype=float) for vertex in solid.vertices])
    triangles = coal.StdVec_Triangle()
    triangles.extend([coal.Triangle(*(int(corner) for corner in face)) for face in solid.faces])
    return coal.Convex(vertices, triangles)


@dataclass
class Part:
    """A convex shape at a pose in its body, with a bounding sphere in the body frame for quick rejection."""

    shape: Any
    pose: Array
    center: Array
    radius: float
    points: Array


def part(shape: Any, pose: Array) -> Part:
    """Wrap a coal box or convex hull."""
    if isinstance(shape, coal.Box):
        half = np.asarray(shape.halfSide).reshape(3)
        points = np.array(np.meshgrid(*([[-1.0, 1.0]] * 3))).reshape(3, -1).T * half
    else:
        points = np.array([np.asarray(shape.point(index)).reshape(3) for index in range(shape.num_points)])
    points = points @ pose[:3, :3].T + pose[:3, 3]
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return Part(shape, pose, center, float(np.linalg.norm(points - center, axis=1).max()), points)


@dataclass
class Obstacle:
    """A rigid body of a scene: ``role`` is table, object_body, moving_link, rigid, target or attached."""

    name: str
    role: str
    parts: list[Part]
    pose: Array

    def __post_init__(self) -> None:
        self.move(self.pose)

    def move(self, pose: Array) -> None:
        """Put the body elsewhere; ``low`` and ``high`` bound its parts along the base axes."""
        self.pose = pose
        self.transforms = [transform(pose @ each.pose) for each in self.parts]
        low, high = [], []
        for each in self.parts:
            points = each.points @ pose[:3, :3].T + pose[:3, 3]
            low.append(points.min(axis=0))
            high.append(points.max(axis=0))
        self.low, self.high = np.array(low), np.array(high)


REQUEST = coal.DistanceRequest()
REQUEST.enable_signed_distance = True
REQUEST.enable_nearest_points = True


def shape_distance(one: Any, at_one: Any, two: Any, at_two: Any) -> float:
    """Signed distance in metres of two convex shapes; minus the penetration depth where they overlap."""
    return float(coal.distance(one, at_one, two, at_two, REQUEST, coal.DistanceResult()))


def link_distance(parts: list[Part], T_base_link: Array, obstacle: Obstacle, cutoff: float) -> float:
    """Smallest signed distance of a link and an obstacle; ``cutoff`` where nothing is nearer than that."""
    best = cutoff
    for each in parts:
        center = T_base_link[:3, :3] @ each.center + T_base_link[:3, 3]
        outside = np.maximum(np.maximum(obstacle.low - center, center - obstacle.high), 0.0)
        bound = np.sqrt((outside**2).sum(axis=1)) - each.radius
        near = np.flatnonzero(bound < best)
        if len(near) == 0:
            continue
        at = transform(T_base_link @ each.pose)
        for index in near[np.argsort(bound[near])]:
            if bound[index] < best:
                other = obstacle.parts[index]
                best = min(best, shape_distance(each.shape, at, other.shape, obstacle.transforms[index]))
    return best


class Arm:
    """The Panda: kinematics by Pinocchio, collision shapes by coal."""

    def __init__(self) -> None:
        urdf, srdf = panda_files()
        text = re.sub(r"<mimic[^>]*/>", "", urdf.read_text())
        self.model = pin.buildModelFromXML(text)
        self.data = self.model.createData()
        self.hand = self.model.getFrameId("panda_hand")
        self.lower = np.asarray(self.model.lowerPositionLimit)
        self.upper = np.asarray(self.model.upperPositionLimit)
        self.velocity = np.asarray(self.model.velocityLimit)
        self.parts: dict[str, list[Part]] = {}
        for link in ElementTree.fromstring(text).findall("link"):
            parts = [_collision(element, urdf.parent) for element in link.findall("collision")]
            if parts:
                self.parts[link.get("name", "")] = parts
        self.frames = {name: self.model.getFrameId(name) for name in self.parts}
        disabled = {
            frozenset((entry.get("link1"), entry.get("link2")))
            for entry in ElementTree.parse(srdf).getroot().findall("disable_collisions")
        }
        names = list(self.parts)
        self.self_pairs = [
            (one, two)
            for index, one in enumerate(names)
            for two in names[index + 1 :]
            if frozenset((one, two)) not in disabled
        ]
        #: points whose hull is the link's, in the link frame
        self.corners = {name: np.concatenate([each.points for each in parts]) for name, parts in self.parts.items()}

    def place(self, q: Array) -> dict[str, Array]:
        """Poses (4, 4) of every link with collision shapes at (9,) joints; also ``panda_hand``."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return {name: self.data.oMf[frame].homogeneous.copy() for name, frame in self.frames.items()}

    def hand_pose(self, q: Array) -> Array:
        """Pose of ``panda_hand``, (4, 4)."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.hand].homogeneous.copy()

    def jacobian(self, q: Array) -> Array:
        """(6, 9): linear, angular velocity of the hand's origin in base axes."""
        return pin.computeFrameJacobian(self.model, self.data, q, self.hand, pin.LOCAL_WORLD_ALIGNED)


def _collision(element: ElementTree.Element, folder: Path) -> Part:
    origin = element.find("origin")
    pose = np.eye(4)
    if origin is not None:
        roll, pitch, yaw = (float(value) for value in origin.get("rpy", "0 0 0").split())
        pose[:3, :3] = pin.rpy.rpyToMatrix(roll, pitch, yaw)
        pose[:3, 3] = [float(value) for value in origin.get("xyz", "0 0 0").split()]
    box, mesh = element.find("geometry/box"), element.find("geometry/mesh")
    if box is not None:
        return part(coal.Box(*(float(value) for value in box.get("size", "").split())), pose)
    assert mesh is not None
    shape = hull(np.asarray(trimesh.load(folder / mesh.get("filename", ""), force="mesh").vertices))
    assert shape is not None
    return part(shape, pose)


@lru_cache(maxsize=4096)
def mesh_parts(path: Path, scale: float) -> tuple[Array, ...]:
    """Vertex sets of a mesh's connected parts, scaled; vertices at one place count as one."""
    mesh = trimesh.load(path, force="mesh", process=False)
    points, place = np.unique(np.asarray(mesh.vertices), axis=0, return_inverse=True)
    faces = place.reshape(-1)[np.asarray(mesh.faces)]
    edges = np.concatenate([faces[:, :2], faces[:, 1:]])
    groups = trimesh.graph.connected_components(edges, nodes=np.unique(faces), min_len=1)
    return tuple(scale * points[np.asarray(group)] for group in groups)


def object_obstacles(
    folder: Path, scale: float, value: float, T_base_root: Array
) -> tuple[list[Obstacle], dict[str, Array], list[str]]:
    """Load an articulated object at one joint value.

    Args:
        folder: holds ``mobility.urdf`` and its meshes.
        scale: of meshes and link offsets.
        value: joint value, rad or (scaled) m.
        T_base_root: pose of the root link.

    Returns:
        body and moving link (those that have shapes), link poses in the base frame, missing meshes.
    """
    urdf = folder / "mobility.urdf"
    tree = ElementTree.parse(urdf).getroot()
    for limit in tree.iter("limit"):
        limit.set("effort", "1")
        limit.set("velocity", "1")
    for element in tree.iter():
        if element.tag == "origin":
            xyz = [scale * float(number) for number in element.get("xyz", "0 0 0").split()]
            element.set("xyz", " ".join(repr(number) for number in xyz))
    for link in tree.findall("link"):
        for element in [*link.findall("visual"), *link.findall("inertial")]:
            link.remove(element)
    model = pin.buildModelFromXML(ElementTree.tostring(tree, encoding="unicode"))
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array([value]) if model.nq == 1 else _turn(value))
    poses, parts, missing = {}, {False: [], True: []}, []
    for link in tree.findall("link"):
        name = link.get("name", "")
        frame = model.getFrameId(name)
        poses[name] = T_base_root @ data.oMf[frame].homogeneous
        moves = model.frames[frame].parentJoint > 0
        for element in link.findall("collision"):
            origin, mesh = element.find("origin"), element.find("geometry/mesh")
            path = folder / mesh.get("filename", "")
            if not path.exists():
                missing.append(path.name)
                continue
            pose = np.linalg.inv(T_base_root) @ poses[name]
            if origin is not None:
                local = np.eye(4)
                local[:3, :3] = pin.rpy.rpyToMatrix(*(float(n) for n in origin.get("rpy", "0 0 0").split()))
                local[:3, 3] = [float(n) for n in origin.get("xyz", "0 0 0").split()]
                pose = pose @ local
            for points in mesh_parts(path, scale):
                shape = hull(points)
                if shape is not None:
                    parts[moves].append(part(shape, pose))
    obstacles = [
        Obstacle(role, role, parts[moves], T_base_root)
        for role, moves in (("object_body", False), ("moving_link", True))
        if parts[moves]
    ]
    return obstacles, poses, missing


def _turn(angle: float) -> Array:
    """Pinocchio's continuous joints are (cos, sin)."""
    return np.array([np.cos(angle), np.sin(angle)])


def pose_from(position: Any, quaternion: Any) -> Array:
    """(4, 4) from a position and a quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized(), np.asarray(position, dtype=float)).homogeneous


def scene_obstacles(problem: dict[str, Any], assets: Path, T_base_hand: Array) -> tuple[list[Obstacle], list[str]]:
    """Table, object and rigid object of a problem as it stands in the file; and the missing meshes.

    A rigid object within 30 mm of ``tool_head`` between closed fingers is ``attached`` (its pose is then in the hand
    frame), one that a constraint aims at is a ``target``.
    """
    T_base_world = np.linalg.inv(np.asarray(problem["T_world_base"]))
    table = part(coal.Box(*(2.0 * TABLE_HALF)), np.eye(4))
    obstacles = [Obstacle("table", "table", [table], T_base_world @ pose_from([0, 0, -0.025], [1, 0, 0, 0]))]
    record = problem["objects"]["articulated"]
    found, _, missing = object_obstacles(
        assets / "articulated_objs" / record["cls"] / record["id"],
        record["scale"],
        record["qpos"][0],
        T_base_world @ pose_from(record["root_p"], record["root_q"]),
    )
    obstacles += found
    rigid = problem["objects"].get("rigid")
    if rigid is None:
        return obstacles, missing
    path = assets / "rigidbody_objs" / "models" / rigid["cls"] / "collision.obj"
    if not path.exists():
        return obstacles, [*missing, path.name]
    shapes = [hull(points) for points in mesh_parts(path, rigid["scale"])]
    parts = [part(shape, np.eye(4)) for shape in shapes if shape is not None]
    pose = T_base_world @ pose_from(rigid["p"], rigid["q"])
    head = T_base_hand[:3, :3] @ problem["tool_keypoints_hand"]["tool_head"] + T_base_hand[:3, 3]
    aimed = any(
        str(entry.get("target_keypoint_name", "")).startswith("rigidbody_object")
        for entry in problem["config"]["constraint_list"]
    )
    if np.linalg.norm(head - pose[:3, 3]) < 0.03 and max(problem["q_current"][7:]) < 0.0399:
        return [*obstacles, Obstacle("rigid", "attached", parts, np.linalg.inv(T_base_hand) @ pose)], missing
    return [*obstacles, Obstacle("rigid", "target" if aimed else "rigid", parts, pose)], missing
