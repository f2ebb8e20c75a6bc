"""Prepare a rigid object: compute mass, resting pose and grasp from its convex parts."""

from __future__ import annotations

import hashlib
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from gensim2.core.foreign.limits import MAX_OBJ
from gensim2.core.foreign.tree import shortened
from gensim2.objects.library.cache import cached_hulls, file_name, folder_once, read_model, write_model
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.meshes import listed, read_obj
from gensim2.objects.library.prepare import write_hull, write_visual
from gensim2.objects.library.released import within
from gensim2.objects.meshwork.decompose import components, decompose, make_hull, piece_hulls, weld
from gensim2.objects.physics import Inertial, inertial
from gensim2.objects.shapes import Mesh, rotation
from gensim2.objects.types import (
    BODY,
    Array,
    AssetError,
    Grip,
    Hulls,
    Keypoint,
    MissingFileError,
    Placement,
    RigidObject,
    Source,
)

FILE = "rigid.json"
#: An object that tips over at a smaller tilt than this (rad) is laid on its side instead of standing upright.
STEADY = np.radians(10)
#: Maximum tilt (rad) of an object that counts as upright. The base of a scanned object is uneven.
LEAN = np.radians(5)
#: Maximum height (m) above the lowest vertex of vertices that belong to the uneven foot.
FOOT = 2e-3
#: Parts thinner than this (m) are too thin to grasp.
THINNEST_GRIP = 1.5e-3
#: Number of directions, and number of heights, that the search for a grasp tries.
GRIP_ANGLES, GRIP_HEIGHTS = 24, 9
#: Width of a finger (m).
FINGER = 0.018


def steadiness(points: Array, center: Array) -> float:
    """Return the smallest tilt in rad that makes a body tip over. The body stands on its lowest vertices.

    ``points`` (N, 3) are vertices, and ``center`` (3,) is the centre of mass. The angle is negative if the body falls
    over without a tilt.
    """
    low = float(points[:, 2].min())
    foot = points[points[:, 2] < low + FOOT][:, :2]
    try:
        planes = ConvexHull(foot).equations
    except (QhullError, ValueError):
        return -1.0
    inside = float(-(planes[:, :2] @ center[:2] + planes[:, 2]).max())
    return float(np.arctan2(inside, center[2] - low))


def resting_pose(hulls: Sequence[Array], mass: Inertial) -> Placement:
    """Return the pose at rest on the table: the upright pose if it is stable, else the most probable stable pose."""
    points = np.concatenate(list(hulls))
    poses = [_least_turn(-side) for side in resting_sides(points, mass.center)]
    R = max(poses, key=lambda pose: float(pose[2, 2]))
    if R[2, 2] < np.cos(LEAN) or steadiness(points @ R.T, R @ mass.center) < STEADY:
        R = poses[0]
    low = float((points @ R[2]).min())
    quaternion = Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True)
    return Placement(np.array([0.0, 0.0, -low]), quaternion + 0.0)


def resting_sides(points: Array, center: Array) -> Array:
    """Return the sides on which a body can rest, as outward normals (K, 3), the most probable side first.

    The body is the hull of ``points`` (N, 3) with the centre of mass ``center`` (3,). A body that is dropped in a
    random orientation lands on a triangle with a probability proportional to the triangle's solid angle from the
    centre. Then the body topples until the centre is above its triangle.
    """
    shell = trimesh.convex.convex_hull(points).convex_hull
    corners, normals = np.asarray(shell.triangles), np.asarray(shell.face_normals)
    # Triangles ``t`` and ``across[t, k]`` share the edge opposite to corner ``k`` of ``t``.
    across = np.zeros(shell.faces.shape, dtype=int)
    for column, alone in enumerate(shell.face_adjacency_unshared.T):
        here, beyond = shell.face_adjacency[:, column], shell.face_adjacency[:, 1 - column]
        across[here, np.argmax(shell.faces[here] == alone[:, None], axis=1)] = beyond
    height = ((center - corners[:, 0]) * normals).sum(axis=1, keepdims=True)
    weights = trimesh.triangles.points_to_barycentric(corners, center - height * normals)
    numbers = np.arange(len(corners))
    falls = np.where((weights < 0).any(axis=1), across[numbers, weights.argmin(axis=1)], numbers)
    chances = np.array([_share(*(corner - center)) for corner in corners])
    moving = np.setdiff1d(numbers, falls[falls != numbers])
    for _ in numbers:
        moving = moving[falls[moving] != moving]
        for triangle in moving:
            chances[falls[triangle]] += chances[triangle]
            chances[triangle] = 0.0
        moving = falls[moving]
    sides: dict[tuple[float, ...], list[int]] = {}
    for triangle in np.flatnonzero(chances > 0).tolist():
        sides.setdefault(tuple(np.round(normals[triangle], 3)), []).append(triangle)
    order = np.argsort([-sum(chances[each] for each in side) for side in sides.values()])
    return normals[[list(sides.values())[place][0] for place in order]]


def _share(*corners: Array) -> float:
    """Return the solid angle of a triangle (corners (3,)) from the origin over 4π, by L'Huilier's theorem."""
    a, b, c = (corner / np.linalg.norm(corner) for corner in corners)
    arcs = [np.arccos(np.clip(np.dot(*pair), -1.0, 1.0)) for pair in ((a, b), (b, c), (c, a))]
    half = sum(arcs) / 2.0
    excess = math.prod([np.tan(half / 2), *(np.tan((half - arc) / 2) for arc in arcs)])
    return float(1.0 / np.pi * np.arctan(np.sqrt(max(excess, 0.0))))


def _least_turn(down: Array) -> Array:
    """Return the smallest rotation (3, 3) that turns the object's vector ``down`` (3,) to the +z axis of the world."""
    axis = np.cross(down, [0, 0, 1])
    angle = float(np.arccos(np.clip(down[2], -1, 1)))
    if np.linalg.norm(axis) < 1e-9:
        return np.eye(3) if angle < 1 else np.diag([1.0, -1.0, -1.0])
    return rotation(axis, angle)


def best_grip(hulls: Sequence[Array], center: Array, resting: Placement) -> Grip:
    """Return the best grasp from above with two parallel fingers.

    The search compares grasps in all directions, at all heights and on all parts of the object.

    The best grasp is narrow and close to the centre of mass. Closeness in height matters most, because round objects
    slip out of higher grasps. The width of a grasp is the extent between the fingers in a slab of the thickness
    ``FINGER``.
    """
    R = resting.rotation
    placed = [hull @ R.T + resting.position for hull in hulls]
    top = max(float(h[:, 2].max()) for h in placed)
    middle_of_mass = R @ center + resting.position
    best: tuple[float, float, Array, Array] | None = None
    for height in [middle_of_mass[2], *np.linspace(0, top, GRIP_HEIGHTS + 2)[1:-1]]:
        slices = [s for s in (_slice(h, float(height)) for h in placed) if s is not None]
        if not slices:
            continue
        for angle in np.pi * np.arange(GRIP_ANGLES) / GRIP_ANGLES:
            u, v = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
            for middle in [s.mean(axis=0) @ v for s in slices]:
                for low, high in _spans(slices, u, v, float(middle)):
                    point = np.array([*((low + high) / 2 * u + middle * v), height])
                    off = np.abs(point - middle_of_mass)
                    cost = (high - low) + 2.0 * float(off[2]) + 0.6 * float(np.hypot(off[0], off[1]))
                    if high - low > THINNEST_GRIP and (best is None or cost < best[0] - 1e-6):
                        best = (cost, high - low, point, np.array([*u, 0.0]))
    if best is None:
        raise AssetError("the object has no part that the fingers can grasp", field="collision")
    _, width, point, axis = best
    return Grip(R.T @ (point - resting.position), R.T @ axis, width)


def _slice(hull: Array, height: float) -> Array | None:
    """Return the outline (N, 2) of a hull in a horizontal slab at ``height``, which is half a finger thick."""
    near = hull[np.abs(hull[:, 2] - height) < FINGER / 4]
    above, below = hull[hull[:, 2] >= height], hull[hull[:, 2] < height]
    if not (len(above) and len(below)):
        return near[:, :2] if len(near) else None
    share = (height - below[:, None, 2]) / (above[None, :, 2] - below[:, None, 2])
    cut = below[:, None, :2] + share[..., None] * (above[None, :, :2] - below[:, None, :2])
    return np.asarray(cut.reshape(-1, 2))


def _spans(slices: Sequence[Array], u: Array, v: Array, middle: float) -> list[tuple[float, float]]:
    """Return intervals along ``u`` where a finger on ``v = middle`` touches material; narrow gaps are merged."""
    spans = []
    for corners in slices:
        along, across = corners @ u, corners @ v - middle
        if across.min() < FINGER / 2 and across.max() > -FINGER / 2:
            spans.append((float(along.min()), float(along.max())))
    spans.sort()
    joined: list[tuple[float, float]] = []
    for low, high in spans:
        # A finger cannot enter a gap that is narrower than the finger, so such a gap counts as material.
        if joined and low < joined[-1][1] + FINGER:
            joined[-1] = (joined[-1][0], max(joined[-1][1], high))
        else:
            joined.append((low, high))
    return joined


@dataclass(frozen=True)
class RigidModel:
    """A rigid object at its final size, before preparation.

    Attributes:
        hulls: convex parts. Each is an array (N, 3) of points in metres in the object frame.
        meshes: visual meshes in the object frame.
        keypoints: position (3,), metres in the object frame, and description by name.
        mass: mass in kg. None: ``density`` (kg/m³) times the volume of the hulls. The inertia comes from the hulls.
    """

    asset_class: str
    source: Source
    hulls: Sequence[Array]
    meshes: Sequence[Mesh]
    keypoints: dict[str, tuple[Array, str]]
    mass: float | None
    density: float
    friction: float
    license: str
    content_hash: str
    warnings: Sequence[str] = ()


def prepare(key: str, model: RigidModel) -> RigidObject:
    """Return the prepared object from the cache under ``key``; prepare the object if it is missing."""

    def make(folder: Path) -> None:
        hulls = list(model.hulls)
        body = inertial(hulls, model.density)
        if model.mass is not None:
            body = Inertial(model.mass, body.center, body.inertia * model.mass / body.mass)
        resting = resting_pose(hulls, body)
        grip = best_grip(hulls, body.center, resting)
        for i, hull in enumerate(hulls):
            write_hull(folder / f"hull_{i}.obj", hull)
        if model.meshes:
            write_visual(folder / "visual.glb", list(model.meshes))
        made = RigidObject(
            asset_class=model.asset_class,
            source=model.source,
            folder=Path(),  # the path is set after the folder has been renamed
            hulls={BODY: tuple(hulls)},
            mass=body.mass,
            center_of_mass=body.center,
            inertia=body.inertia,
            friction=model.friction,
            keypoints={name: Keypoint(BODY, np.asarray(at), said) for name, (at, said) in model.keypoints.items()},
            placement=resting,
            grip=grip,
            license=model.license,
            content_hash=model.content_hash,
            warnings=tuple(model.warnings),
        )
        write_model(folder / FILE, made)

    return read(folder_once(key, make))


def read(folder: Path) -> RigidObject:
    """Read a prepared object.

    Raises:
        AssetError: the folder is damaged.
    """
    return replace(read_model(folder / FILE, RigidObject), folder=folder)


DENSITY = 500.0
"""Density in kg/m³ of a real object's hulls if its mass is unknown."""
FRICTION = 0.6
SEEN = "textured.obj"


def load_from_meshes(
    name: str,
    folder: ObjectFolder,
    collision: str,
    scale: float,
    keypoints: dict[str, tuple[Array, str]],
    mass: float | None,
    density: float | None,
    license: str,
    code: str,
    rule: Hulls = "default",
) -> RigidObject:
    """Prepare a real rigid object from its meshes.

    Each connected collision piece becomes one hull, or several hulls if it has cavities.

    Args:
        collision: OBJ or PLY file in the folder.
        scale: length in metres of one unit of the meshes.
        keypoints: (position (3,) in metres, description) by name.
        mass: kg; None: computed from ``density`` (kg/m³), or from ``DENSITY``.
        density: kg/m³, or None.
        license: licence terms of the data.
        code: digest of the code that prepares the object.
        rule: method that converts meshes to convex parts; ``"original"`` replaces each piece by its hull.

    Raises:
        AssetError: the object cannot be used; the message gives the reason.
    """
    warnings: list[str] = []
    file = folder.path / collision
    told = {key: position.tolist() for key, (position, _) in keypoints.items()}
    made_of = (code, folder.fingerprint(), scale, mass, density, told, license)
    content = hashlib.sha256(repr(made_of).encode()).hexdigest()[:16]
    entry = content if rule == "default" else f"{content}-{rule}"
    try:
        pieces = [(scale * vertices, faces) for vertices, faces in _read(folder, collision)]
    except ValueError as error:
        raise AssetError(f"cannot be read: {shortened(str(error))}", file=file) from error
    within("geometry", max(float(np.abs(vertices).max()) for vertices, _ in pieces), file, "scale")
    for key, (position, _) in keypoints.items():
        within("keypoint", float(np.abs(position).max()), folder.path, key)
    visual: list[Mesh] = []
    try:
        meshes, materials = read_obj(folder, SEEN)
        visual = [Mesh(scale * m.vertices, m.faces, m.look) for m in meshes]
        missing = [material for material, there in materials.items() if not there]
        if missing:
            warnings.append(f"{len(missing)} material files missing: {listed(missing)}")
    except (ValueError, MissingFileError) as error:
        warnings.append(f"{SEEN} cannot be read, so there is no visual mesh: {shortened(str(error))}")
    hulls, counts = cached_hulls(f"rigid-{entry}", lambda: _hulls(pieces, rule))
    if not hulls:
        wrong = "the file has no usable collision part"
        raise AssetError(wrong, file=file, remedy="check the size and the scale of the object")
    if counts["dropped"]:
        warnings.append(f"{counts['dropped']} parts of {collision} under 1 mm are left out")
    model = RigidModel(
        name, "real", hulls, visual, keypoints, mass, density or DENSITY, FRICTION, license, content, warnings
    )
    return prepare(f"rigid-real-{file_name(name)}-{entry}", model)


def _read(folder: ObjectFolder, name: str) -> list[tuple[Array, Any]]:
    """Return vertices (N, 3) and faces (M, 3) of an OBJ or PLY file. Raise ValueError without triangles."""
    if name.endswith(".obj"):
        return [(mesh.vertices, mesh.faces) for mesh in read_obj(folder, name).meshes]
    content = folder.read(name, MAX_OBJ)
    import trimesh

    try:
        mesh = trimesh.load_mesh(io.BytesIO(content), file_type="ply", process=False)
        vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    except Exception as error:  # trimesh's PLY reader validates nothing and can raise any exception
        raise ValueError(f"the file is not a valid PLY file: {error or type(error).__name__}") from error
    if not (len(faces) and faces.min() >= 0 and faces.max() < len(vertices) and np.isfinite(vertices).all()):
        raise ValueError("the file contains no triangles, or a vertex is missing or not finite")
    return [(vertices, faces)]


def _hulls(pieces: list[tuple[Array, Any]], rule: Hulls) -> tuple[list[Array], dict[str, int]]:
    """Return the hull of each connected piece, or its hulls if it has cavities, and statistics.

    Most pieces are convex.
    """
    if rule == "original":
        whole, flat = piece_hulls(pieces)
        return whole, {"dropped": flat}
    kept: list[Array] = []
    dropped, hollow = 0, []
    for vertices, faces in pieces:
        for points, triangles in components(*weld(vertices, faces)):
            hull = make_hull(points)
            if hull is None:
                dropped += 1
            elif hull.volume > 1.2 * _volume(points, triangles) + 1e-6:
                hollow.append((points, triangles))
            else:
                kept.append(hull.points)
    if hollow:
        result = decompose(hollow)
        kept += result.hulls
    return kept, {"dropped": dropped}


def _volume(points: Array, faces: Any) -> float:
    a, b, c = (points[faces[:, i]] for i in range(3))
    return abs(float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6)
