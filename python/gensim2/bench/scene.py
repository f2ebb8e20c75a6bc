"""Build the scene of a recorded problem: convex hulls of the table, the articulated object and the rigid object."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from gensim2.bench.problems import PlanProblem
from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.urdf import MOVABLE, Urdf, fixed_frames, read_urdf, shape_elements, unit_axis
from gensim2.objects.shapes import transform
from gensim2.objects.types import MissingFileError, joint_motion

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


#: Minimum thickness of a part (m, final scale). Thinner parts are thickened, because a hull needs a volume.
MINIMUM_THICKNESS = 5e-4
SAME_PLACE = 1e-9  # vertices closer than this are merged (units of the file)


@dataclass(frozen=True)
class Parts:
    """Connected parts of one mesh file. The vertices (N, 3) of each part are in the file's units."""

    vertices: tuple[Array, ...]


@lru_cache(maxsize=4096)
def load_parts(folder: Path, name: str) -> Parts:
    """Read an OBJ file and split it into connected parts; coincident vertices are merged.

    Raises:
        MissingFileError: the file does not exist.
        InputError: the file is not a mesh, is outside the folder, or has numbers that are not finite.
    """
    from gensim2.objects.library.meshes import (
        read_obj,
    )  # import late, because checking a problem file does not need this module
    from gensim2.objects.meshwork.decompose import components, weld

    try:
        meshes = read_obj(ObjectFolder(folder), name).meshes
    except ValueError as error:
        raise InputError(str(error), file=folder / name, remedy="repair the mesh") from error
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)])
    return Parts(tuple(points for points, _ in components(*weld(vertices, faces, SAME_PLACE))))


def convex_points(points: Array) -> Array | None:
    """Return the vertices of the convex hull of points (N, 3), m; None if the points lie on a line.

    If the points lie in a plane, the hull gets the thickness ``MINIMUM_THICKNESS``.
    """
    from scipy.spatial import ConvexHull, QhullError

    centered = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centered.T @ centered)
    spread = np.ptp(centered @ axes, axis=0)
    if len(points) < 3 or np.sort(spread)[1] < 1e-6:
        return None
    thinnest = int(np.argmin(spread))
    if spread[thinnest] < MINIMUM_THICKNESS:
        shift = 0.5 * (MINIMUM_THICKNESS - spread[thinnest]) * axes[:, thinnest]
        points = np.concatenate([points + shift, points - shift])
    try:
        return np.ascontiguousarray(points[ConvexHull(points).vertices])
    except QhullError:
        return None


Role = Literal["table", "object_body", "moving_link", "rigid", "target", "attached"]

#: Half extents (m) of the table in the recorded scenes. ``TABLE_CENTER`` (m) is its centre in the world frame.
TABLE_HALF_EXTENTS = np.array([0.65, 0.65, 0.025])
TABLE_CENTER = np.array([0.0, 0.0, -0.025])

#: Maximum distance (m) from ``tool_head`` to the origin of a rigid object that counts as grasped.
GRASP_DISTANCE = 0.03


@dataclass(frozen=True)
class SceneObstacle:
    """Body in the scene, made of convex hulls.

    Attributes:
        name: unique name in the scene.
        role: ``"table"``; ``"object_body"`` or ``"moving_link"``, the parts of an articulated object; ``"target"``, a
            rigid object in the constraints; ``"attached"``, a grasped object; or ``"rigid"``, any other rigid object.
        hulls: vertices (N, 3) of each hull in the body frame, m.
        pose: (4, 4) pose of the body in the robot base frame, or in the hand frame if ``role`` is ``"attached"``.
    """

    name: str
    role: Role
    hulls: tuple[Array, ...]
    pose: Array


@dataclass(frozen=True)
class SceneJoint:
    """Movable joint.

    ``origin`` (3,) and the unit vector ``axis`` (3,) are in the robot's base frame; the value is in rad or m.
    """

    kind: Literal["revolute", "prismatic"]
    origin: Array
    axis: Array
    value: float
    lower: float
    upper: float


@dataclass(frozen=True)
class ProblemScene:
    """Obstacles of a problem and the object's movable joint. ``warnings`` lists meshes that could not be loaded."""

    obstacles: tuple[SceneObstacle, ...]
    joint: SceneJoint | None
    warnings: tuple[str, ...]


def pose_from(position: Array | list[float], quaternion: list[float]) -> Array:
    from scipy.spatial.transform import (
        Rotation,
    )  # import late, because checking a problem file does not need this module

    return _pose(Rotation.from_quat(quaternion, scalar_first=True), position)


def _pose(rotation: Rotation, position: Array | list[float]) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.as_matrix(), position
    return pose


def _scaled(T: Array, scale: float) -> Array:
    """Return a pose with its translation multiplied by ``scale``, which converts units of a model to metres."""
    pose = T.copy()
    pose[:3, 3] *= scale
    return pose


@lru_cache(maxsize=512)
def _urdf(folder: Path) -> Urdf:
    return read_urdf(ObjectFolder(folder))


@lru_cache(maxsize=8192)
def _mesh_hulls(folder: Path, name: str, scale: float) -> tuple[Array, ...]:
    hulls = (convex_points(scale * part) for part in load_parts(folder, name).vertices)
    return tuple(hull for hull in hulls if hull is not None)


def _link_hulls(urdf: Urdf, link: str, T_body_link: Array, scale: float, warnings: list[str]) -> list[Array]:
    hulls = []
    for element in shape_elements(urdf, link, "collision"):
        shape = element.shape
        if isinstance(shape, str):
            try:
                parts = _mesh_hulls(urdf.file.parent, shape, scale)
            except MissingFileError:
                warnings.append(f"missing mesh: {shape}")
                continue
        else:
            parts = (scale * np.asarray(shape.mesh().vertices),)
        pose = T_body_link @ _scaled(element.T, scale)
        hulls += [transform(pose, element.scale * hull) for hull in parts]
    return hulls


def _articulated(problem: PlanProblem, folder: Path, warnings: list[str]) -> tuple[list[SceneObstacle], SceneJoint]:
    """Return the body and the moving link of the articulated object at the recorded joint value."""

    record = problem.objects.articulated
    urdf = _urdf(folder / "articulated_objs" / record.cls / record.id)
    moving = [joint for joint in urdf.joints if joint.type != "fixed"]
    if len(moving) != 1 or moving[0].type not in MOVABLE:
        wrong = f"has {len(moving)} movable joints"
        raise InputError(wrong, file=urdf.file, remedy="an object must have exactly one revolute or prismatic joint")
    joint, axis, value, scale = moving[0], unit_axis(moving[0], urdf.file), record.qpos[0], record.scale
    frames = fixed_frames(urdf, joint)
    T_base_root = np.linalg.inv(problem.pose("T_world_base")) @ pose_from(record.root_p, record.root_q)
    T_root_joint = _scaled(frames["body"][joint.parent] @ joint.T, scale)
    kind: Literal["revolute", "prismatic"] = "prismatic" if joint.type == "prismatic" else "revolute"
    motion = joint_motion(kind, axis, value)
    T_base_joint = T_base_root @ T_root_joint
    lower, upper = sorted((record.close_qpos, record.open_qpos))
    found = SceneJoint(kind, T_base_joint[:3, 3], T_base_joint[:3, :3] @ axis, value, lower, upper)
    groups: tuple[tuple[Literal["body", "moving"], Role, Array], ...] = (
        ("body", "object_body", np.eye(4)),
        ("moving", "moving_link", T_root_joint @ motion),
    )
    obstacles = []
    for group, role, T_root_group in groups:
        links = [link for link in urdf.links if link in frames[group]]
        hulls = [
            hull
            for link in links
            for hull in _link_hulls(urdf, link, T_root_group @ _scaled(frames[group][link], scale), scale, warnings)
        ]
        if hulls:
            obstacles.append(SceneObstacle(role, role, tuple(hulls), T_base_root))
    return obstacles, found


def _rigid(problem: PlanProblem, folder: Path, warnings: list[str]) -> SceneObstacle | None:
    record = problem.objects.rigid
    if record is None:
        return None
    try:
        hulls = _mesh_hulls(folder / "rigidbody_objs" / "models" / record.cls, "collision.obj", record.scale)
    except MissingFileError:
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
        problem: recorded problem.
        assets: folder with ``articulated_objs`` and ``rigidbody_objs``; None leaves the objects out.
        T_base_hand: (4, 4) pose of the hand at ``q_current`` in the robot base frame.

    Raises:
        InputError: an object's folder is missing or its files are invalid (a missing mesh is only a warning).
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
    """Return the rigid object with its role in the problem: grasped object, target, or obstacle."""
    head = problem.tool_keypoints_hand.get("tool_head")
    T_hand_rigid = np.linalg.inv(T_base_hand) @ rigid.pose
    closed = max(problem.q_current[7:]) < 0.0399
    if head is not None and closed and np.linalg.norm(T_hand_rigid[:3, 3] - head) < GRASP_DISTANCE:
        return SceneObstacle(rigid.name, "attached", rigid.hulls, T_hand_rigid)
    if any(name.startswith("rigidbody_object") for name in _target_names(problem.config)):
        return SceneObstacle(rigid.name, "target", rigid.hulls, rigid.pose)
    return rigid


def check_assets(folder: Path) -> Path:
    """Return ``folder``; raise InputError if the folder does not contain ``articulated_objs``."""
    if not (folder / "articulated_objs").is_dir():
        wrong = "the folder has no subfolder articulated_objs"
        raise InputError(wrong, file=folder, field="--assets", remedy="give the folder of GenSim2's released objects")
    return folder
