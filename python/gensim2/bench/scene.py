"""Scene geometry of a recorded problem: table, articulated object and rigid object as convex parts."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from gensim2.bench.meshes import convex_points, load_parts
from gensim2.bench.problems import PlanProblem
from gensim2.errors import InputError

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]
Role = Literal["table", "object_body", "moving_link", "rigid", "target", "attached"]

#: The recorded scenes' table: half extents and centre, world frame, metres.
TABLE_HALF_EXTENTS = np.array([0.65, 0.65, 0.025])
TABLE_CENTER = np.array([0.0, 0.0, -0.025])

#: A rigid object whose origin is this close to ``tool_head`` is held by the hand, metres.
GRASP_DISTANCE = 0.03


@dataclass(frozen=True)
class SceneObstacle:
    """Convex parts that move as one.

    Attributes:
        name: unique in the scene.
        role: ``"target"`` is a rigid object that the constraints aim at, ``"attached"`` one that the hand holds.
        hulls: vertex sets, each (N, 3) metres in the body frame.
        pose: (4, 4) body in the robot base frame; in the hand frame where the role is ``"attached"``.
    """

    name: str
    role: Role
    hulls: tuple[Array, ...]
    pose: Array


@dataclass(frozen=True)
class SceneJoint:
    """The moving joint: ``origin`` and unit ``axis``, each (3,), in the robot base frame; value in rad or m."""

    kind: Literal["revolute", "prismatic"]
    origin: Array
    axis: Array
    value: float
    lower: float
    upper: float


@dataclass(frozen=True)
class ProblemScene:
    """Obstacles and joint of a problem; ``warnings`` says what could not be loaded."""

    obstacles: tuple[SceneObstacle, ...]
    joint: SceneJoint | None
    warnings: tuple[str, ...]


@dataclass
class _Link:
    #: (pose in the link frame, mesh file), one a collision element
    meshes: list[tuple[Array, Path]] = field(default_factory=list)


@dataclass(frozen=True)
class _Joint:
    name: str
    kind: str
    parent: str
    child: str
    pose: Array
    axis: Array


def pose_from(position: Array | list[float], quaternion: list[float]) -> Array:
    """Return the (4, 4) pose of a position and a quaternion (w, x, y, z)."""
    from scipy.spatial.transform import Rotation  # here and below: refusing a file of problems needs no SciPy

    return _pose(Rotation.from_quat(quaternion, scalar_first=True), position)


def _pose(rotation: Rotation, position: Array | list[float]) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.as_matrix(), position
    return pose


def _numbers(element: ElementTree.Element, name: str, default: str, file: Path) -> Array:
    text = element.get(name, default)
    try:
        values = np.array([float(part) for part in text.split()])
    except ValueError as error:
        raise InputError(f"{text!r} is not three numbers", file=file, field=name, remedy="repair the URDF") from error
    if values.shape != (3,) or not np.isfinite(values).all():
        raise InputError(f"{text!r} is not three finite numbers", file=file, field=name, remedy="repair the URDF")
    return values


def _origin(parent: ElementTree.Element, scale: float, file: Path) -> Array:
    element = parent.find("origin")
    if element is None:
        return np.eye(4)
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_euler("xyz", _numbers(element, "rpy", "0 0 0", file))
    return _pose(rotation, scale * _numbers(element, "xyz", "0 0 0", file))


@lru_cache(maxsize=512)
def _read_urdf(path: Path, scale: float) -> tuple[dict[str, _Link], tuple[_Joint, ...]]:
    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        raise InputError(
            f"cannot read: {error.strerror}", file=path, remedy="--assets names the folder that holds the objects"
        ) from error
    except ElementTree.ParseError as error:
        raise InputError(f"not XML: {error}", file=path, remedy="repair the URDF") from error
    links: dict[str, _Link] = {}
    for element in root.findall("link"):
        link = links.setdefault(element.get("name", ""), _Link())
        for collision in element.findall("collision"):
            mesh = collision.find("geometry/mesh")
            if mesh is None:
                raise InputError(
                    "a collision element without a mesh", file=path, field=element.get("name"), remedy="give it one"
                )
            link.meshes.append((_origin(collision, scale, path), path.parent / mesh.get("filename", "")))
    joints = []
    for element in root.findall("joint"):
        parent, child, axis = element.find("parent"), element.find("child"), element.find("axis")
        name = element.get("name", "")
        if parent is None or child is None:
            raise InputError("no parent or no child", file=path, field=name, remedy="repair the URDF")
        direction = np.array([1.0, 0.0, 0.0]) if axis is None else _numbers(axis, "xyz", "1 0 0", path)
        kind = element.get("type", "")
        length = float(np.linalg.norm(direction))
        if kind != "fixed" and length < 1e-9:
            raise InputError("its axis has no length", file=path, field=name, remedy="repair the URDF")
        joints.append(
            _Joint(
                name,
                kind,
                parent.get("link", ""),
                child.get("link", ""),
                _origin(element, scale, path),
                direction / length if length > 0.0 else direction,
            )
        )
    return links, tuple(joints)


@lru_cache(maxsize=8192)
def _mesh_hulls(path: Path, scale: float) -> tuple[Array, ...]:
    hulls = (convex_points(scale * part) for part in load_parts(path).vertices)
    return tuple(hull for hull in hulls if hull is not None)


def _link_hulls(link: _Link, T_body_link: Array, scale: float, folder: Path, warnings: list[str]) -> list[Array]:
    hulls = []
    for T_link_mesh, path in link.meshes:
        try:
            parts = _mesh_hulls(path, scale)
        except FileNotFoundError:
            warnings.append(f"missing mesh: {path.relative_to(folder)}")
            continue
        pose = T_body_link @ T_link_mesh
        hulls += [hull @ pose[:3, :3].T + pose[:3, 3] for hull in parts]
    return hulls


def _articulated(problem: PlanProblem, folder: Path, warnings: list[str]) -> tuple[list[SceneObstacle], SceneJoint]:
    """The object's body and moving link at the recorded joint value."""
    from scipy.spatial.transform import Rotation

    record = problem.objects.articulated
    path = folder / "articulated_objs" / record.cls / record.id / "mobility.urdf"
    links, joints = _read_urdf(path, record.scale)
    moving = [joint for joint in joints if joint.kind != "fixed"]
    if len(moving) != 1 or moving[0].kind not in ("revolute", "prismatic", "continuous"):
        raise InputError(
            f"{len(moving)} movable joints", file=path, remedy="an object has one revolute or prismatic joint"
        )
    kind: Literal["revolute", "prismatic"] = "prismatic" if moving[0].kind == "prismatic" else "revolute"
    value = record.qpos[0]
    T_base_root = np.linalg.inv(problem.pose("T_world_base")) @ pose_from(record.root_p, record.root_q)
    children = {joint.child for joint in joints}
    poses = {name: np.eye(4) for name in links if name not in children}
    mobile: dict[str, bool] = dict.fromkeys(poses, False)
    found: SceneJoint | None = None
    waiting = list(joints)
    while waiting:
        ready = [joint for joint in waiting if joint.parent in poses]
        if not ready:
            raise InputError("its joints do not form a tree", file=path, remedy="repair the URDF")
        for joint in ready:
            waiting.remove(joint)
            pose = poses[joint.parent] @ joint.pose
            if joint.kind != "fixed":
                world = T_base_root @ pose
                lower, upper = sorted((record.close_qpos, record.open_qpos))
                found = SceneJoint(kind, world[:3, 3], world[:3, :3] @ joint.axis, value, lower, upper)
                motion = np.eye(4)
                if kind == "prismatic":
                    motion[:3, 3] = value * joint.axis
                else:
                    motion = _pose(Rotation.from_rotvec(value * joint.axis), np.zeros(3))
                pose = pose @ motion
            poses[joint.child] = pose
            mobile[joint.child] = mobile[joint.parent] or joint.kind != "fixed"
    assert found is not None
    hulls: dict[bool, list[Array]] = {False: [], True: []}
    for name, link in links.items():
        hulls[mobile[name]] += _link_hulls(link, poses[name], record.scale, path.parent, warnings)
    roles: tuple[tuple[str, Role, bool], ...] = (
        ("object_body", "object_body", False),
        ("moving_link", "moving_link", True),
    )
    obstacles = [
        SceneObstacle(name, role, tuple(hulls[moves]), T_base_root) for name, role, moves in roles if hulls[moves]
    ]
    return obstacles, found


def _rigid(problem: PlanProblem, folder: Path, warnings: list[str]) -> SceneObstacle | None:
    record = problem.objects.rigid
    if record is None:
        return None
    path = folder / "rigidbody_objs" / "models" / record.cls / "collision.obj"
    try:
        hulls = _mesh_hulls(path, record.scale)
    except FileNotFoundError:
        warnings.append(f"missing mesh: {record.cls}/collision.obj")
        return None
    pose = np.linalg.inv(problem.pose("T_world_base")) @ pose_from(record.p, record.q)
    return SceneObstacle(f"rigid_{record.cls}", "rigid", hulls, pose)


def _target_names(config: dict[str, object]) -> set[str]:
    constraints = config.get("constraint_list")
    entries = constraints if isinstance(constraints, list) else []
    return {str(entry.get("target_keypoint_name")) for entry in entries if isinstance(entry, dict)}


def problem_scene(problem: PlanProblem, assets: Path | None, T_base_hand: Array) -> ProblemScene:
    """Return the obstacles of a problem.

    Args:
        problem: a recorded problem.
        assets: folder with ``articulated_objs`` and ``rigidbody_objs``; None leaves the objects out.
        T_base_hand: (4, 4) hand at ``q_current``, in the robot base frame.

    Raises:
        InputError: an object's folder is missing or its files are broken (a missing mesh is only a warning).
    """
    T_base_world = np.linalg.inv(problem.pose("T_world_base"))
    table = T_base_world @ pose_from(TABLE_CENTER, [1.0, 0.0, 0.0, 0.0])
    corners = np.array(np.meshgrid(*([[-1.0, 1.0]] * 3))).reshape(3, -1).T * TABLE_HALF_EXTENTS
    obstacles = [SceneObstacle("table", "table", (corners,), table)]
    if assets is None:
        return ProblemScene(tuple(obstacles), None, ())
    warnings: list[str] = []
    bodies, joint = _articulated(problem, assets, warnings)
    obstacles += bodies
    rigid = _rigid(problem, assets, warnings)
    if rigid is not None:
        obstacles.append(_with_role(rigid, problem, T_base_hand))
    return ProblemScene(tuple(obstacles), joint, tuple(warnings))


def _with_role(rigid: SceneObstacle, problem: PlanProblem, T_base_hand: Array) -> SceneObstacle:
    """Held by the hand, aimed at, or in the way."""
    head = problem.tool_keypoints_hand.get("tool_head")
    T_hand_rigid = np.linalg.inv(T_base_hand) @ rigid.pose
    closed = max(problem.q_current[7:]) < 0.0399
    if head is not None and closed and np.linalg.norm(T_hand_rigid[:3, 3] - head) < GRASP_DISTANCE:
        return SceneObstacle(rigid.name, "attached", rigid.hulls, T_hand_rigid)
    if any(name.startswith("rigidbody_object") for name in _target_names(problem.config)):
        return SceneObstacle(rigid.name, "target", rigid.hulls, rigid.pose)
    return rigid


def check_assets(folder: Path) -> Path:
    """Return the folder, or raise InputError where it does not hold ``articulated_objs``."""
    if not (folder / "articulated_objs").is_dir():
        raise InputError(
            "no articulated_objs in it", file=folder, field="--assets", remedy="name the folder of real objects"
        )
    return folder
