"""Provide independent kinematics, geometry and collision checks by Pinocchio, trimesh and coal, without gensim2.

Frames and units as in the problem files: metres, radians, poses (4, 4), everything in the robot base frame.
"""

from __future__ import annotations

import importlib.util
import xml.etree.ElementTree as ElementTree
from functools import lru_cache
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import trimesh
from contacts import Obstacle
from mechanism import Mechanism
from parts import Part, hull, part

Array = np.ndarray
HAND_LINKS = ("panda_hand", "panda_leftfinger", "panda_rightfinger")
TABLE_HALF = np.array([0.65, 0.65, 0.025])


def panda_files() -> tuple[Path, Path]:
    """Return ManiSkill's Panda: URDF and SRDF; the environment variable-free way, from the installed wheel."""
    spec = importlib.util.find_spec("mani_skill")
    if spec is None or not spec.submodule_search_locations:
        raise SystemExit("mani_skill is not installed: its wheel holds the Panda (pip install 'gensim2[sim]')")
    folder = Path(spec.submodule_search_locations[0]) / "assets" / "robots" / "panda"
    return folder / "panda_v2.urdf", folder / "panda_v2.srdf"


class Arm(Mechanism):
    """The Panda as a Pinocchio model."""

    def __init__(self) -> None:
        urdf, srdf = panda_files()
        super().__init__(urdf.read_text(), urdf.parent, "panda_hand", srdf.read_text())
        self.model = self.pinocchio()
        self.data = self.model.createData()
        self.hand = self.model.getFrameId("panda_hand")

    def hand_pose(self, q: Array) -> Array:
        """Return the pose (4, 4) of ``panda_hand``."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.hand].homogeneous.copy()

    def jacobian(self, q: Array) -> Array:
        """(6, 9): linear, angular velocity of the hand's origin in base axes."""
        return pin.computeFrameJacobian(self.model, self.data, q, self.hand, pin.LOCAL_WORLD_ALIGNED)


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
        scale: scale of meshes and link offsets.
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
    poses, missing = {}, []
    parts: dict[bool, list[Part]] = {False: [], True: []}
    for link in tree.findall("link"):
        name = link.get("name", "")
        frame = model.getFrameId(name)
        poses[name] = T_base_root @ data.oMf[frame].homogeneous
        moves = model.frames[frame].parentJoint > 0
        for element in link.findall("collision"):
            origin, mesh = element.find("origin"), element.find("geometry/mesh")
            path = folder / ("" if mesh is None else mesh.get("filename", ""))
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
    """Return an angle as (cos, sin), as Pinocchio represents continuous joints."""
    return np.array([np.cos(angle), np.sin(angle)])


def pose_from(position: Any, quaternion: Any) -> Array:
    """Return the pose (4, 4) of a position and a quaternion (w, x, y, z)."""
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
