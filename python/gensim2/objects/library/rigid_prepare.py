"""From the parts of a rigid object to a prepared folder: masses, the pose it rests in, where it can be held."""

from __future__ import annotations

import hashlib
import io
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
#: Tilt (rad) after which an object that stands on its foot would fall over; with less it is laid down.
STEADY = np.radians(10)
#: Tilt (rad) with which an object still counts as upright: scanned feet are not level.
LEAN = np.radians(5)
#: Vertices this far (m) above the lowest still carry: scanned feet are uneven.
FOOT = 2e-3
#: Thinner matter (m) is an edge, not a hold.
THINNEST_GRIP = 1.5e-3
#: Directions and heights at which holds are looked for.
GRIP_ANGLES, GRIP_HEIGHTS = 24, 9
#: Fingers are about this wide (m).
FINGER = 0.018


def steadiness(points: Array, center: Array) -> float:
    """Tilt in rad by which a body with corners (N, 3) and centre of mass (3,), standing on its lowest ones, falls over.

    Negative where it falls by itself.
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
    """The pose in which an object lies on the table: upright where that is steady, else where it ends up most often.

    Poses of its convex hull that are statically stable, and their probabilities, are trimesh's.
    """
    points = np.concatenate(list(hulls))
    shell = trimesh.convex.convex_hull(points)
    transforms, chances = trimesh.poses.compute_stable_poses(shell, center_mass=mass.center, seed=0)
    poses = [_least_turn(np.asarray(T[:3, :3], float)) for T in transforms] or [np.eye(3)]
    R = max(poses, key=lambda pose: float(pose[2, 2]))
    if R[2, 2] < np.cos(LEAN) or steadiness(points @ R.T, R @ mass.center) < STEADY:
        R = poses[int(np.argmax(np.round(chances, 6)))] if len(chances) else R
    low = float((points @ R[2]).min())
    quaternion = Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True)
    return Placement(np.array([0.0, 0.0, -low]), quaternion + 0.0)


def _least_turn(R: Array) -> Array:
    """Of all rotations with the same side down, the one that turns least from upright."""
    down = R[2]  # world up in the object frame
    axis = np.cross(down, [0, 0, 1])
    angle = float(np.arccos(np.clip(down[2], -1, 1)))
    if np.linalg.norm(axis) < 1e-9:
        return np.eye(3) if angle < 1 else np.diag([1.0, -1.0, -1.0])
    return rotation(axis, angle)


def best_grip(hulls: Sequence[Array], center: Array, resting: Placement) -> Grip:
    """The best hold between two parallel fingers that come from above, over directions, heights and parts.

    Narrow ones are best, at the height of the centre of mass (round things slip out of fingers that hold them higher)
    and not far beside it. A finger is ``FINGER`` wide: what counts is the extent of the matter within half of that
    from the fingers' plane.
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
        raise AssetError("has no matter that fingers could hold", field="collision")
    _, width, point, axis = best
    return Grip(R.T @ (point - resting.position), R.T @ axis, width)


def _slice(hull: Array, height: float) -> Array | None:
    """Corners (N, 2) of a hull's section, a finger's half width above and below included."""
    near = hull[np.abs(hull[:, 2] - height) < FINGER / 4]
    above, below = hull[hull[:, 2] >= height], hull[hull[:, 2] < height]
    if not (len(above) and len(below)):
        return near[:, :2] if len(near) else None
    share = (height - below[:, None, 2]) / (above[None, :, 2] - below[:, None, 2])
    cut = below[:, None, :2] + share[..., None] * (above[None, :, :2] - below[:, None, :2])
    return np.asarray(cut.reshape(-1, 2))


def _spans(slices: Sequence[Array], u: Array, v: Array, middle: float) -> list[tuple[float, float]]:
    """Intervals along ``u`` of the matter within half a finger of the line ``v = middle``, joined where they touch."""
    spans = []
    for corners in slices:
        along, across = corners @ u, corners @ v - middle
        if across.min() < FINGER / 2 and across.max() > -FINGER / 2:
            spans.append((float(along.min()), float(along.max())))
    spans.sort()
    joined: list[tuple[float, float]] = []
    for low, high in spans:
        # A gap that no finger fits into counts as matter.
        if joined and low < joined[-1][1] + FINGER:
            joined[-1] = (joined[-1][0], max(joined[-1][1], high))
        else:
            joined.append((low, high))
    return joined


@dataclass(frozen=True)
class RigidModel:
    """A rigid object before it is prepared, at its final size.

    Attributes:
        hulls: convex parts, each (N, 3) metres in the object frame.
        meshes: what is seen, same frame.
        keypoints: name to (position (3,) in metres, same frame; a phrase).
        mass: kg; None: by ``density`` (kg/m³) of the hulls, which also gives the shape of the inertia.
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
    """Prepare an object under ``key`` in the cache, unless it is there."""

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
            folder=Path(),  # the folder is renamed afterwards
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
"""kg/m³ of a real object's hulls where nothing says its mass."""
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
    """Prepare a real object. Collision: each connected piece as its hull where that fills no cavity, else taken apart.

    Args:
        name: its class.
        folder: with its meshes.
        collision: OBJ or PLY file in it.
        scale: metres a unit of the meshes.
        keypoints: name to (position (3,) in metres, phrase).
        mass: kg; None: by ``density`` (kg/m³), or ``DENSITY``.
        license: terms of the data.
        code: digest of the code that prepares it.
        rule: ``"original"`` takes nothing apart.

    Raises:
        AssetError: it cannot be used; says why.
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
        warnings.append(f"{SEEN} cannot be read, nothing to look at: {shortened(str(error))}")
    hulls, counts = cached_hulls(f"rigid-{entry}", lambda: _hulls(pieces, rule))
    if not hulls:
        raise AssetError("holds no part that can collide", file=file, remedy="see its size and the scale")
    if counts["dropped"]:
        warnings.append(f"{counts['dropped']} parts of {collision} under 1 mm are left out")
    model = RigidModel(
        name, "real", hulls, visual, keypoints, mass, density or DENSITY, FRICTION, license, content, warnings
    )
    return prepare(f"rigid-real-{file_name(name)}-{entry}", model)


def _read(folder: ObjectFolder, name: str) -> list[tuple[Array, Any]]:
    """Vertices (N, 3) and faces (M, 3) of an OBJ file's meshes, or of a PLY file.

    Raises:
        AssetError: the file cannot be read.
        ValueError: it holds no triangles.
    """
    if name.endswith(".obj"):
        return [(mesh.vertices, mesh.faces) for mesh in read_obj(folder, name).meshes]
    content = folder.read(name, MAX_OBJ)
    import trimesh

    try:
        mesh = trimesh.load_mesh(io.BytesIO(content), file_type="ply", process=False)
        vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    except Exception as error:  # trimesh's reader of PLY checks nothing, and fails in any way
        raise ValueError(f"not PLY: {error or type(error).__name__}") from error
    if not (len(faces) and faces.min() >= 0 and faces.max() < len(vertices) and np.isfinite(vertices).all()):
        raise ValueError("holds no triangles of finite vertices")
    return [(vertices, faces)]


def _hulls(pieces: list[tuple[Array, Any]], rule: Hulls) -> tuple[list[Array], dict[str, int]]:
    """The files are convex decompositions already: a piece is its own hull unless that adds much to it."""
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
    """Volume that a closed surface encloses (m³)."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    return abs(float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6)
